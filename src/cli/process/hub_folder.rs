//! Makes the folder of a hub: its configuration, its certificate and its keys.

use std::path::Path;

use anyhow::{Context as _, bail};

use super::certificate::self_signed;
use crate::fleet::hub::{CONFIG_FILE, CONSOLE_KEY_FILE, HubFolder, Server};
use crate::yaml::private_file::{make_folder, write_private};

/// The certificate of a hub, beside its keys. It signs itself: vehicles have it as `ca`.
pub const CERTIFICATE: &str = "hub.pem";
const KEY: &str = "hub-key.pem";

/// Makes it for a hub that has these names and listens on this address.
///
/// # Errors
/// There is one already, a name is none, or the disk does not take it.
pub fn write_hub(dir: &Path, names: &[String], listen: &str, disk_bytes: u64) -> anyhow::Result<HubFolder> {
    make_folder(dir).with_context(|| format!("the folder {} cannot be made", dir.display()))?;
    let (certificate, key) = (dir.join(CERTIFICATE), dir.join(KEY));
    let key_file = dir.join(CONSOLE_KEY_FILE);
    for file in [&certificate, &key, &key_file, &dir.join(CONFIG_FILE)] {
        if file.exists() {
            bail!("{} is there already: name another folder", file.display());
        }
    }
    let (certificate_pem, key_pem) = self_signed(names)?;
    for (path, pem) in [(&key, key_pem), (&certificate, certificate_pem)] {
        write_private(path, pem.as_bytes())
            .with_context(|| format!("{} cannot be written", path.display()))?;
    }
    // nats-server reads them from its working directory.
    let (certificate, key) = (Path::new(CERTIFICATE), Path::new(KEY));
    Ok(HubFolder::make(dir, Server { listen, certificate, key, disk_bytes })?)
}
