//! ROS 2 messages without DDS: CDR, Telltale's own messages, fields of any message, and the topics that a
//! model needs. Pure.

pub mod cdr;
pub mod fields;
pub mod lifecycle;
pub mod messages;
pub mod received;
pub mod ros_clock;
pub mod sample_bytes;
pub mod services;
pub mod subscription;
