//! The fleet that a vehicle tells of itself.

use std::path::PathBuf;

use telltale_engine::words;

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
    pub recordings: Recordings,
}

words! {
    /// Which recordings go to the fleet.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub enum Recordings {
        /// Those that its console asks for.
        #[default]
        OnDemand = "on_demand",
        /// Each finished one, and those that are asked for again.
        Always = "always",
        Never = "never",
    }
}
