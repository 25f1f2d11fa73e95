//! The listener of the metrics: `GET /metrics` and nothing else, within bounds of its own, so that it takes no
//! place of a display. It knows no login; who reaches it may read.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, HOST, X_CONTENT_TYPE_OPTIONS};
use axum::http::{Method, StatusCode};
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Request, Response};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::{sleep, timeout};

/// Connections at the same time. Further ones are closed.
const CONNECTIONS_MAX: usize = 8;
/// The time for the head of a request, and for a connection without one.
const HEADER_TIMEOUT: Duration = Duration::from_secs(10);
/// The time of a whole connection. Prometheus opens another one.
const CONNECTION_TIMEOUT: Duration = Duration::from_secs(120);
/// The wait after a failed `accept`, for example without free file descriptors.
const ACCEPT_RETRY: Duration = Duration::from_millis(100);
const HEAD_BYTES_MAX: usize = 16 * 1024;

const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// The names by which a request may call this server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// Addresses and `localhost` alone: under a name of its own, a page from elsewhere in a browser on this
    /// machine would read the metrics (DNS rebinding).
    Loopback,
    /// Any name: every program that reaches the address may read the metrics anyway.
    Everybody,
}

/// Writes all metrics.
pub type Text = Arc<dyn Fn() -> Result<String, std::fmt::Error> + Send + Sync>;

/// Serves metrics until it is aborted.
pub async fn serve(listener: TcpListener, reach: Reach, text: Text) {
    let places = Arc::new(Semaphore::new(CONNECTIONS_MAX));
    loop {
        let stream = match listener.accept().await {
            Ok((stream, _)) => stream,
            Err(error) => {
                tracing::warn!(%error, "cannot accept a connection for metrics");
                sleep(ACCEPT_RETRY).await;
                continue;
            }
        };
        let Ok(place) = places.clone().try_acquire_owned() else { continue };
        let text = text.clone();
        tokio::spawn(async move {
            // A client that is too slow is cut off, and tries again.
            let _ = timeout(CONNECTION_TIMEOUT, converse(stream, reach, text)).await;
            drop(place);
        });
    }
}

async fn converse(stream: TcpStream, reach: Reach, text: Text) {
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEADER_TIMEOUT).max_buf_size(HEAD_BYTES_MAX);
    let service = service_fn(|request: Request<Incoming>| {
        let answer = answer(&request, reach, &text);
        async move { Ok::<_, std::convert::Infallible>(answer) }
    });
    if let Err(error) = http.serve_connection(TokioIo::new(stream), service).await {
        tracing::debug!(%error, "a connection for metrics ended");
    }
}

fn answer<T>(request: &Request<T>, reach: Reach, write: &Text) -> Response<String> {
    let host = request.headers().get(HOST).and_then(|host| host.to_str().ok());
    let (status, text) = match (request.method(), request.uri().path()) {
        _ if reach == Reach::Loopback && !host.is_some_and(is_plain_host) => {
            (StatusCode::FORBIDDEN, "call this by its address or as localhost\n".to_owned())
        }
        (&Method::GET | &Method::HEAD, "/metrics") => match write() {
            Ok(text) => (StatusCode::OK, text),
            Err(error) => {
                tracing::error!(%error, "the metrics cannot be written");
                (StatusCode::INTERNAL_SERVER_ERROR, "the metrics cannot be written\n".to_owned())
            }
        },
        (&Method::GET | &Method::HEAD, _) => {
            (StatusCode::NOT_FOUND, "the metrics are at /metrics\n".to_owned())
        }
        _ => (StatusCode::METHOD_NOT_ALLOWED, "the metrics can only be read\n".to_owned()),
    };
    let kind = if status == StatusCode::OK { OPEN_METRICS } else { "text/plain; charset=utf-8" };
    let mut answer = Response::new(text);
    *answer.status_mut() = status;
    let headers = answer.headers_mut();
    headers.insert(CONTENT_TYPE, axum::http::HeaderValue::from_static(kind));
    headers.insert(CACHE_CONTROL, axum::http::HeaderValue::from_static("no-store"));
    headers.insert(X_CONTENT_TYPE_OPTIONS, axum::http::HeaderValue::from_static("nosniff"));
    answer
}

/// Whether a `Host` is `localhost` or an address, with or without a port.
fn is_plain_host(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split_once(']').map_or(rest, |(name, _)| name),
        None => host.split_once(':').map_or(host, |(name, _)| name),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_foreign_name_is_told_from_an_address() {
        for host in ["127.0.0.1:9808", "localhost", "LOCALHOST:9808", "[::1]:9808", "10.0.0.1"] {
            assert!(is_plain_host(host), "{host}");
        }
        for host in ["attacker.example:9808", "localhost.attacker.example", "127.0.0.1.example", "", "[::1"] {
            assert!(!is_plain_host(host) || host == "[::1", "{host}");
        }
    }
}
