//! The server that `watch` talks to: its address, TLS, and the login.

use std::fmt;
use std::path::Path;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, bail};
use axum::body::{Body, to_bytes};
use axum::http::header::{ACCEPT, AUTHORIZATION, CONTENT_TYPE, COOKIE, HOST, ORIGIN, SET_COOKIE};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, Request, Response, StatusCode, Uri};
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use rustls::pki_types::ServerName;
use serde_json::Value;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_rustls::TlsConnector;

use super::Usage;
use crate::cli::process::believing::believing;
use crate::store::Role;
use crate::web::cookie_name;
use crate::web::texts::{MESSAGE, clean};

const CONNECT_WITHIN: Duration = Duration::from_secs(2);
/// A login hashes its secret, and may wait for others.
const ANSWER_WITHIN: Duration = Duration::from_secs(10);
const ANSWER_BYTES_MAX: usize = 64 * 1024;

/// The address of a server: scheme, host and port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerUrl {
    is_secure: bool,
    host: String,
    port: u16,
    /// As it was given.
    authority: String,
}

impl FromStr for ServerUrl {
    type Err = String;

    fn from_str(text: &str) -> Result<ServerUrl, String> {
        let wrong =
            || format!("`{text}` is no address of a display: write for example http://127.0.0.1:8080");
        let url: Uri = text.parse().map_err(|_| wrong())?;
        let is_secure = match url.scheme_str() {
            Some("http") => false,
            Some("https") => true,
            _ => return Err(wrong()),
        };
        let authority = url.authority().filter(|it| !it.as_str().contains('@')).ok_or_else(wrong)?;
        if !matches!(url.path(), "" | "/") || url.query().is_some() {
            return Err(format!(
                "leave out what follows the address: {}",
                &text[..text.len() - url.path().len()]
            ));
        }
        let port = authority.port_u16().unwrap_or(if is_secure { 443 } else { 80 });
        let host = authority.host().trim_matches(['[', ']']).to_owned();
        Ok(ServerUrl { is_secure, host, port, authority: authority.as_str().to_owned() })
    }
}

impl fmt::Display for ServerUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}://{}", if self.is_secure { "https" } else { "http" }, self.authority)
    }
}

impl ServerUrl {
    fn is_local(&self) -> bool {
        let ip = self.host.parse::<std::net::IpAddr>();
        self.host.eq_ignore_ascii_case("localhost") || ip.is_ok_and(|ip| ip.is_loopback())
    }
}

/// How the server knows who asks.
#[derive(Debug)]
pub enum Credentials {
    Token(String),
    Login { name: String, secret: String },
}

/// What a request carries so that the server answers it.
#[derive(Debug, Clone)]
pub struct Session {
    headers: HeaderMap,
    /// The role of a login; a token's is not asked for.
    pub role: Option<Role>,
}

/// A connection with or without TLS.
pub trait Bytes: AsyncRead + AsyncWrite + Unpin + Send {}
impl<T: AsyncRead + AsyncWrite + Unpin + Send> Bytes for T {}
pub type Stream = Box<dyn Bytes>;

pub struct Server {
    pub url: ServerUrl,
    tls: Option<(TlsConnector, ServerName<'static>)>,
}

impl Server {
    /// A server with the certificates by which it is believed.
    ///
    /// # Errors
    /// What is wrong with them, or that plain HTTP would leave this machine.
    pub fn new(url: ServerUrl, ca: Option<&Path>, insecure: bool) -> anyhow::Result<Server> {
        if !url.is_secure && !url.is_local() && !insecure {
            bail!(
                "{url} is beyond this machine, and plain HTTP shows the secret to everybody on the way: use https, \
                 or ask for it by name with --insecure-http"
            );
        }
        let tls = match url.is_secure {
            true => {
                let name =
                    ServerName::try_from(url.host.clone()).with_context(|| format!("{url} names no host"))?;
                Some((TlsConnector::from(Arc::new(believing(ca, "--ca")?)), name))
            }
            false => None,
        };
        Ok(Server { url, tls })
    }

    /// Logs in, or takes the token.
    ///
    /// # Errors
    /// If the server cannot be reached or refuses.
    pub async fn enter(&self, credentials: Credentials) -> anyhow::Result<Session> {
        match credentials {
            Credentials::Token(token) => {
                let value = HeaderValue::try_from(format!("Bearer {token}"));
                let mut value =
                    value.map_err(|_| Usage("the token holds characters that no token has".to_owned()))?;
                value.set_sensitive(true);
                Ok(Session { headers: HeaderMap::from_iter([(AUTHORIZATION, value)]), role: None })
            }
            Credentials::Login { name, secret } => self.log_in(&name, &secret).await,
        }
    }

    async fn log_in(&self, name: &str, secret: &str) -> anyhow::Result<Session> {
        let form = format!("name={}&secret={}", encoded(name), encoded(secret));
        let headers = HeaderMap::from_iter([self.origin()?]);
        let answer = timeout(ANSWER_WITHIN, self.post("/login", form, &headers));
        let answer = answer.await.context("the server does not answer the login")??;
        let (parts, body) = answer.into_parts();
        let body = to_bytes(body, ANSWER_BYTES_MAX).await.context("the answer to the login breaks off")?;
        let said: Value = serde_json::from_slice(&body).unwrap_or_default();
        if parts.status != StatusCode::OK {
            bail!("the login is refused: {}", refusal(parts.status, &said));
        }
        let cookie =
            session_cookie(&parts.headers).context("the server opened no session: is it a telltale?")?;
        let mut cookie =
            HeaderValue::try_from(cookie).context("the session of the server cannot be sent back")?;
        cookie.set_sensitive(true);
        let headers = HeaderMap::from_iter([(COOKIE, cookie), self.origin()?]);
        let role = said["role"].as_str().and_then(Role::from_word);
        Ok(Session { headers, role })
    }

    /// Ends a login. An operator's goes on: its end can lock the vehicle.
    pub async fn leave(&self, session: &Session) {
        if matches!(session.role, Some(Role::Developer | Role::Authority)) {
            // The session ends by itself too.
            let _ = timeout(CONNECT_WITHIN, self.post("/logout", String::new(), &session.headers)).await;
        }
    }

    async fn post(&self, path: &str, form: String, headers: &HeaderMap) -> anyhow::Result<Response<Body>> {
        let (mut sender, connection) = http1::handshake(TokioIo::new(self.connect().await?)).await?;
        tokio::spawn(connection);
        let request = Request::builder()
            .method(Method::POST)
            .uri(path)
            .header(HOST, &self.url.authority)
            .header(ACCEPT, "application/json")
            .header(CONTENT_TYPE, "application/x-www-form-urlencoded");
        let mut request = request.body(form)?;
        request.headers_mut().extend(headers.clone());
        Ok(sender.send_request(request).await?.map(Body::new))
    }

    /// The request that opens the stream.
    ///
    /// # Errors
    /// If the address cannot stand in a request.
    pub fn stream_request(&self, session: &Session, query: &str) -> anyhow::Result<Request<()>> {
        use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
        let scheme = if self.url.is_secure { "wss" } else { "ws" };
        let mut request =
            format!("{scheme}://{}/api/v1/stream{query}", self.url.authority).into_client_request()?;
        request.headers_mut().extend(session.headers.clone());
        Ok(request)
    }

    /// Connects, with TLS if the address says so.
    ///
    /// # Errors
    /// If the server cannot be reached, or its certificate is not believed.
    pub async fn connect(&self) -> anyhow::Result<Stream> {
        let reaching = TcpStream::connect((self.url.host.as_str(), self.url.port));
        let stream = timeout(CONNECT_WITHIN, reaching).await;
        let stream = stream.with_context(|| format!("{} does not answer", self.url))?;
        let stream = stream.with_context(|| format!("{} cannot be reached", self.url))?;
        stream.set_nodelay(true)?;
        let Some((connector, name)) = &self.tls else { return Ok(Box::new(stream)) };
        let secured = timeout(CONNECT_WITHIN, connector.connect(name.clone(), stream)).await;
        let secured = secured.with_context(|| format!("{} does not speak TLS in time", self.url))?;
        Ok(Box::new(secured.with_context(|| {
            format!("the certificate of {} is not believed; --ca FILE names one to believe", self.url)
        })?))
    }

    fn origin(&self) -> anyhow::Result<(HeaderName, HeaderValue)> {
        Ok((ORIGIN, HeaderValue::try_from(self.url.to_string())?))
    }
}

/// The `name=value` of the session's cookie.
fn session_cookie(headers: &HeaderMap) -> Option<String> {
    let cookies = headers.get_all(SET_COOKIE).iter().filter_map(|it| it.to_str().ok());
    let mut pairs = cookies.filter_map(|cookie| cookie.split(';').next());
    let is_session = |pair: &&str| {
        pair.split_once('=').is_some_and(|(name, _)| [true, false].map(cookie_name).contains(&name))
    };
    pairs.find(is_session).map(str::to_owned)
}

/// Why the server refuses, in its words.
fn refusal(status: StatusCode, said: &Value) -> String {
    let reasons = said["refused"]
        .as_array()
        .map(|all| all.iter().filter_map(Value::as_str).collect::<Vec<_>>().join("; "));
    let error = said["error"].as_str().map(str::to_owned);
    let wait = said["seconds"].as_u64().map_or(String::new(), |seconds| format!(", wait {seconds} s"));
    let words = reasons.or(error).unwrap_or_default();
    format!("{}{wait} ({status})", clean(&words, MESSAGE))
}

/// A value of a form.
fn encoded(text: &str) -> String {
    let mut form = String::with_capacity(text.len());
    for byte in text.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' => form.push(char::from(byte)),
            byte => form.push_str(&format!("%{byte:02X}")),
        }
    }
    form
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_taken_apart() {
        let read =
            |text: &str| text.parse::<ServerUrl>().map(|url| (url.is_secure, url.host.clone(), url.port));
        assert_eq!(read("http://127.0.0.1:8080"), Ok((false, "127.0.0.1".to_owned(), 8080)));
        assert_eq!(read("https://shuttle-1.example/"), Ok((true, "shuttle-1.example".to_owned(), 443)));
        assert_eq!(read("http://[::1]:80"), Ok((false, "::1".to_owned(), 80)));
        for wrong in ["127.0.0.1:8080", "ftp://a", "http://", "http://a@b", "here"] {
            assert!(read(wrong).unwrap_err().contains("http://127.0.0.1:8080"), "{wrong}");
        }
        assert!(read("http://a:1/login").unwrap_err().ends_with("http://a:1"));
    }

    #[test]
    fn a_secret_with_any_letter_stays_one_value() {
        assert_eq!(encoded("a b&c=d+ü%"), "a%20b%26c%3Dd%2B%C3%BC%25");
    }
}
