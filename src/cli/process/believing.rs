//! The certificates that a client here believes.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, bail};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject as _;
use rustls::{ClientConfig, RootCertStore};

/// A client that believes the certificates of a file, or of the system.
///
/// # Errors
/// No certificate can be read. `flag` names the file.
pub fn believing(ca: Option<&Path>, flag: &str) -> anyhow::Result<ClientConfig> {
    let mut roots = RootCertStore::empty();
    match ca {
        Some(file) => {
            let found = CertificateDer::pem_file_iter(file)
                .and_then(|found| found.collect::<Result<Vec<_>, _>>())
                .with_context(|| format!("{} cannot be read as PEM", file.display()))?;
            for certificate in found {
                roots
                    .add(certificate)
                    .with_context(|| format!("{} holds no usable certificate", file.display()))?;
            }
            if roots.is_empty() {
                bail!("{} holds no certificate. It must be PEM: -----BEGIN CERTIFICATE-----", file.display());
            }
        }
        None => {
            roots.add_parsable_certificates(rustls_native_certs::load_native_certs().certs);
            if roots.is_empty() {
                bail!("this system has no certificates to believe a server by: name some with {flag} FILE");
            }
        }
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions()?;
    Ok(builder.with_root_certificates(roots).with_no_client_auth())
}
