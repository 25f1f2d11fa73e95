//! Readers: requests of accounts that do not drive. Their tables, pages and documents are made and compressed by
//! threads of low priority, and only a few at a time for one account: a stop never waits for them.

use std::collections::HashMap;
use std::num::NonZeroUsize;
use std::panic::resume_unwind;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use std::thread::available_parallelism;
use std::time::Duration;

use axum::body::to_bytes;
use axum::extract::{Request, State};
use axum::http::header::{CONTENT_ENCODING, RETRY_AFTER};
use axum::http::{HeaderValue, Method};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::task::JoinSet;
use tokio::time::timeout;

use super::guard::SignedIn;
use crate::AppState;
use crate::texts::HttpError;
use telltale_store::Role;

/// Requests of one account that are worked on at once. Others of it wait; its connections are their bound. A file that is
/// being read for a client that went away is read to its end without a place.
const AT_ONCE: usize = 2;
/// A request that waits longer is refused. The whole request has twice that time.
const WAITS: Duration = Duration::from_secs(5);
const TRY_AGAIN_AFTER_S: u16 = 1;
const NICENESS: i32 = 10;
/// Threads that read files for these requests.
const BLOCKING_MAX: usize = 8;

/// Threads of low priority, two where the machine can run two. `None` if the operating system gives none.
static THREADS: LazyLock<Option<Runtime>> = LazyLock::new(|| {
    let count = available_parallelism().map_or(1, NonZeroUsize::get).min(2);
    let threads = Builder::new_multi_thread()
        .worker_threads(count)
        .max_blocking_threads(BLOCKING_MAX)
        .thread_name("readers")
        .on_thread_start(lower_priority)
        .enable_all()
        .build();
    threads.inspect_err(|error| tracing::error!(%error, "no threads for readers")).ok()
});

/// From here on the threads that serve the vehicle and its operator go first. On Linux this changes the calling thread
/// alone; `nice` would add to what the thread inherited.
pub fn lower_priority() {
    let _ = rustix::process::setpriority_process(None, NICENESS);
}

/// The places of each account. An account without a request has no entry.
#[derive(Debug, Default)]
pub struct Readers(Mutex<HashMap<Arc<str>, Arc<Semaphore>>>);

impl Readers {
    /// A place for one request of this account, when it is its turn; `None` if that takes too long.
    async fn enter(&self, user: &Arc<str>) -> Option<OwnedSemaphorePermit> {
        let places = {
            let mut accounts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            // Each permit and each waiting request holds a reference.
            accounts.retain(|_, places| Arc::strong_count(places) > 1);
            accounts.entry(user.clone()).or_insert_with(|| Arc::new(Semaphore::new(AT_ONCE))).clone()
        };
        timeout(WAITS, places.acquire_owned()).await.ok()?.ok()
    }
}

/// The ends of the addresses of sockets. A header would not do: anybody can write one.
const SOCKETS: [&str; 3] = ["/ws", "/api/v1/stream", "/developer/live"];

/// Nobody waits to log in or out, or to learn whether the server is there: the browser of an operator may still have a
/// developer's cookie.
const NEVER_WAIT: [&str; 4] = ["/login", "/logout", "/readyz", "/healthz"];

/// Whether a request waits for its turn: all requests of accounts that do not drive, and a driver's reads over the
/// interface for programs. The requests of a driver's page never wait, nor do sockets.
fn waits(method: &Method, path: &str, role: Role) -> bool {
    let is_read = matches!(*method, Method::GET | Method::HEAD);
    let is_made = !SOCKETS.iter().any(|end| path.ends_with(end))
        && !path.starts_with("/static/")
        && !NEVER_WAIT.contains(&path);
    is_made && (role != Role::Operator || is_read && path.starts_with("/api/"))
}

/// The middleware inside the guard.
pub async fn apart(State(app): State<AppState>, request: Request, next: Next) -> Response {
    let session = request
        .extensions()
        .get::<SignedIn>()
        .filter(|SignedIn(it)| waits(request.method(), request.uri().path(), it.role));
    let session = session.map(|SignedIn(session)| session.clone());
    let (Some(session), Some(threads)) = (session, &*THREADS) else { return next.run(request).await };
    let Some(place) = app.readers.enter(&session.user).await else {
        let mut answer = HttpError::TooMany.into_response();
        answer.headers_mut().insert(RETRY_AFTER, HeaderValue::from(TRY_AGAIN_AFTER_S));
        return answer;
    };
    // It may have ended while the request waited.
    if !session.is_open() || app.has_expired(&session) {
        return HttpError::NoSession.into_response();
    }
    // Ends with this request, if nobody waits for the answer any longer.
    let mut work = JoinSet::new();
    let made = async move {
        let answer = whole(next.run(request).await).await;
        drop(place);
        answer
    };
    work.spawn_on(made, threads.handle());
    match work.join_next().await {
        Some(Ok(answer)) => answer,
        Some(Err(error)) if error.is_panic() => resume_unwind(error.into_panic()),
        // The threads end with the program.
        _ => HttpError::Unavailable.into_response(),
    }
}

/// Compresses an answer on this thread, before it is sent. An answer that is not compressed is passed on as it is.
async fn whole(answer: Response) -> Response {
    if !answer.headers().contains_key(CONTENT_ENCODING) {
        return answer;
    }
    let (parts, body) = answer.into_parts();
    // The body is made of data in memory.
    match to_bytes(body, usize::MAX).await {
        Ok(bytes) => Response::from_parts(parts, bytes.into()),
        Err(error) => {
            tracing::error!(%error, "an answer could not be compressed");
            HttpError::Unavailable.into_response()
        }
    }
}

#[cfg(test)]
mod tests {
    use futures_util::FutureExt as _;

    use super::*;

    #[tokio::test]
    async fn an_account_has_two_places_and_waits_for_nobody_else() {
        let (readers, anna, bert) = (Readers::default(), "anna".into(), "bert".into());
        let mut held = Vec::new();
        for _ in 0..AT_ONCE {
            held.push(readers.enter(&anna).now_or_never().flatten().expect("a place is free"));
        }
        let mut waits = std::pin::pin!(readers.enter(&anna));
        assert!(waits.as_mut().now_or_never().is_none());
        assert!(readers.enter(&bert).now_or_never().flatten().is_some(), "another account's places are free");
        held.pop();
        assert!(waits.now_or_never().flatten().is_some(), "a place is free again");
        held.clear();
        drop(readers.enter(&bert).await);
        assert!(readers.0.lock().unwrap().keys().eq([&bert]), "an account without a request is forgotten");
    }

    #[test]
    fn what_a_driver_does_and_sees_never_waits() {
        for (method, path, of_driver, of_others) in [
            (Method::POST, "/vehicle/stop", false, true),
            (Method::POST, "/api/v1/mark", false, true),
            (Method::GET, "/", false, true),
            (Method::GET, "/alarms/last", false, true),
            (Method::GET, "/static/page.js", false, false),
            (Method::GET, "/api/v1/openapi.json", true, true),
            (Method::GET, "/ws", false, false),
            (Method::GET, "/api/v1/stream", false, false),
            (Method::GET, "/replay/1/screen/ws", false, false),
            (Method::POST, "/login", false, false),
            (Method::POST, "/logout", false, false),
            (Method::GET, "/readyz", false, false),
        ] {
            assert_eq!(waits(&method, path, Role::Operator), of_driver, "{method} {path}");
            for role in [Role::Developer, Role::Authority] {
                assert_eq!(waits(&method, path, role), of_others, "{method} {path}");
            }
        }
    }
}
