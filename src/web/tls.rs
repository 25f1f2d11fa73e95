//! The certificate and the key with which the server proves who it is. What is wrong with them is
//! said before anything listens.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use rustls::ServerConfig;
use rustls::pki_types::pem::{self, PemObject as _};
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use tokio_rustls::TlsAcceptor;
use webpki::{EndEntityCert, KeyUsage};

/// What the listener needs to speak TLS, 1.2 or newer.
#[derive(Clone)]
pub struct Tls {
    config: Arc<ServerConfig>,
    certificate: CertificateDer<'static>,
}

/// Why a certificate or its key cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TlsError {
    #[error("{} cannot be read: {reason}. Check the path and its permissions", path.display())]
    Unreadable { path: PathBuf, reason: String },
    #[error("{} holds no certificate. It must be PEM: -----BEGIN CERTIFICATE-----", path.display())]
    NoCertificate { path: PathBuf },
    #[error("{} holds no private key. It must be PEM and not encrypted: -----BEGIN PRIVATE KEY-----", path.display())]
    NoKey { path: PathBuf },
    #[error("{} is no certificate of a server: {reason}. Make one with `telltale tls self-signed`", path.display())]
    Wrong { path: PathBuf, reason: String },
    #[error("the certificate {} has expired, or the clock is wrong. Renew it; `telltale tls self-signed` makes one", path.display())]
    Expired { path: PathBuf },
    #[error("the certificate {} is not valid yet, or the clock is wrong", path.display())]
    NotYet { path: PathBuf },
    #[error("the key {} is not that of the certificate {}", key.display(), certificate.display())]
    Mismatch { certificate: PathBuf, key: PathBuf },
    #[error("the certificate does not name {0}, by which browsers are to reach the display. It names {1}")]
    Name(String, String),
}

impl Tls {
    /// Reads a chain of certificates, the server's first, and its key, both PEM.
    ///
    /// # Errors
    /// What is wrong with them, now.
    pub fn load(certificate: &Path, key: &Path, wall: SystemTime) -> Result<Tls, TlsError> {
        let chain = read_chain(certificate)?;
        let private = read_key(key)?;
        let Some((first, rest)) = chain.split_first() else {
            return Err(TlsError::NoCertificate { path: certificate.to_owned() });
        };
        check(first, rest, certificate, wall)?;
        let server = first.clone().into_owned();
        let wrong = |error: rustls::Error| match error {
            rustls::Error::InconsistentKeys(_) => {
                TlsError::Mismatch { certificate: certificate.to_owned(), key: key.to_owned() }
            }
            other => TlsError::Wrong { path: certificate.to_owned(), reason: other.to_string() },
        };
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let mut config = ServerConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .map_err(wrong)?
            .with_no_client_auth()
            .with_single_cert(chain, private)
            .map_err(wrong)?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(Tls { config: Arc::new(config), certificate: server })
    }

    /// Whether browsers that reach the server by this host name accept its certificate.
    ///
    /// # Errors
    /// If it is for other names.
    pub fn check_name(&self, host: &str) -> Result<(), TlsError> {
        let parsed = EndEntityCert::try_from(&self.certificate).ok();
        let bare = host.trim_start_matches('[').trim_end_matches(']');
        let named = parsed.as_ref().zip(ServerName::try_from(bare).ok());
        if named.is_some_and(|(parsed, name)| parsed.verify_is_valid_for_subject_name(&name).is_ok()) {
            return Ok(());
        }
        let names: Vec<&str> = parsed.iter().flat_map(|parsed| parsed.valid_dns_names()).collect();
        let names = if names.is_empty() { "no host".to_owned() } else { names.join(", ") };
        Err(TlsError::Name(host.to_owned(), names))
    }

    pub(super) fn acceptor(&self) -> TlsAcceptor {
        TlsAcceptor::from(self.config.clone())
    }
}

fn read_chain(path: &Path) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    let unreadable =
        |reason: pem::Error| TlsError::Unreadable { path: path.to_owned(), reason: words(&reason) };
    let certificates = CertificateDer::pem_file_iter(path).map_err(unreadable)?;
    certificates.collect::<Result<_, _>>().map_err(unreadable)
}

fn read_key(path: &Path) -> Result<PrivateKeyDer<'static>, TlsError> {
    PrivateKeyDer::from_pem_file(path).map_err(|reason| match reason {
        pem::Error::NoItemsFound => TlsError::NoKey { path: path.to_owned() },
        reason => TlsError::Unreadable { path: path.to_owned(), reason: words(&reason) },
    })
}

fn words(error: &pem::Error) -> String {
    match error {
        pem::Error::Io(error) => error.to_string(),
        other => other.to_string(),
    }
}

/// Judges the server's certificate by itself. Whoever signed it is for browsers to judge: an issuer
/// that this machine does not know is no fault.
fn check(
    certificate: &CertificateDer<'_>,
    chain: &[CertificateDer<'_>],
    path: &Path,
    wall: SystemTime,
) -> Result<(), TlsError> {
    let wrong = |reason: webpki::Error| TlsError::Wrong { path: path.to_owned(), reason: reason.to_string() };
    let parsed = EndEntityCert::try_from(certificate).map_err(wrong)?;
    let now = UnixTime::since_unix_epoch(wall.duration_since(UNIX_EPOCH).unwrap_or_default());
    let last = chain.last().unwrap_or(certificate);
    let anchors: Vec<_> = webpki::anchor_from_trusted_cert(last).into_iter().collect();
    let algorithms = rustls::crypto::ring::default_provider().signature_verification_algorithms.all;
    let usage = KeyUsage::server_auth();
    match parsed.verify_for_usage(algorithms, &anchors, chain, now, usage, None, None) {
        Ok(_) | Err(webpki::Error::UnknownIssuer | webpki::Error::CaUsedAsEndEntity) => Ok(()),
        Err(webpki::Error::CertExpired { .. }) => Err(TlsError::Expired { path: path.to_owned() }),
        Err(webpki::Error::CertNotValidYet { .. }) => Err(TlsError::NotYet { path: path.to_owned() }),
        Err(reason) => Err(wrong(reason)),
    }
}

impl std::fmt::Debug for Tls {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Tls(..)")
    }
}
