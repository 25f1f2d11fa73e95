//! A server that speaks in place of a hub and says things without a bound.

use std::fs;
use std::sync::Arc;

use rustls::pki_types::PrivateKeyDer;
use telltale_fleet::identity::Identity;
use telltale_fleet::line::{Hub, Line, NoLine};
use telltale_fleet::message::VehicleId;
use tempfile::TempDir;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpListener;
use tokio_rustls::TlsAcceptor;

use crate::server::until;

const INFO: &[u8] =
    b"INFO {\"server_id\":\"x\",\"version\":\"2.14.0\",\"nonce\":\"x\",\"tls_required\":true,\"max_payload\":9}\r\n";

/// What a vehicle gets from a server that says this before TLS, and this after it.
pub async fn line_to(before: &'static [u8], after: &'static [u8]) -> Result<Line, NoLine> {
    let folder = TempDir::new().unwrap();
    let key = rcgen::KeyPair::generate().unwrap();
    let params = rcgen::CertificateParams::new(vec!["127.0.0.1".to_owned()]).unwrap();
    let certificate = params.self_signed(&key).unwrap();
    let ca = folder.path().join("ca.pem");
    fs::write(&ca, certificate.pem()).unwrap();
    let private = PrivateKeyDer::try_from(key.serialize_der()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = rustls::ServerConfig::builder_with_provider(provider).with_safe_default_protocol_versions();
    let config = config.unwrap().with_no_client_auth();
    let config = config.with_single_cert(vec![certificate.der().clone()], private).unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("tls://{}", listener.local_addr().unwrap());
    tokio::spawn(async move {
        let (mut stream, _) = listener.accept().await.unwrap();
        stream.write_all(if before.is_empty() { INFO } else { before }).await.unwrap();
        let Ok(mut stream) = TlsAcceptor::from(Arc::new(config)).accept(stream).await else { return };
        // The login ends with a PING.
        let mut heard = Vec::new();
        while !heard.ends_with(b"PING\r\n") {
            heard.push(stream.read_u8().await.unwrap());
        }
        stream.write_all(b"PONG\r\n").await.unwrap();
        while stream.write_all(after).await.is_ok() {}
    });
    let identity = Identity::make(&folder.path().join("a.nk")).unwrap();
    let id = VehicleId::new("a").unwrap();
    until("the line", Line::open(&Hub { url, ca }, &id, &identity)).await
}
