//! The listener: connections in, within bounds, until the server is told to end.

use std::collections::HashMap;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::{Extension, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

use super::login::Peer;
use super::router::router;
use super::seat;
use super::state::{AppState, turned};
use super::trends;

const CONNECTIONS_MAX: usize = 512;
/// One source must not take all places. The vehicle's own display is not counted.
const CONNECTIONS_PER_SOURCE_MAX: usize = 64;
/// For the head of a request, and for a connection that asks nothing.
const HEADER_TIMEOUT: Duration = Duration::from_secs(10);
/// Requests that run when the server ends may take this long.
const DRAIN_TIMEOUT: Duration = Duration::from_secs(3);
/// Without free file descriptors accepting fails until some are free.
const ACCEPT_RETRY: Duration = Duration::from_millis(100);

/// Serves until `shutdown` ends, then closes sockets with the code for a restart and lets
/// requests that run come to their end.
///
/// # Errors
/// If the listener has no address.
pub async fn serve(
    listener: TcpListener,
    app: AppState,
    shutdown: impl Future<Output = ()>,
) -> io::Result<()> {
    let address = listener.local_addr()?;
    if address.ip().is_unspecified() {
        tracing::warn!(%address, "listening on all addresses, known by the loopback names and configured origins only");
    }
    let service = router(app.clone());
    let sources = Sources::default();
    let mut connections = JoinSet::new();
    let seat = tokio::spawn(seat::watch(app.clone()));
    let trends = tokio::spawn(trends::watch(app.clone()));
    let mut shutdown = pin!(shutdown);
    loop {
        let has_room = connections.len() < CONNECTIONS_MAX;
        tokio::select! {
            () = &mut shutdown => break,
            accepted = listener.accept(), if has_room => match accepted {
                Ok((stream, peer)) => {
                    if let Some(place) = sources.enter(peer.ip()) {
                        connections.spawn(converse(stream, peer, service.clone(), app.closing.subscribe(), place));
                    }
                }
                Err(error) => {
                    tracing::warn!(%error, "cannot accept a connection");
                    sleep(ACCEPT_RETRY).await;
                }
            },
            Some(_) = connections.join_next(), if !connections.is_empty() => {}
        }
    }
    drop(listener);
    seat.abort();
    trends.abort();
    app.closing.send_replace(true);
    let drained = async {
        app.displays.all_gone().await;
        while connections.join_next().await.is_some() {}
    };
    if timeout(DRAIN_TIMEOUT, drained).await.is_err() {
        tracing::warn!("some connections did not end in time");
    }
    Ok(())
}

async fn converse(
    stream: TcpStream,
    peer: SocketAddr,
    service: Router,
    mut closing: watch::Receiver<bool>,
    _place: SourcePlace,
) {
    // A frame is one small write: it must not wait for an acknowledgement of the one before.
    if stream.set_nodelay(true).is_err() {
        return;
    }
    let service = TowerToHyperService::new(service.layer(Extension(Peer(peer))));
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEADER_TIMEOUT).max_buf_size(64 * 1024);
    let mut connection = pin!(http.serve_connection(TokioIo::new(stream), service).with_upgrades());
    let ended = tokio::select! {
        ended = &mut connection => ended,
        () = turned(&mut closing) => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = ended {
        tracing::debug!(%error, %peer, "connection ended");
    }
}

/// How many connections each source has. Bounded by [`CONNECTIONS_MAX`].
#[derive(Debug, Default, Clone)]
struct Sources(Arc<Mutex<HashMap<IpAddr, usize>>>);

struct SourcePlace {
    sources: Sources,
    source: IpAddr,
}

impl Sources {
    fn enter(&self, source: IpAddr) -> Option<SourcePlace> {
        let source = source.to_canonical();
        let mut counts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let count = counts.entry(source).or_default();
        if *count >= CONNECTIONS_PER_SOURCE_MAX && !source.is_loopback() {
            return None;
        }
        *count += 1;
        Some(SourcePlace { sources: self.clone(), source })
    }
}

impl Drop for SourcePlace {
    fn drop(&mut self) {
        let mut counts = self.sources.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(count) = counts.get_mut(&self.source) {
            *count -= 1;
            if *count == 0 {
                counts.remove(&self.source);
            }
        }
    }
}
