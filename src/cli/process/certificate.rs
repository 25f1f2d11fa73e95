//! Makes certificates that sign themselves.

use std::time::Duration;

use anyhow::Context as _;
use rcgen::{CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, KeyPair};

use crate::clock::Clock;

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
