//! The process around a command: its log, its async runtime, its place in the DDS network, the signals that end it, the lock on its data
//! folder, the lines to a hub and to an issuer of logins, and the files, folders and certificates that commands make.

pub mod async_runtime;
pub mod believing;
pub mod certificate;
pub mod data_folder;
pub mod dds;
pub mod hub_flags;
pub mod hub_folder;
pub mod log;
pub mod new_file;
pub mod oidc_flags;
pub mod shutdown_signal;
