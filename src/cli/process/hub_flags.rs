//! The flags of commands that read what lies at a hub.

use std::path::{Path, PathBuf};

use anyhow::Context as _;

use super::hub_folder::CERTIFICATE;
use crate::fleet::identity::Identity;
use crate::fleet::line::Hub;

#[derive(Debug, clap::Args)]
pub struct HubFlags {
    /// The address of the hub
    #[arg(long, value_name = "URL")]
    pub hub: String,
    /// The key for consoles that `telltale fleet hub-config` made; only its owner may read it
    #[arg(long, value_name = "FILE")]
    pub credentials: PathBuf,
    /// The certificates that sign the hub's certificate [default: hub.pem beside the key]
    #[arg(long, value_name = "FILE")]
    pub ca: Option<PathBuf>,
}

impl HubFlags {
    /// How the hub is reached, and by whom.
    ///
    /// # Errors
    /// The key or the certificates cannot be read.
    pub fn read(&self) -> anyhow::Result<(Hub, Identity)> {
        let identity = Identity::read(&self.credentials)?;
        let beside = self.credentials.parent().unwrap_or(Path::new("")).join(CERTIFICATE);
        let hub = Hub { url: self.hub.clone(), ca: self.ca.clone().unwrap_or(beside) };
        std::fs::File::open(&hub.ca)
            .with_context(|| format!("the hub's certificate {}", hub.ca.display()))?;
        Ok((hub, identity))
    }
}
