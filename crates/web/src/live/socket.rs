//! The live connections: fragments for pages, snapshots for programs.
//!
//! Each connection holds at most the latest state and sends one message at a time, so a slow one skips
//! intermediate states and delays nobody. It ends at once with its session.

use std::net::IpAddr;
use std::pin::Pin;
use std::time::Duration;

use axum::extract::rejection::QueryRejection;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{Message, Utf8Bytes, WebSocketUpgrade};
use axum::extract::{Extension, Query, State};
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, Sleep, interval, sleep};

use super::byte_budget::Meter;
use super::client::{Client, Ending};
use super::displays::Place;
use super::frame::{self, Form, Sent};
use super::pacing::Pacing;
use super::stream_query::{StreamQuery, how_to_stream};
use crate::admission::peer::{Peer, source_of};
use crate::auth::handover::HandOver;
use crate::http::guard::SignedIn;
use crate::http::respond::{Reader, refusal};
use crate::operator::actions::{StopForm, request_stop};
use crate::operator::tap::Tap;
use crate::texts::{HttpError, Lang, NAME, clean};
use crate::{AppState, turned};
use telltale_runtime::{Published, Version};
use telltale_store::audit::{Action, Record};
use telltale_store::{Role, Session};

/// The largest message that a client may send.
pub const INBOUND_BYTES_MAX: usize = 16 * 1024;
/// The bytes that are read of a socket at a time, so that a client that never stops sending delays nobody.
const READ_BYTES: usize = 4 * 1024;
/// The time between two beats. A page without a beat for 1 s says that it is not live.
const BEAT_EVERY: Duration = Duration::from_millis(250);
/// A ping goes out with every fourth beat.
const BEATS_PER_PING: u64 = 4;
/// The least time between two updates of the hidden panels behind the tiles.
const DETAILS_EVERY: Duration = Duration::from_millis(500);
/// Taps on STOP of one page that may wait for an answer at the same time.
const STOPS_AT_ONCE: usize = 4;

#[derive(Debug, Deserialize)]
pub struct PageSocketQuery {
    lang: Option<String>,
}

/// `GET /ws`
pub async fn page(
    State(app): State<AppState>,
    from: From,
    SignedIn(session): SignedIn,
    reader: Reader,
    query: Result<Query<PageSocketQuery>, QueryRejection>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let lang = lang_of(query, &reader);
    open(app, from, session, &reader, upgrade, Feed::Page { lang, shown: None, details: Version::default() })
}

/// `GET /api/v1/stream`
pub async fn stream(
    State(app): State<AppState>,
    from: From,
    SignedIn(session): SignedIn,
    reader: Reader,
    headers: HeaderMap,
    query: Result<Query<StreamQuery>, QueryRejection>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let form = query.map(|Query(query)| query.form()).unwrap_or_default();
    if upgrade.is_err() {
        return how_to_stream(&app, &headers);
    }
    open(app, from, session, &reader, upgrade, Feed::Snapshots { form, sent: None })
}

/// `GET /developer/live`
pub async fn pulse(
    State(app): State<AppState>,
    from: From,
    SignedIn(session): SignedIn,
    reader: Reader,
    query: Result<Query<PageSocketQuery>, QueryRejection>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    let lang = lang_of(query, &reader);
    open(app, from, session, &reader, upgrade, Feed::Pulse { lang })
}

/// The language that a page names in its address, or that of its user.
fn lang_of(query: Result<Query<PageSocketQuery>, QueryRejection>, reader: &Reader) -> Lang {
    let named = query.ok().and_then(|Query(query)| query.lang);
    named.as_deref().and_then(Lang::from_word).unwrap_or(reader.lang)
}

/// Where a request came from, and the meter of its connection.
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
        Feed::Snapshots { .. } => app.displays.enter_stream(&session),
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
        let seq = Version::default();
        LiveConnection { app, source, over, client, feed, place, seq, seq_max: 0, beat: 0, stops }
            .run()
            .await;
    })
}

/// The content of a connection.
#[derive(Debug)]
enum Feed {
    /// Fragments of the operator's page: `shown` is the revision that was sent last, `details` that of the
    /// panels behind the tiles.
    Page { lang: Lang, shown: Option<Version>, details: Version },
    /// Snapshots as JSON, and what was sent of them last.
    Snapshots { form: Form, sent: Option<Sent> },
    /// Beats alone, with the revision that a developer's page can request.
    Pulse { lang: Lang },
}

impl Feed {
    /// Whether states are sent with pauses. Programs get every snapshot that they keep up with.
    fn is_paced(&self) -> bool {
        matches!(self, Feed::Page { .. })
    }
}

struct LiveConnection {
    app: AppState,
    source: IpAddr,
    /// Turns true when the client has sent too much.
    over: watch::Receiver<bool>,
    client: Client,
    feed: Feed,
    place: Place,
    /// The state that was sent last.
    seq: Version,
    /// The largest number of a state that was sent: after a rewind it is from before it.
    seq_max: u64,
    /// The number of the beat that was sent last.
    beat: u64,
    /// Taps on STOP that are not answered yet.
    stops: JoinSet<Utf8Bytes>,
}

impl LiveConnection {
    async fn run(mut self) {
        let ending = match self.serve().await {
            Ok(never) => match never {},
            Err(ending) => ending,
        };
        tracing::debug!(?ending, user = &*self.client.session.user, "socket closed");
        if ending == Ending::Flood {
            let record = Record::of_session(&self.client.session, Action::Request, self.source).on("socket");
            let record = record.refused("it sent more than a socket may");
            self.app.record_refused(record, self.source).await;
        }
        // The place is free before the close frame: a client may take its time to answer it.
        let LiveConnection { client, place, .. } = self;
        drop(place);
        client.close(ending).await;
    }

    async fn serve(&mut self) -> Result<std::convert::Infallible, Ending> {
        // Pages need not be first: to make their HTML takes longer than the message for programs.
        let mut snapshots = match self.feed {
            Feed::Snapshots { .. } => self.app.snapshots().clone(),
            Feed::Page { .. } | Feed::Pulse { .. } => self.app.afterwards().clone(),
        };
        let mut closing = self.app.listening.closing();
        let mut beats = interval(BEAT_EVERY);
        // After a stop of the whole process there is one beat to make up for, not all.
        beats.set_missed_tick_behavior(MissedTickBehavior::Delay);
        // After an update of the details.
        let mut rest = std::pin::pin!(sleep(Duration::ZERO));
        let mut pause = std::pin::pin!(sleep(Duration::ZERO));
        let mut pacing = Pacing::default();
        let mut hand_overs = self.app.hand_overs.subscribe();
        let mut first_changes = self.app.first_changes.subscribe();
        let mut elsewhere = self.client.session.elsewhere();
        self.show(&latest(&mut snapshots), rest.as_mut()).await?;
        self.say(&mut hand_overs, false).await?;
        self.say_elsewhere(&mut elsewhere).await?;
        loop {
            let (is_paused, is_resting) = (!pause.is_elapsed(), !rest.is_elapsed());
            let shows = tokio::select! {
                () = self.client.session.ended() => return Err(Ending::Revoked),
                () = turned(&mut closing) => return Err(Ending::Closing),
                () = turned(&mut self.over) => return Err(Ending::Flood),
                () = &mut pause, if is_paused => !is_resting && self.details_wait(),
                Ok(()) = first_changes.changed(), if is_paused => true,
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
                Ok(()) = elsewhere.changed() => {
                    self.say_elsewhere(&mut elsewhere).await?;
                    false
                }
                Some(Ok(answer)) = self.stops.join_next() => {
                    self.client.send(Message::Text(answer)).await?;
                    false
                }
                // In a pause the details wait too, and then go with the next state.
                () = &mut rest, if is_resting => {
                    if !is_paused && self.details_wait() {
                        self.show(&self.app.published(), rest.as_mut()).await?;
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
                first_changes.mark_unchanged();
                let published = latest(&mut snapshots);
                let sent = self.show(&published, rest.as_mut()).await?;
                if self.feed.is_paced() {
                    pause.set(sleep(pacing.pause(self.app.clock.now(), sent)));
                }
            }
        }
    }

    /// Sends the changes since the last message to this client, with the panels behind the tiles if these do not
    /// `rest`. Returns whether there were any.
    async fn show(&mut self, published: &Published, mut rest: Pin<&mut Sleep>) -> Result<bool, Ending> {
        match &mut self.feed {
            Feed::Page { lang, shown, details } => {
                let frame = self.app.frames.html(published, *lang, &self.app.trends);
                let message = match *shown {
                    Some(shown) if !rest.is_elapsed() => frame.since(shown),
                    Some(shown) => {
                        if frame.has_details_since(*details) {
                            rest.set(sleep(DETAILS_EVERY));
                        }
                        frame.since_with_details(shown, std::mem::replace(details, frame.revision()))
                    }
                    None => {
                        *details = frame.revision();
                        Some(frame.full())
                    }
                };
                *shown = Some(frame.revision());
                self.sends(frame.seq());
                self.client.send_some(message).await
            }
            Feed::Pulse { .. } => Ok(false),
            Feed::Snapshots { form, sent } => {
                let (message, has) = self.app.frames.stream(published, *form, *sent);
                *sent = Some(has);
                self.client.send_some(Some(message)).await
            }
        }
    }

    /// Tells a page which operator takes over, or that the announced one does not.
    async fn say(
        &mut self,
        said: &mut watch::Receiver<Option<HandOver>>,
        was_told: bool,
    ) -> Result<(), Ending> {
        let Feed::Page { lang, .. } = self.feed else { return Ok(()) };
        let words = said.borrow_and_update().as_ref().map(|said| lang.hand_over(&clean(said.to(), NAME)));
        let message = (was_told || words.is_some()).then(|| frame::hand_over(words.as_deref()));
        self.client.send_some(message).await.map(|_| ())
    }

    /// Tells a page that its session is used from another address, too.
    async fn say_elsewhere(&mut self, other: &mut watch::Receiver<Option<IpAddr>>) -> Result<(), Ending> {
        let other = *other.borrow_and_update();
        let (Feed::Page { lang, .. } | Feed::Pulse { lang }) = self.feed else { return Ok(()) };
        let message = other.map(|address| frame::elsewhere(&lang.elsewhere(address)));
        self.client.send_some(message).await.map(|_| ())
    }

    /// Whether a page was shown something without the panels behind the tiles.
    fn details_wait(&self) -> bool {
        matches!(self.feed, Feed::Page { shown: Some(shown), details, .. } if details < shown)
    }

    /// Notes which state the page gets.
    fn sends(&mut self, seq: Version) {
        self.seq = seq;
        self.seq_max = self.seq_max.max(seq.number);
        self.place.sent(seq, self.app.clock.now());
    }

    /// The state that a page says it shows. A number that was not sent since the last rewind is
    /// from before it.
    fn sent(&self, number: u64) -> Result<Version, Ending> {
        match number {
            _ if number <= self.seq.number => Ok(Version { number, ..self.seq }),
            _ if number <= self.seq_max => {
                Ok(Version { number, rewinds: self.seq.rewinds.saturating_sub(1) })
            }
            _ => Err(Ending::Nonsense),
        }
    }

    /// Sends a beat while the engine lives. A page without beats covers itself, so a silent engine gets none.
    async fn beat(&mut self, number: u64) -> Result<(), Ending> {
        let now = self.app.clock.now();
        let beat = match self.feed {
            _ if !self.app.is_source_alive() => None,
            Feed::Page { .. } => {
                self.place.beat(number, self.seq, now);
                let recorder = self.app.recorder_state();
                Some(frame::beat(number, self.seq.number, now, self.app.wall(), recorder))
            }
            Feed::Pulse { lang } => Some(frame::pulse(number, &self.app.published(), now, lang)),
            Feed::Snapshots { .. } => None,
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
                let shown = said.shown.map(|number| self.sent(number)).transpose()?;
                let now = self.app.clock.now();
                match (said.beat, shown) {
                    (Some(beat), _) if beat > self.beat => return Err(Ending::Nonsense),
                    (Some(beat), shown) => self.place.confirm_beat(beat, shown, now),
                    (None, Some(seq)) => self.place.confirm(seq, now),
                    (None, None) => return Err(Ending::Nonsense),
                }
                Ok(())
            }
            (Message::Text(_) | Message::Binary(_), _) => Err(Ending::Nonsense),
        }
    }

    /// Requests a stop as `POST /vehicle/stop` does, with the same answer. Taps past the bound get none here:
    /// the page sends each tap over HTTP too.
    fn stop(&mut self, form: StopForm, lang: Lang) -> Result<(), Ending> {
        let session = &self.client.session;
        let Some(name) = form.tap.clone().filter(|_| session.role == Role::Operator) else {
            return Err(Ending::Nonsense);
        };
        let Some(live) = self.app.live() else {
            let reader = Tap::socket_reader(lang);
            self.stops
                .spawn(async move { frame::answered(&name, refusal(&reader, HttpError::Replay)).await });
            return Ok(());
        };
        if self.stops.len() < STOPS_AT_ONCE {
            let tap = Tap::over_socket(live, session, self.source, lang);
            self.stops.spawn(async move { frame::answered(&name, request_stop(tap, form).await).await });
        }
        Ok(())
    }
}

/// A message from a page.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Said {
    /// The operator touched STOP.
    Stop {
        stop: StopForm,
    },
    Shown(Shown),
}

/// A page confirms a message that it shows: its `seq`, and the number of a beat.
#[derive(Debug, Deserialize)]
struct Shown {
    shown: Option<u64>,
    beat: Option<u64>,
}

fn latest(snapshots: &mut watch::Receiver<Published>) -> Published {
    snapshots.borrow_and_update().clone()
}
