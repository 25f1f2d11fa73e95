//! Makes certificates that sign themselves, and writes private files.

use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use anyhow::Context as _;
use rcgen::{CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, KeyPair};

use crate::clock::Clock;
use crate::store::give_to_owner_of;

/// Browsers reject server certificates that are valid for longer than 825 days.
const VALID: Duration = Duration::from_secs(820 * 24 * 3600);
/// Browsers' clocks may be a little behind.
const VALID_BEFORE: Duration = Duration::from_secs(24 * 3600);

/// A certificate for these names, and its key, both PEM.
///
/// # Errors
/// A name is none.
pub fn self_signed(names: &[String]) -> anyhow::Result<(String, String)> {
    let key = KeyPair::generate().context("no key can be made")?;
    let wrong = "a name is none: give host names and addresses, without scheme or port";
    let mut params = CertificateParams::new(names.to_vec()).context(wrong)?;
    let now = Clock::start().wall();
    params.not_before = (now - VALID_BEFORE).into();
    params.not_after = (now + VALID).into();
    params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
    params.distinguished_name = DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, names.first().map_or("telltale", String::as_str));
    let certificate = params.self_signed(&key).context(wrong)?;
    Ok((certificate.pem(), key.serialize_pem()))
}

/// Writes a file that only its owner may read, whatever the umask and an earlier file.
///
/// # Errors
/// Of the disk.
pub fn write_private(path: &Path, text: &str) -> anyhow::Result<()> {
    let context = || format!("{} cannot be written", path.display());
    let new = path.with_extension("pem.new");
    let mut options = std::fs::OpenOptions::new();
    options.write(true).create_new(true);
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    // One that an earlier run left behind may be anybody's.
    let _ = std::fs::remove_file(&new);
    let mut file = options.open(&new).with_context(context)?;
    give_to_owner_of(path.parent().unwrap_or(Path::new(".")), &file);
    file.write_all(text.as_bytes()).and_then(|()| file.sync_all()).with_context(context)?;
    std::fs::rename(&new, path).with_context(context)
}
