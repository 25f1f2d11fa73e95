//! Whether messages reach the pages: the whole way, from the engine over the frames to the connections. The
//! watchdog of systemd is fed only while they do.
//!
//! What a restart does not help is not asked for: no page may be open, DDS may be down, the disk may hang, a
//! display may be slow or not answer.

use axum::Router;
use axum::body::Body;
use axum::http::header::HOST;
use axum::http::{Request, StatusCode};
use tower::ServiceExt as _;

use super::AppState;
use super::router::router;
use crate::texts::Lang;
use telltale_engine::time::Span;

/// A page that nobody reads is closed after 5 s. A socket without a beat for longer hangs in the server.
const BEATLESS_MAX: Span = Span::from_secs(8);
/// The listener, and the watch over late displays, turn several times a second.
const IDLE_MAX: Span = Span::from_secs(5);

/// The part of the way on which nothing moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Stuck {
    #[error("the engine publishes nothing")]
    Engine,
    #[error("the vehicle is not listened to, or nothing is sent to it: the bridge hangs or has ended")]
    Bridge,
    #[error("no page can be made")]
    Frames,
    #[error("no connection is accepted")]
    Listener,
    #[error("requests are not answered")]
    Requests,
    #[error("the socket of a page gets nothing")]
    Socket,
    #[error("nobody watches whether the displays are live")]
    Displays,
    #[error("the way to the pages hangs")]
    Somewhere,
}

/// Tries the way to the pages. A hanging part lets it wait without end.
#[derive(Debug, Clone)]
pub struct SelfCheck {
    app: AppState,
    router: Router,
}

impl SelfCheck {
    pub fn new(app: AppState) -> SelfCheck {
        SelfCheck { router: router(app.clone()), app }
    }

    /// Waits until connections are accepted.
    pub async fn is_serving(&self) {
        self.app.listening.began().await;
    }

    /// Tries the way once.
    ///
    /// # Errors
    /// The first part that does not work.
    pub async fn run(&self) -> Result<(), Stuck> {
        let app = &self.app;
        if !app.is_source_alive() {
            return Err(Stuck::Engine);
        }
        if !app.is_bridge_working() {
            return Err(Stuck::Bridge);
        }
        let now = app.clock.now();
        if now.since(app.listening.last_waited()) > IDLE_MAX {
            return Err(Stuck::Listener);
        }
        // Frames are made under a lock, which nobody may hold without end: a thread of its own waits for it.
        let making = app.clone();
        let made = tokio::task::spawn_blocking(move || {
            let published = making.published();
            Lang::ALL.iter().all(|&lang| {
                making.frames.html(&published, lang, &making.trends).revision() >= published.revision()
            })
        });
        if !made.await.is_ok_and(|is_made| is_made) {
            return Err(Stuck::Frames);
        }
        // Without a connection: strangers can take its place, and a flood of theirs must end no server.
        let request = Request::get("/healthz")
            .header(HOST, app.settings.origins.own_host())
            .body(Body::empty())
            .map_err(|_| Stuck::Requests)?;
        match self.router.clone().oneshot(request).await {
            Ok(answer) if answer.status() == StatusCode::OK => {}
            _ => return Err(Stuck::Requests),
        }
        let progress = app.displays.progress();
        if progress.beat_oldest.is_some_and(|beat| now.since(beat) > BEATLESS_MAX) {
            return Err(Stuck::Socket);
        }
        match now.since(progress.watched) > IDLE_MAX {
            true => Err(Stuck::Displays),
            false => Ok(()),
        }
    }
}
