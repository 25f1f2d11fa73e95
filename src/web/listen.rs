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
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

use super::login::Peer;
use super::router::router;
use super::state::{AppState, turned};
use super::tls::Tls;
use super::{displays, keep, seat, trends};

const CONNECTIONS_MAX: usize = 512;
/// One source must not take all places. The vehicle's own display is not counted.
const CONNECTIONS_PER_SOURCE_MAX: usize = 64;
/// For the head of a request, and for a connection that asks nothing.
const HEADER_TIMEOUT: Duration = Duration::from_secs(10);
/// What the kernel may hold of an answer that nobody reads; it doubles the figure that it is given.
const SEND_BUFFER_BYTES: usize = 256 * 1024;
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
    tls: Option<Tls>,
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
    let watches = [
        tokio::spawn(seat::watch(app.clone())),
        tokio::spawn(keep::follow(app.clone())),
        tokio::spawn(displays::watch(app.clone())),
        tokio::spawn(trends::watch(app.clone())),
    ];
    let mut shutdown = pin!(shutdown);
    loop {
        let has_room = connections.len() < CONNECTIONS_MAX;
        tokio::select! {
            () = &mut shutdown => break,
            accepted = listener.accept(), if has_room => match accepted {
                Ok((stream, peer)) => {
                    if let Some(place) = sources.enter(peer.ip()) {
                        let service = service.clone().layer(Extension(Peer(peer)));
                        let line = Line { peer, service, closing: app.closing.subscribe(), _place: place };
                        connections.spawn(line.open(stream, tls.clone()));
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
    watches.iter().for_each(tokio::task::JoinHandle::abort);
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

/// One connection.
struct Line {
    peer: SocketAddr,
    service: Router,
    closing: watch::Receiver<bool>,
    _place: SourcePlace,
}

impl Line {
    async fn open(self, stream: TcpStream, tls: Option<Tls>) {
        // A frame is one small write: it must not wait for an acknowledgement of the one before.
        let prepared = stream.set_nodelay(true).is_ok()
            && rustix::net::sockopt::set_socket_send_buffer_size(&stream, SEND_BUFFER_BYTES).is_ok();
        if !prepared {
            return;
        }
        let Some(tls) = tls else { return self.converse(stream).await };
        match timeout(HEADER_TIMEOUT, tls.acceptor().accept(stream)).await {
            Ok(Ok(stream)) => self.converse(stream).await,
            Ok(Err(error)) => tracing::debug!(%error, peer = %self.peer, "no TLS connection"),
            Err(_) => tracing::debug!(peer = %self.peer, "no TLS connection in time"),
        }
    }

    async fn converse(mut self, stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static) {
        let mut http = http1::Builder::new();
        http.timer(TokioTimer::new()).header_read_timeout(HEADER_TIMEOUT).max_buf_size(64 * 1024);
        let service = TowerToHyperService::new(self.service);
        let mut connection = pin!(http.serve_connection(TokioIo::new(stream), service).with_upgrades());
        let ended = tokio::select! {
            ended = &mut connection => ended,
            () = turned(&mut self.closing) => {
                connection.as_mut().graceful_shutdown();
                connection.await
            }
        };
        if let Err(error) = ended {
            tracing::debug!(%error, peer = %self.peer, "connection ended");
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_source_does_not_take_all_places_and_the_vehicles_own_display_is_not_counted() {
        let sources = Sources::default();
        let stranger: IpAddr = "10.0.0.66".parse().unwrap();
        let mut places: Vec<_> = (0..CONNECTIONS_PER_SOURCE_MAX).map(|_| sources.enter(stranger)).collect();
        assert!(places.iter().all(Option::is_some));
        assert!(sources.enter(stranger).is_none());
        assert!(sources.enter("::ffff:10.0.0.66".parse().unwrap()).is_none(), "the same one");
        assert!(sources.enter("10.0.0.67".parse().unwrap()).is_some());
        let local: Vec<_> = (0..CONNECTIONS_MAX).map(|_| sources.enter([127, 0, 0, 1].into())).collect();
        assert!(local.iter().all(Option::is_some));
        places.pop();
        assert!(sources.enter(stranger).is_some(), "a place is free again");
        drop((places, local));
        assert!(sources.0.lock().unwrap().is_empty(), "nothing is kept of who has gone");
    }
}
