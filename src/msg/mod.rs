//! ROS 2 messages without DDS: CDR, the messages that are spoken, fields of any message, and what is read of a topic. Pure.

pub mod cdr;
pub mod fields;
pub mod messages;
pub mod received;
pub(crate) mod ros_clock;
pub(crate) mod sample_bytes;
pub(crate) mod subscription;
