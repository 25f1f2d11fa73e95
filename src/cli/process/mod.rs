//! The process around a command: its log, its place in the DDS network, the signals that end it, the lock on its data
//! folder, and the folders and certificates that commands make.

pub mod certificate;
pub mod data_folder;
pub mod dds;
pub mod hub_folder;
pub mod log;
pub mod shutdown_signal;
