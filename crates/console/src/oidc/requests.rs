//! Requests to the issuer: few, small and soon over, so that an issuer that is ill takes nothing else with it.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::http::header::HOST;
use axum::http::{HeaderValue, Uri};
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use openidconnect::{AsyncHttpClient, HttpRequest, HttpResponse};
use rustls::ClientConfig;
use rustls::pki_types::ServerName;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio::time::timeout;
use tokio_rustls::TlsConnector;

/// Bytes of an answer's body and of its headers; a longer one is none.
const ANSWER_BYTES_MAX: usize = 256 << 10;
const HEADER_BYTES_MAX: usize = 64 << 10;

/// The time for a whole answer. A login makes three requests at most, within the time of one to the console.
const ANSWERED_WITHIN: Duration = Duration::from_secs(3);

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum NoAnswer {
    #[error("{0} is neither https:// nor on this machine")]
    Plain(String),
    #[error("{0} is no address")]
    Address(String),
    #[error("the issuer cannot be reached")]
    Io(#[from] io::Error),
    #[error("the issuer does not speak HTTP as it should")]
    Http(#[from] hyper::Error),
    #[error("its answer has more than {ANSWER_BYTES_MAX} bytes, or breaks off")]
    Body,
    #[error("it did not answer within {} s", ANSWERED_WITHIN.as_secs())]
    Late,
}

/// Makes the requests.
#[derive(Clone)]
pub struct Requests {
    tls: Option<TlsConnector>,
}

trait Stream: AsyncRead + AsyncWrite + Send + Unpin {}
impl<T: AsyncRead + AsyncWrite + Send + Unpin> Stream for T {}

/// Whether a host is this machine. Plain HTTP goes nowhere else.
pub fn is_here(host: &str) -> bool {
    let ip = host.trim_matches(['[', ']']).parse::<std::net::IpAddr>();
    host.eq_ignore_ascii_case("localhost") || ip.is_ok_and(|ip| ip.is_loopback())
}

impl Requests {
    /// `tls`: with the certificates that are believed; not needed for an issuer on this machine.
    pub fn new(tls: Option<Arc<ClientConfig>>) -> Requests {
        Requests { tls: tls.map(TlsConnector::from) }
    }

    async fn answer(&self, request: HttpRequest) -> Result<HttpResponse, NoAnswer> {
        let address = request.uri().clone();
        let wrong = || NoAnswer::Address(address.to_string());
        let authority = address.authority().ok_or_else(wrong)?;
        let stream = self.connect(&address).await?;
        let mut options = http1::Builder::new();
        options.max_buf_size(HEADER_BYTES_MAX);
        let (mut sender, connection) = options.handshake(TokioIo::new(stream)).await?;
        // Aborted with the end of this request.
        let mut tasks = JoinSet::new();
        tasks.spawn(connection);
        let (mut parts, body) = request.into_parts();
        parts.uri = address
            .path_and_query()
            .map_or(Ok(Uri::from_static("/")), |it| Uri::try_from(it.as_str()))
            .map_err(|_| wrong())?;
        parts.headers.insert(HOST, HeaderValue::from_str(authority.as_str()).map_err(|_| wrong())?);
        let request = axum::http::Request::from_parts(parts, Body::from(body));
        let (parts, body) = sender.send_request(request).await?.into_parts();
        let body = to_bytes(Body::new(body), ANSWER_BYTES_MAX).await.map_err(|_| NoAnswer::Body)?;
        Ok(HttpResponse::from_parts(parts, body.to_vec()))
    }

    async fn connect(&self, address: &Uri) -> Result<Box<dyn Stream>, NoAnswer> {
        let host = address.host().unwrap_or_default().trim_matches(['[', ']']);
        let is_secure = address.scheme_str() == Some("https");
        let port = address.port_u16().unwrap_or(if is_secure { 443 } else { 80 });
        let tls = self.tls.as_ref().filter(|_| is_secure);
        if tls.is_none() && (is_secure || !is_here(host)) {
            return Err(NoAnswer::Plain(format!("{}://{host}", address.scheme_str().unwrap_or_default())));
        }
        let stream = TcpStream::connect((host, port)).await?;
        let Some(tls) = tls else { return Ok(Box::new(stream)) };
        let name = ServerName::try_from(host.to_owned()).map_err(|_| NoAnswer::Address(host.to_owned()))?;
        Ok(Box::new(tls.connect(name, stream).await?))
    }
}

impl<'c> AsyncHttpClient<'c> for Requests {
    type Error = NoAnswer;
    type Future = Pin<Box<dyn Future<Output = Result<HttpResponse, NoAnswer>> + Send + 'c>>;

    fn call(&'c self, request: HttpRequest) -> Self::Future {
        let answer = timeout(ANSWERED_WITHIN, self.answer(request));
        Box::pin(async { answer.await.map_err(|_| NoAnswer::Late)? })
    }
}

impl std::fmt::Debug for Requests {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Requests")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcgen::{CertifiedKey, KeyPair, generate_simple_self_signed};
    use rustls::pki_types::PrivatePkcs8KeyDer;
    use rustls::{RootCertStore, ServerConfig};
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
    use tokio::net::TcpListener;
    use tokio_rustls::TlsAcceptor;

    fn made() -> CertifiedKey<KeyPair> {
        generate_simple_self_signed(["localhost".to_owned()]).unwrap()
    }

    /// A client that believes this certificate.
    fn believing(made: &CertifiedKey<KeyPair>) -> Requests {
        let mut roots = RootCertStore::empty();
        roots.add(made.cert.der().clone()).unwrap();
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let builder = ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions();
        Requests::new(Some(Arc::new(builder.unwrap().with_root_certificates(roots).with_no_client_auth())))
    }

    /// A server over TLS that gives this answer to each request for its address. Returns its port.
    async fn serve(made: &CertifiedKey<KeyPair>, answer: String) -> u16 {
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let builder = ServerConfig::builder_with_provider(provider).with_safe_default_protocol_versions();
        let key = PrivatePkcs8KeyDer::from(made.signing_key.serialize_der());
        let config = builder
            .unwrap()
            .with_no_client_auth()
            .with_single_cert(vec![made.cert.der().clone()], key.into());
        let (tls, listener) =
            (TlsAcceptor::from(Arc::new(config.unwrap())), TcpListener::bind("127.0.0.1:0"));
        let listener = listener.await.unwrap();
        let port = listener.local_addr().unwrap().port();
        tokio::spawn(async move {
            while let Ok((stream, _)) = listener.accept().await {
                let Ok(mut stream) = tls.accept(stream).await else { continue };
                let mut request = vec![0; 4096];
                let read = stream.read(&mut request).await.unwrap();
                let request = String::from_utf8_lossy(&request[..read]).into_owned();
                assert!(request.starts_with("GET /keys?a=b HTTP/1.1\r\n"), "{request}");
                assert!(request.contains(&format!("host: localhost:{port}\r\n")), "{request}");
                let _ = stream.write_all(answer.as_bytes()).await;
            }
        });
        port
    }

    async fn get(requests: &Requests, address: &str) -> Result<String, NoAnswer> {
        let request = axum::http::Request::get(address).body(Vec::new()).unwrap();
        requests.call(request).await.map(|it| String::from_utf8(it.into_body()).unwrap())
    }

    #[tokio::test]
    async fn an_issuer_is_believed_by_its_certificate_and_its_answers_have_bounds() {
        let (own, other) = (made(), made());
        let said = |more: &str, body: &str| {
            format!("HTTP/1.1 200 OK\r\n{more}content-length: {}\r\n\r\n{body}", body.len())
        };
        let ask = async |answer: String, client: &Requests| {
            let port = serve(&own, answer).await;
            get(client, &format!("https://localhost:{port}/keys?a=b")).await
        };
        assert_eq!(ask(said("", "hello"), &believing(&own)).await.unwrap(), "hello");
        assert!(matches!(ask(said("", "hello"), &believing(&other)).await, Err(NoAnswer::Io(_))));
        assert!(matches!(ask(said("", "hello"), &Requests::new(None)).await, Err(NoAnswer::Plain(_))));
        let large = said(&format!("a: {}\r\n", "a".repeat(4 * HEADER_BYTES_MAX)), "");
        assert!(matches!(ask(large, &believing(&own)).await, Err(NoAnswer::Http(_))));
        let large = said("", &"a".repeat(ANSWER_BYTES_MAX + 1));
        assert!(matches!(ask(large, &believing(&own)).await, Err(NoAnswer::Body)));
        let cut = "HTTP/1.1 200 OK\r\ncontent-length: 9\r\n\r\na".to_owned();
        assert!(matches!(ask(cut, &believing(&own)).await, Err(NoAnswer::Body)));
        for address in ["http://id.example/keys", "http://localhost.example/keys", "ftp://id.example/keys"] {
            assert!(matches!(get(&believing(&own), address).await, Err(NoAnswer::Plain(_))), "{address}");
        }
    }
}
