//! The fleet that a vehicle tells of itself.

use std::path::PathBuf;

/// The settings of the line to the hub. Without a fleet there are none.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fleet {
    /// `tls://HOST:PORT`
    pub hub: String,
    /// The file of the vehicle's private key.
    pub credentials: PathBuf,
    /// The certificates that sign the hub's certificate.
    pub ca: PathBuf,
    /// The line carries no more, in kbit/s.
    pub max_kbit_s: u32,
}
