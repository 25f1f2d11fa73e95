//! ROS 2 over DDS: the DDS library in its process, and the participants of others that are heard beside it.

pub mod announced;
mod busy_discovery;
pub mod child;
mod discovered;
mod echo_check;
pub mod keep;
mod losses;
mod open_readers;
mod qos;
mod raw_bytes;
mod relief;
pub mod spdp;
