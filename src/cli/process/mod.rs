//! The process around a command: its log, its place in the DDS network, the signals that end it, and the lock on its
//! data folder.

pub mod data_folder;
pub mod dds;
pub mod log;
pub mod shutdown_signal;
