//! The listener: accepts connections, within bounds, until the server ends.

use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::time::{Duration, Instant};

use axum::Router;
use hyper::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval, sleep, timeout, timeout_at};
use tower::ServiceExt as _;

use super::tls::Tls;
use crate::admission::connections::{ConnectionPlace, Connections};
use crate::admission::peer::Peer;
use crate::admission::vehicle_displays::{Enrolled, VehicleDisplay};
use crate::auth::expiry;
use crate::live::byte_budget::{Meter, Metered};
use crate::live::{displays, first_changes, sample_trends};
use crate::router::router;
use crate::vehicle_memory::VehicleMemoryTask;
use crate::{AppState, turned};
use telltale_clock::Clock;
use telltale_engine::time::Timestamp;

/// The time for the head of a request, and for a connection without a request.
const HEADER_TIMEOUT: Duration = Duration::from_secs(10);
/// The kernel's buffer for answers that a client does not read. The kernel doubles this number.
const SEND_BUFFER_BYTES: usize = 256 * 1024;
/// The kernel's buffer for received bytes that are not read yet. A request has at most 16 KiB.
const RECEIVE_BUFFER_BYTES: usize = 32 * 1024;
/// Running requests have this long to end, once the end was requested.
const DRAINED_WITHIN: Duration = Duration::from_millis(800);
/// The last state of the vehicle is stored within this time of the same request, or not at all.
const STORED_WITHIN: Duration = Duration::from_millis(1400);
/// The listener notes this often that it still accepts.
const NOTE_EVERY: Duration = Duration::from_millis(250);
/// The wait after a failed `accept`, for example without free file descriptors.
const ACCEPT_RETRY: Duration = Duration::from_millis(100);

/// The state of the listener.
#[derive(Debug)]
pub struct Listening {
    /// When it last waited for a connection.
    waited: watch::Sender<Timestamp>,
    /// Turns true when the server ends.
    closing: watch::Sender<bool>,
}

impl Default for Listening {
    fn default() -> Listening {
        Listening { waited: watch::channel(Timestamp::ZERO).0, closing: watch::channel(false).0 }
    }
}

impl Listening {
    fn waits(&self, now: Timestamp) {
        self.waited.send_replace(now);
    }

    fn close(&self) {
        self.closing.send_replace(true);
    }

    /// Waits until connections are accepted.
    pub async fn began(&self) {
        // The sender lives as long as `self`.
        let _ = self.waited.subscribe().wait_for(|waited| *waited > Timestamp::ZERO).await;
    }

    /// When it last waited for a connection.
    pub fn last_waited(&self) -> Timestamp {
        *self.waited.borrow()
    }

    /// Turns true when the server ends, for [`turned`].
    pub fn closing(&self) -> watch::Receiver<bool> {
        self.closing.subscribe()
    }
}

/// Serves until `shutdown` ends, and returns what it returned: the instant at which the end was requested. Then it
/// closes sockets with the code for a restart, waits for running requests, and stores the last state of the
/// vehicle. Both have their time from that instant on.
///
/// # Errors
/// If the listener has no address.
pub async fn serve(
    listener: TcpListener,
    tls: Option<Tls>,
    app: AppState,
    shutdown: impl Future<Output = Instant>,
) -> io::Result<Instant> {
    let address = listener.local_addr()?;
    if address.ip().is_unspecified() {
        tracing::warn!(%address, "listening on all addresses, known by the loopback names and configured origins only");
    }
    let enrolled = &app.settings.enrolled;
    let accepting = Accepting {
        router: router(app.clone()),
        tls,
        places: &app.connections,
        enrolled,
        listening: &app.listening,
        clock: app.clock,
    };
    app.displays.note_watched(app.clock.now());
    // A replay has none of the tasks that command the engine or write to the store.
    let vehicle_memory_task = app.live().map(VehicleMemoryTask::start);
    let live_watches = app
        .live()
        .map(|live| [tokio::spawn(expiry::watch(live.clone())), tokio::spawn(displays::watch(live))]);
    let watches = [tokio::spawn(first_changes::watch(app.clone())), tokio::spawn(sample_trends(app.clone()))];
    let (requested, mut connections) = accepting.until(listener, shutdown).await;
    live_watches.iter().flatten().chain(&watches).for_each(tokio::task::JoinHandle::abort);
    app.listening.close();
    let drained = async {
        app.displays.all_gone().await;
        while connections.join_next().await.is_some() {}
    };
    if timeout_at((requested + DRAINED_WITHIN).into(), drained).await.is_err() {
        tracing::warn!("some connections did not end in time");
    }
    if let Some(task) = vehicle_memory_task {
        task.end(requested + STORED_WITHIN).await;
    }
    Ok(requested)
}

/// Serves another router than a vehicle's within the same bounds, for callers that are all elsewhere, until `shutdown`
/// ends, and returns what it returned.
pub async fn serve_router(
    listener: TcpListener,
    tls: Option<Tls>,
    router: Router,
    clock: Clock,
    shutdown: impl Future<Output = Instant>,
) -> Instant {
    let (places, listening) = (Connections::default(), Listening::default());
    let enrolled = Enrolled::new(vec![VehicleDisplay::None]);
    let accepting =
        Accepting { router, tls, places: &places, enrolled: &enrolled, listening: &listening, clock };
    let (requested, mut connections) = accepting.until(listener, shutdown).await;
    listening.close();
    let drained = async { while connections.join_next().await.is_some() {} };
    if timeout_at((requested + DRAINED_WITHIN).into(), drained).await.is_err() {
        tracing::warn!("some connections did not end in time");
    }
    requested
}

/// What accepts connections.
struct Accepting<'a> {
    router: Router,
    tls: Option<Tls>,
    places: &'a Connections,
    enrolled: &'a Enrolled,
    listening: &'a Listening,
    clock: Clock,
}

impl Accepting<'_> {
    /// Until the end is requested. Also returns the connections that are open then.
    async fn until(
        self,
        listener: TcpListener,
        shutdown: impl Future<Output = Instant>,
    ) -> (Instant, JoinSet<()>) {
        let mut connections = JoinSet::new();
        let mut notes = interval(NOTE_EVERY);
        notes.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut shutdown = pin!(shutdown);
        let requested = loop {
            tokio::select! {
                requested = &mut shutdown => break requested,
                accepted = listener.accept() => match accepted {
                    Ok((stream, peer)) => self.enter(stream, peer, &mut connections),
                    Err(error) => {
                        tracing::warn!(%error, "cannot accept a connection");
                        sleep(ACCEPT_RETRY).await;
                    }
                },
                Some(_) = connections.join_next(), if !connections.is_empty() => {}
                _ = notes.tick() => self.listening.waits(self.clock.now()),
            }
        };
        (requested, connections)
    }

    fn enter(&self, stream: TcpStream, peer: SocketAddr, connections: &mut JoinSet<()>) {
        let entered = match self.enrolled.is_proxy(peer.ip()) {
            true => self.places.enter_proxied(),
            false => self.places.enter(peer.ip(), self.enrolled.caller(peer.ip())),
        };
        let Some((place, gone)) = entered else { return };
        let (router, closing) = (self.router.clone(), self.listening.closing());
        let connection = HttpConnection { peer, router, closing, place };
        let open = connection.open(stream, self.tls.clone());
        connections.spawn(async move {
            tokio::select! {
                biased;
                _ = gone => tracing::debug!(%peer, "a silent connection gave its place to another"),
                () = open => {}
            }
        });
    }
}

/// One connection.
struct HttpConnection {
    peer: SocketAddr,
    router: Router,
    closing: watch::Receiver<bool>,
    place: ConnectionPlace,
}

impl HttpConnection {
    async fn open(self, stream: TcpStream, tls: Option<Tls>) {
        // A frame is one small write: it must not wait for an acknowledgement of the one before.
        let prepared = stream.set_nodelay(true).is_ok()
            && rustix::net::sockopt::set_socket_send_buffer_size(&stream, SEND_BUFFER_BYTES).is_ok()
            && rustix::net::sockopt::set_socket_recv_buffer_size(&stream, RECEIVE_BUFFER_BYTES).is_ok();
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
        let meter = Meter::default();
        let (reader, writer) = tokio::io::split(stream);
        let stream = tokio::io::join(Metered::new(reader, meter.clone()), writer);
        let service = service_fn(|mut request: Request<Incoming>| {
            request.extensions_mut().insert(Peer(self.peer));
            request.extensions_mut().insert(meter.clone());
            let (work, router) = (self.place.work(), self.router.clone());
            async move {
                // The connection that gave the place away ends before this does.
                let Some(work) = work else { return std::future::pending().await };
                request.extensions_mut().insert(work.handle());
                router.oneshot(request).await
            }
        });
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
