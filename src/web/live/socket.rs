//! The live connections: fragments for pages, snapshots for programs.
//!
//! Each connection holds at most the latest state and sends one message at a time, so a slow one skips
//! intermediate states and delays nobody. It ends at once with its session.

use std::net::IpAddr;
use std::time::Duration;

use axum::extract::rejection::QueryRejection;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message, Utf8Bytes, WebSocketUpgrade};
use axum::extract::{Extension, Query, State};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval, sleep};

use super::byte_budget::Meter;
use super::client::{Client, Ending};
use super::displays::Place;
use super::frame;
use super::pacing::Pacing;
use crate::runtime::Published;
use crate::store::audit::{Action, Record};
use crate::store::{Role, Session};
use crate::web::admission::peer::{Peer, source_of};
use crate::web::auth::handover::HandOver;
use crate::web::http::errors::HttpError;
use crate::web::http::guard::SignedIn;
use crate::web::http::respond::{Reader, refusal};
use crate::web::operator::actions::{StopForm, request_stop};
use crate::web::operator::tap::Tap;
use crate::web::view::Lang;
use crate::web::{AppState, turned};

/// The largest message that a client may send.
pub const INBOUND_BYTES_MAX: usize = 16 * 1024;
/// What is read of a socket at a time, so that one that sends without an end keeps nobody waiting.
const READ_BYTES: usize = 4 * 1024;
/// A page that hears nothing for 1 s says that it is not live.
const BEAT_EVERY: Duration = Duration::from_millis(250);
/// A ping goes out with every fourth beat.
const BEATS_PER_PING: u64 = 4;
/// What stands behind the tiles has more time.
const DETAILS_EVERY: Duration = Duration::from_millis(500);
/// Taps on STOP of one page that may wait for their answer.
const STOPS_AT_ONCE: usize = 4;

#[derive(Debug, Deserialize)]
pub struct PageQuery {
    lang: Option<String>,
}

/// `GET /ws`
pub async fn page(
    State(app): State<AppState>,
    from: From,
    SignedIn(session): SignedIn,
    reader: Reader,
    query: Result<Query<PageQuery>, QueryRejection>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let asked = query.ok().and_then(|Query(query)| query.lang);
    let lang = asked.as_deref().and_then(Lang::from_word).unwrap_or(reader.lang);
    open(app, from, session, &reader, upgrade, Feed::Page { lang, shown: None, details: 0 })
}

/// `GET /api/v1/stream`
pub async fn stream(
    State(app): State<AppState>,
    from: From,
    SignedIn(session): SignedIn,
    reader: Reader,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    open(app, from, session, &reader, upgrade, Feed::Snapshots)
}

/// `GET /developer/live`
pub async fn pulse(
    State(app): State<AppState>,
    from: From,
    SignedIn(session): SignedIn,
    reader: Reader,
    query: Result<Query<PageQuery>, QueryRejection>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let asked = query.ok().and_then(|Query(query)| query.lang);
    let lang = asked.as_deref().and_then(Lang::from_word).unwrap_or(reader.lang);
    open(app, from, session, &reader, upgrade, Feed::Pulse { lang })
}

/// The connection that is to become a socket.
type From = (Option<Extension<Peer>>, Option<Extension<Meter>>);

fn open(
    app: AppState,
    (peer, meter): From,
    session: Session,
    reader: &Reader,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
    feed: Feed,
) -> Response {
    let upgrade = match upgrade {
        Ok(upgrade) => upgrade,
        Err(rejection) => return rejection.into_response(),
    };
    let place = match feed {
        Feed::Snapshots => app.displays.enter_stream(&session),
        Feed::Page { .. } | Feed::Pulse { .. } => app.displays.enter(&session),
    };
    let Some(place) = place else { return refusal(reader, HttpError::TooManySockets) };
    app.session_ends.remember(&session);
    let meter = meter.map(|Extension(meter)| meter).unwrap_or_default();
    let over = meter.begin(&app.accounts, &session.user, app.clock);
    let source = source_of(peer.map(|Extension(peer)| peer));
    let upgrade = upgrade.max_message_size(INBOUND_BYTES_MAX).max_frame_size(INBOUND_BYTES_MAX);
    let upgrade = upgrade.read_buffer_size(READ_BYTES);
    upgrade.on_upgrade(move |socket| async move {
        let client = Client { socket, session, pings_unanswered: 0 };
        let stops = JoinSet::new();
        Connection { app, source, over, client, feed, place, seq: 0, beat: 0, stops }.run().await;
    })
}

/// What a connection carries.
#[derive(Debug)]
enum Feed {
    /// Fragments of the operator's page: `shown` is the revision that was sent last, and `details`
    /// that of what stands behind the tiles.
    Page { lang: Lang, shown: Option<u64>, details: u64 },
    /// Whole snapshots as JSON.
    Snapshots,
    /// Beats alone, which say what there is to ask for.
    Pulse { lang: Lang },
}

impl Feed {
    /// Programs get every snapshot that they keep up with.
    fn is_paced(&self) -> bool {
        matches!(self, Feed::Page { .. })
    }
}

struct Connection {
    app: AppState,
    source: IpAddr,
    /// Turns true once the client has sent too much.
    over: watch::Receiver<bool>,
    client: Client,
    feed: Feed,
    place: Place,
    /// Of the state that was sent last.
    seq: u64,
    /// The number of the beat that was sent last.
    beat: u64,
    /// Taps on STOP that are not answered yet.
    stops: JoinSet<Utf8Bytes>,
}

impl Connection {
    async fn run(mut self) {
        let ending = match self.serve().await {
            Ok(never) => match never {},
            Err(ending) => ending,
        };
        tracing::debug!(?ending, user = &*self.client.session.user, "socket closed");
        if ending == Ending::Flood {
            let record = Record::of_session(&self.client.session, Action::Request, self.source).on("socket");
            let record = record.refused("it sent more than a socket may");
            self.app.store.record(record.by_anybody(self.app.caller(self.source)), None).await;
        }
        // The place is free before the close frame: a client may take its time to answer it.
        let Connection { client, place, .. } = self;
        drop(place);
        client.close(ending).await;
    }

    async fn serve(&mut self) -> Result<std::convert::Infallible, Ending> {
        let mut snapshots = self.app.link.snapshots.clone();
        let mut closing = self.app.closing.subscribe();
        let mut beats = interval(BEAT_EVERY);
        // After a stop of the whole process there is one beat to make up for, not all.
        beats.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut details = interval(DETAILS_EVERY);
        details.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut pause = std::pin::pin!(sleep(Duration::ZERO));
        let mut pacing = Pacing::default();
        let mut details_due = false;
        let mut hand_overs = self.app.hand_overs.subscribe();
        self.show(&latest(&mut snapshots)).await?;
        self.say(&mut hand_overs, false).await?;
        loop {
            let is_paused = !pause.is_elapsed();
            // In a pause the details wait too, and then go with the next state.
            let shows = tokio::select! {
                () = self.client.session.ended() => return Err(Ending::Revoked),
                () = turned(&mut closing) => return Err(Ending::Closing),
                () = turned(&mut self.over) => return Err(Ending::Flood),
                () = &mut pause, if is_paused => details_due,
                changed = snapshots.changed(), if !is_paused => {
                    changed.map_err(|_| Ending::NoEngine)?;
                    true
                }
                received = self.client.socket.recv() => {
                    self.hear(received)?;
                    false
                }
                // The sender lives as long as the server.
                Ok(()) = hand_overs.changed() => {
                    self.say(&mut hand_overs, true).await?;
                    false
                }
                Some(Ok(answer)) = self.stops.join_next() => {
                    self.client.send(Message::Text(answer)).await?;
                    false
                }
                _ = details.tick(), if self.feed.is_paced() => {
                    details_due = is_paused;
                    if !is_paused {
                        self.show_details(&self.app.published()).await?;
                    }
                    false
                }
                _ = beats.tick() => {
                    self.beat += 1;
                    self.beat(self.beat).await?;
                    false
                }
            };
            if shows {
                let published = latest(&mut snapshots);
                let sent = match std::mem::take(&mut details_due) {
                    true => self.show_details(&published).await?,
                    false => self.show(&published).await?,
                };
                if self.feed.is_paced() {
                    pause.set(sleep(pacing.pause(self.app.clock.now(), sent)));
                }
            }
        }
    }

    /// Sends what this client does not have yet, if there is any.
    async fn show(&mut self, published: &Published) -> Result<bool, Ending> {
        match &mut self.feed {
            Feed::Page { lang, shown, details, .. } => {
                let frame = self.app.frames.html(published, *lang, &self.app.trends);
                let message = match *shown {
                    Some(shown) => frame.since(shown),
                    None => {
                        *details = frame.revision();
                        Some(frame.full())
                    }
                };
                *shown = Some(frame.revision());
                self.seq = frame.seq();
                self.place.sent(self.seq, self.app.clock.now());
                self.client.send_some(message).await
            }
            Feed::Pulse { .. } => Ok(false),
            Feed::Snapshots => {
                let json = self.app.frames.json(published);
                self.client.send_some(Some(json)).await
            }
        }
    }

    /// Tells a page who takes over, or that nobody does any more if it was told before.
    async fn say(
        &mut self,
        said: &mut watch::Receiver<Option<HandOver>>,
        was_told: bool,
    ) -> Result<(), Ending> {
        let Feed::Page { lang, .. } = self.feed else { return Ok(()) };
        let words = said.borrow_and_update().as_ref().map(|said| lang.hand_over(said.to()));
        let message = (was_told || words.is_some()).then(|| frame::hand_over(words.as_deref()));
        self.client.send_some(message).await.map(|_| ())
    }

    /// What stands behind the tiles, and with it all else that is new.
    async fn show_details(&mut self, published: &Published) -> Result<bool, Ending> {
        let Feed::Page { lang, shown: Some(shown), details, .. } = &mut self.feed else { return Ok(false) };
        let frame = self.app.frames.html(published, *lang, &self.app.trends);
        let message = frame.since_with_details(*shown, *details);
        (*shown, *details) = (frame.revision(), frame.revision());
        self.seq = frame.seq();
        self.place.sent(self.seq, self.app.clock.now());
        self.client.send_some(message).await
    }

    /// Says that this server and its engine live. A page that hears nothing is covered by its own
    /// script, so nothing is said while the engine is silent.
    async fn beat(&mut self, number: u64) -> Result<(), Ending> {
        let now = self.app.clock.now();
        let beat = match self.feed {
            _ if !self.app.is_engine_alive() => None,
            Feed::Page { .. } => {
                self.place.beat(number, self.seq, now);
                Some(frame::beat(number, self.seq, now, self.app.clock.wall()))
            }
            Feed::Pulse { lang } => Some(frame::pulse(number, &self.app.published(), now, lang)),
            Feed::Snapshots => None,
        };
        if let Some(beat) = beat {
            self.client.send(Message::Text(beat)).await?;
        }
        if number.is_multiple_of(BEATS_PER_PING) { self.client.ping().await } else { Ok(()) }
    }

    fn hear(&mut self, received: Option<Result<Message, axum::Error>>) -> Result<(), Ending> {
        let Some(Ok(message)) = received else { return Err(Ending::Gone) };
        match (message, &self.feed) {
            // A client that only asks has not read anything.
            (Message::Ping(_), _) => Ok(()),
            (Message::Pong(_), _) => {
                self.client.pings_unanswered = 0;
                Ok(())
            }
            (Message::Close(_), _) => Err(Ending::Gone),
            (Message::Text(text), Feed::Page { lang, .. }) => {
                let said = match serde_json::from_str(&text).map_err(|_| Ending::Nonsense)? {
                    Said::Stop { stop } => return self.stop(stop, *lang),
                    Said::Shown(said) => said,
                };
                if said.shown.is_some_and(|seq| seq > self.seq) {
                    return Err(Ending::Nonsense);
                }
                match said {
                    Shown { beat: Some(beat), .. } if beat > self.beat => return Err(Ending::Nonsense),
                    Shown { beat: Some(beat), shown } => self.place.confirm_beat(beat, shown),
                    Shown { beat: None, shown: Some(seq) } => self.place.confirm(seq),
                    Shown { beat: None, shown: None } => return Err(Ending::Nonsense),
                }
                Ok(())
            }
            (Message::Text(_) | Message::Binary(_), _) => Err(Ending::Nonsense),
        }
    }

    /// Requests a stop as a tap over HTTP does; the answer is what that would get. Stops past the bound
    /// are left to that way.
    fn stop(&mut self, form: StopForm, lang: Lang) -> Result<(), Ending> {
        let session = &self.client.session;
        let Some(name) = form.tap.clone().filter(|_| session.role == Role::Operator) else {
            return Err(Ending::Nonsense);
        };
        if self.stops.len() < STOPS_AT_ONCE {
            let tap = Tap::over_socket(&self.app, session, self.source, lang);
            self.stops.spawn(async move { frame::answered(&name, request_stop(tap, form).await).await });
        }
        Ok(())
    }
}

/// What a page says over its socket.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Said {
    /// The operator touched STOP.
    Stop {
        stop: StopForm,
    },
    Shown(Shown),
}

/// What a page answers once it shows a message: its `seq`, and of a beat its number too.
#[derive(Debug, Deserialize)]
struct Shown {
    shown: Option<u64>,
    beat: Option<u64>,
}

fn latest(snapshots: &mut watch::Receiver<Published>) -> Published {
    snapshots.borrow_and_update().clone()
}
