//! The certificate and the key of the server. Faults are reported before anything listens. An expired
//! certificate is used all the same: a display with a browser's warning is better than none. The files are
//! read again when they change.

use std::io::Read as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rustls::ServerConfig;
use rustls::pki_types::pem::{self, PemObject as _};
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use tokio_rustls::TlsAcceptor;
use webpki::{EndEntityCert, KeyUsage};

use telltale_clock::earliest;
use telltale_yaml::input_file;

/// A certificate is due for renewal this long before its end.
pub const RENEW_BEFORE: Duration = Duration::from_secs(30 * 24 * 3600);

/// A chain of certificates takes some kilobytes.
const PEM_BYTES_MAX: u64 = 1 << 20;

/// The settings with which the listener speaks TLS, 1.2 or newer. Clones share them.
#[derive(Clone)]
pub struct Tls(Arc<Files>);

struct Files {
    certificate: PathBuf,
    key: PathBuf,
    current: RwLock<Arc<Pair>>,
    /// The files as they were read last, valid or not.
    read: Mutex<[Stamp; 2]>,
}

/// A certificate that is used, with its chain.
struct Pair {
    config: Arc<ServerConfig>,
    chain: Vec<CertificateDer<'static>>,
}

/// The marks by which a change of a file is noticed: its inode, size and time of writing; `None` without a
/// file.
type Stamp = Option<(u64, u64, i64, i64)>;

/// Whether browsers take a certificate at some time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CertificateValidity {
    Good,
    /// It ends then, within [`RENEW_BEFORE`].
    EndsSoon(SystemTime),
    Ended(SystemTime),
    /// It begins then.
    NotYet(SystemTime),
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
    #[error("the key {} is not that of the certificate {}", key.display(), certificate.display())]
    Mismatch { certificate: PathBuf, key: PathBuf },
    #[error("the certificate does not name {0}, by which browsers are to reach the display. It names {1}")]
    Name(String, String),
}

impl Tls {
    /// Reads a chain of certificates, the server's first, and its key, both PEM.
    ///
    /// # Errors
    /// Their fault. An expired certificate is none: see [`Tls::validity`].
    pub fn load(certificate: &Path, key: &Path) -> Result<Tls, TlsError> {
        let read = Mutex::new([stamp(certificate), stamp(key)]);
        let current = RwLock::new(Arc::new(Pair::load(certificate, key)?));
        let (certificate, key) = (certificate.to_owned(), key.to_owned());
        Ok(Tls(Arc::new(Files { certificate, key, current, read })))
    }

    /// Takes a renewed certificate and its key for new connections, if the files have changed. It has to be
    /// for these hosts. Returns whether it was taken.
    ///
    /// # Errors
    /// The fault of the new one, once for each change: the old one stays.
    pub fn reload(&self, hosts: &[String]) -> Result<bool, TlsError> {
        let Files { certificate, key, current, read } = &*self.0;
        let now = [stamp(certificate), stamp(key)];
        if std::mem::replace(&mut *read.lock().unwrap_or_else(PoisonError::into_inner), now) == now {
            return Ok(false);
        }
        let pair = Pair::load(certificate, key)?;
        hosts.iter().try_for_each(|host| pair.check_name(host))?;
        *current.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(pair);
        Ok(true)
    }

    /// Whether browsers that reach the server by this host name accept its certificate.
    ///
    /// # Errors
    /// If it is for other names.
    pub fn check_name(&self, host: &str) -> Result<(), TlsError> {
        self.pair().check_name(host)
    }

    /// Whether it can be used at that time, and for how long.
    pub fn validity(&self, at: SystemTime) -> CertificateValidity {
        let pair = self.pair();
        match (verify(&pair.chain, at), verify(&pair.chain, at + RENEW_BEFORE)) {
            (Err(webpki::Error::CertExpired { not_after, .. }), _) => {
                CertificateValidity::Ended(time(not_after))
            }
            (Err(webpki::Error::CertNotValidYet { not_before, .. }), _) => {
                CertificateValidity::NotYet(time(not_before))
            }
            (_, Err(webpki::Error::CertExpired { not_after, .. })) => {
                CertificateValidity::EndsSoon(time(not_after))
            }
            _ => CertificateValidity::Good,
        }
    }

    pub fn path(&self) -> &Path {
        &self.0.certificate
    }

    pub(crate) fn acceptor(&self) -> TlsAcceptor {
        TlsAcceptor::from(self.pair().config.clone())
    }

    fn pair(&self) -> Arc<Pair> {
        self.0.current.read().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Pair {
    fn load(certificate: &Path, key: &Path) -> Result<Pair, TlsError> {
        let chain = read_chain(certificate)?;
        let private = read_key(key)?;
        if chain.is_empty() {
            return Err(TlsError::NoCertificate { path: certificate.to_owned() });
        }
        check(&chain, certificate)?;
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
            .with_single_cert(chain.clone(), private)
            .map_err(wrong)?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(Pair { config: Arc::new(config), chain })
    }

    fn check_name(&self, host: &str) -> Result<(), TlsError> {
        let parsed = self.chain.first().and_then(|first| EndEntityCert::try_from(first).ok());
        let bare = host.trim_start_matches('[').trim_end_matches(']');
        let named = parsed.as_ref().zip(ServerName::try_from(bare).ok());
        if named.is_some_and(|(parsed, name)| parsed.verify_is_valid_for_subject_name(&name).is_ok()) {
            return Ok(());
        }
        let names: Vec<&str> = parsed.iter().flat_map(|parsed| parsed.valid_dns_names()).collect();
        let names = if names.is_empty() { "no host".to_owned() } else { names.join(", ") };
        Err(TlsError::Name(host.to_owned(), names))
    }
}

fn stamp(path: &Path) -> Stamp {
    let file = std::fs::metadata(path).ok()?;
    Some((file.ino(), file.len(), file.mtime(), file.mtime_nsec()))
}

fn time(at: UnixTime) -> SystemTime {
    UNIX_EPOCH + Duration::from_secs(at.as_secs())
}

/// Of a regular file alone: a pipe would never answer, and the watch for renewed certificates would wait for it.
fn read_pem(path: &Path) -> Result<Vec<u8>, TlsError> {
    let mut text = Vec::new();
    let read = input_file::open(path).and_then(|file| file.take(PEM_BYTES_MAX + 1).read_to_end(&mut text));
    let reason = match read {
        Err(reason) => reason.to_string(),
        Ok(_) if text.len() as u64 > PEM_BYTES_MAX => {
            format!("it is larger than {} KiB", PEM_BYTES_MAX >> 10)
        }
        Ok(_) => return Ok(text),
    };
    Err(TlsError::Unreadable { path: path.to_owned(), reason })
}

fn read_chain(path: &Path) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    let unreadable =
        |reason: pem::Error| TlsError::Unreadable { path: path.to_owned(), reason: reason.to_string() };
    let text = read_pem(path)?;
    CertificateDer::pem_slice_iter(&text).collect::<Result<_, _>>().map_err(unreadable)
}

fn read_key(path: &Path) -> Result<PrivateKeyDer<'static>, TlsError> {
    PrivateKeyDer::from_pem_slice(&read_pem(path)?).map_err(|reason| match reason {
        pem::Error::NoItemsFound => TlsError::NoKey { path: path.to_owned() },
        reason => TlsError::Unreadable { path: path.to_owned(), reason: reason.to_string() },
    })
}

/// Judges the server's certificate by itself, whatever the clock says.
fn check(chain: &[CertificateDer<'_>], path: &Path) -> Result<(), TlsError> {
    match verify(chain, earliest()) {
        Ok(()) | Err(webpki::Error::CertExpired { .. } | webpki::Error::CertNotValidYet { .. }) => Ok(()),
        Err(reason) => Err(TlsError::Wrong { path: path.to_owned(), reason: reason.to_string() }),
    }
}

/// An unknown issuer is no fault: browsers judge that.
fn verify(chain: &[CertificateDer<'_>], at: SystemTime) -> Result<(), webpki::Error> {
    let Some((first, rest)) = chain.split_first() else { return Ok(()) };
    let parsed = EndEntityCert::try_from(first)?;
    let at = UnixTime::since_unix_epoch(at.duration_since(UNIX_EPOCH).unwrap_or_default());
    let anchors: Vec<_> =
        webpki::anchor_from_trusted_cert(rest.last().unwrap_or(first)).into_iter().collect();
    let algorithms = rustls::crypto::ring::default_provider().signature_verification_algorithms.all;
    let usage = KeyUsage::server_auth();
    match parsed.verify_for_usage(algorithms, &anchors, rest, at, usage, None, None) {
        Ok(_) | Err(webpki::Error::UnknownIssuer | webpki::Error::CaUsedAsEndEntity) => Ok(()),
        Err(reason) => Err(reason),
    }
}

impl std::fmt::Debug for Tls {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Tls(..)")
    }
}
