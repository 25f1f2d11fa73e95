//! The open WebSockets: their number, and what each page has shown.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval};

use crate::Live;
use telltale_clock::latency::Latency;
use telltale_engine::input::Input;
use telltale_engine::time::{Span, Timestamp};
use telltale_runtime::{Stamped, Version};
use telltale_store::{Role, Session};

/// The largest numbers of open sockets: of one login (a browser that reloads leaves old sockets behind for a
/// moment), of one user, of all operators, and of all others. Operators and others are counted apart, and so
/// are pages and streams, so that none takes the places of another.
#[derive(Debug)]
struct SocketBounds {
    session: usize,
    user: usize,
    operators: usize,
    others: usize,
}

/// Enough for two hundred browsers of two users.
const PAGES: SocketBounds = SocketBounds { session: 16, user: 112, operators: 64, others: 256 };
const STREAMS: SocketBounds = SocketBounds { session: 16, user: 32, operators: 32, others: 96 };

/// A display is live if it shows a state that is younger than this.
pub const LIVE_WITHIN: Span = Span::from_secs(2);
/// A late display is live again after it was in time for this long.
const LIVE_AGAIN_AFTER: Span = Span::from_secs(5);
const CHECK_EVERY: Duration = Duration::from_millis(250);
/// The shortest time between two noted states that are not confirmed yet, and their largest number.
const NOTED_EVERY: Span = Span::from_millis(100);
const NOTED_MAX: usize = 32;

/// All open sockets.
#[derive(Debug, Default, Clone)]
pub struct Displays(Arc<Mutex<Table>>);

#[derive(Debug, Default)]
struct Table {
    next: u64,
    open: HashMap<u64, OpenDisplay>,
    /// When it was last judged whether the displays are live.
    watched: Timestamp,
    count: watch::Sender<usize>,
    latency: Latency,
}

/// One open socket.
#[derive(Debug)]
struct OpenDisplay {
    session: Session,
    is_stream: bool,
    /// The states that were sent and are not confirmed. Past the limit the oldest stay: they tell how late the
    /// display is.
    sent: VecDeque<Sent>,
    /// The last beat that was sent, and whether the page confirms beats by their numbers. While a `seq` stands
    /// still, an old confirmation of it looks like a new one.
    beat: u64,
    beat_at: Option<Timestamp>,
    says_beats: bool,
    /// When the state was sent that the page shows now.
    shows_as_of: Option<Timestamp>,
}

#[derive(Debug, Clone, Copy)]
struct Sent {
    seq: Version,
    /// The first beat that was sent after this state.
    beat: u64,
    at: Timestamp,
}

/// Whether the sockets and the watch over them move.
#[derive(Debug, Clone, Copy)]
pub struct Progress {
    /// When the page that has waited longest was sent its last beat.
    pub beat_oldest: Option<Timestamp>,
    /// When it was last judged whether the displays are live.
    pub watched: Timestamp,
}

/// The place of one socket in the table. Dropping it frees the place.
#[derive(Debug)]
pub struct Place {
    displays: Displays,
    number: u64,
}

impl Displays {
    /// A place for the socket of one more page, if there is one.
    pub fn enter(&self, session: &Session) -> Option<Place> {
        self.enter_as(session, false)
    }

    /// A place for the socket of one more program, if there is one.
    pub fn enter_stream(&self, session: &Session) -> Option<Place> {
        self.enter_as(session, true)
    }

    fn enter_as(&self, session: &Session, is_stream: bool) -> Option<Place> {
        let mut table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if !table.has_place(session, is_stream) {
            return None;
        }
        let number = table.next;
        table.next += 1;
        let display = OpenDisplay {
            session: session.clone(),
            is_stream,
            sent: VecDeque::new(),
            beat: 0,
            beat_at: None,
            says_beats: false,
            shows_as_of: None,
        };
        table.open.insert(number, display);
        table.count.send_replace(table.open.len());
        Some(Place { displays: self.clone(), number })
    }

    /// For the check that messages reach the pages.
    pub fn progress(&self) -> Progress {
        let table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        Progress {
            beat_oldest: table.open.values().filter_map(|display| display.beat_at).min(),
            watched: table.watched,
        }
    }

    /// Notes that it is judged whether the displays are live.
    pub fn note_watched(&self, now: Timestamp) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).watched = now;
    }

    /// How many sockets are open.
    pub fn count(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).open.len()
    }

    /// How many pages and streams are open, by the role of their users.
    pub fn by_kind_and_role(&self) -> Vec<(&'static str, Role, usize)> {
        let table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let count = |is_stream, role| {
            table.open.values().filter(|it| it.is_stream == is_stream && it.session.role == role).count()
        };
        let kinds = [("page", false), ("stream", true)];
        let all = kinds.iter().flat_map(|kind| Role::OF_VEHICLE.map(|role| (*kind, role)));
        all.map(|((kind, is_stream), role)| (kind, role, count(is_stream, role))).collect()
    }

    /// How long it takes until a page confirms what it was sent.
    pub fn latency(&self) -> Latency {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).latency.clone()
    }

    /// The instant whose state the best display of a login shows, if one has confirmed any.
    pub fn shows_as_of(&self, session: &Session) -> Option<Timestamp> {
        self.newest(|display| display.session.is(session))
    }

    /// Whether a page of a login is open, live or not.
    pub fn has(&self, session: &Session) -> bool {
        let table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        table.open.values().any(|display| !display.is_stream && display.session.is(session))
    }

    /// Whether the user sees the present state: on a display of this login or, if this login has none, on
    /// another display of the same user.
    pub fn is_live_for(&self, session: &Session, now: Timestamp) -> bool {
        let has_own = {
            let table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            table.open.values().any(|display| display.session.is(session))
        };
        let of = |display: &OpenDisplay| match has_own {
            true => display.session.is(session),
            false => display.session.user == session.user,
        };
        self.newest(of).is_some_and(|shown| now.since(shown) < LIVE_WITHIN)
    }

    /// Whether this user has an open page, and none that confirmed a recent state.
    pub fn is_late(&self, user: &str, now: Timestamp) -> bool {
        let table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut late = false;
        for display in table.open.values().filter(|display| &*display.session.user == user) {
            if display.shows_as_of.is_some_and(|shown| now.since(shown) < LIVE_WITHIN) {
                return false;
            }
            late |= display.sent.front().is_some_and(|sent| now.since(sent.at) >= LIVE_WITHIN);
        }
        late
    }

    fn newest(&self, of: impl Fn(&OpenDisplay) -> bool) -> Option<Timestamp> {
        let table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        table.open.values().filter(|display| of(display)).filter_map(|display| display.shows_as_of).max()
    }

    /// Waits until no socket is open.
    pub async fn all_gone(&self) {
        let mut count = self.0.lock().unwrap_or_else(PoisonError::into_inner).count.subscribe();
        // The sender lives as long as `self`.
        let _ = count.wait_for(|count| *count == 0).await;
    }
}

impl Table {
    fn has_place(&self, session: &Session, is_stream: bool) -> bool {
        let bounds = if is_stream { STREAMS } else { PAGES };
        let is_operator = |of: &Session| of.role == Role::Operator;
        let (mut of_session, mut of_user, mut of_all) = (0, 0, 0);
        for other in self.open.values().filter(|other| other.is_stream == is_stream) {
            of_session += usize::from(other.session.is(session));
            of_user += usize::from(other.session.user == session.user);
            of_all += usize::from(is_operator(&other.session) == is_operator(session));
        }
        let all_max = if is_operator(session) { bounds.operators } else { bounds.others };
        of_session < bounds.session && of_user < bounds.user && of_all < all_max
    }
}

/// Tells the engine when the operator's display becomes late, and when it is in time again.
pub async fn watch(app: Live) {
    let mut checks = interval(CHECK_EVERY);
    checks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut lateness = Lateness::default();
    loop {
        checks.tick().await;
        let now = app.clock.now();
        app.displays.note_watched(now);
        let operator = app.published().snapshot.operator.clone();
        let late = operator.filter(|operator| app.displays.is_late(operator, now));
        if !lateness.judge(late.as_deref(), now) {
            continue;
        }
        tracing::warn!(late = lateness.of.is_some(), "the operator's display");
        let input = Input::Display { late: lateness.of.clone() };
        if app.link.inputs.send(Stamped::new(input, now)).await.is_err() {
            return;
        }
    }
}

/// The operator whose display was reported late. A delay around the limit must not make the warning come and
/// go: it is reported at once, and withdrawn after the display was in time for a while.
#[derive(Debug, Default)]
struct Lateness {
    of: Option<Box<str>>,
    late_last: Timestamp,
}

impl Lateness {
    /// Takes the operator whose display is late now, if there is one. Returns whether the report changes.
    fn judge(&mut self, late: Option<&str>, now: Timestamp) -> bool {
        match late {
            Some(_) => self.late_last = now,
            None if now.since(self.late_last) < LIVE_AGAIN_AFTER => return false,
            None => {}
        }
        let is_new = self.of.as_deref() != late;
        if is_new {
            self.of = late.map(Box::from);
        }
        is_new
    }
}

impl Place {
    /// The state `seq` was sent.
    pub fn sent(&self, seq: Version, now: Timestamp) {
        self.change(|display| display.note(seq, display.beat + 1, now));
    }

    /// A beat was sent, which says that the state `seq` is still the present one.
    pub fn beat(&self, beat: u64, seq: Version, now: Timestamp) {
        self.change(|display| {
            display.beat = beat;
            display.beat_at = Some(now);
            display.note(seq, beat, now);
        });
    }

    /// The page confirms that it shows `seq`, and with it everything that was sent before.
    pub fn confirm(&self, seq: Version, now: Timestamp) {
        self.confirmed(now, |display| match display.says_beats {
            false => display.confirm(|sent| sent.seq <= seq),
            true => Vec::new(),
        });
    }

    /// The page confirms a beat, and that it shows everything that was sent before the beat, up to `seq` if it
    /// names one.
    pub fn confirm_beat(&self, beat: u64, seq: Option<Version>, now: Timestamp) {
        self.confirmed(now, |display| {
            display.says_beats = true;
            display.confirm(|sent| sent.beat <= beat && seq.is_none_or(|seq| sent.seq <= seq))
        });
    }

    fn confirmed(&self, now: Timestamp, confirm: impl FnOnce(&mut OpenDisplay) -> Vec<Timestamp>) {
        let mut table = self.displays.0.lock().unwrap_or_else(PoisonError::into_inner);
        let sent = table.open.get_mut(&self.number).map(confirm).unwrap_or_default();
        sent.into_iter().for_each(|at| table.latency.observe(now.since(at)));
    }

    fn change(&self, change: impl FnOnce(&mut OpenDisplay)) {
        let mut table = self.displays.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(display) = table.open.get_mut(&self.number) {
            change(display);
        }
    }
}

impl OpenDisplay {
    fn note(&mut self, seq: Version, beat: u64, at: Timestamp) {
        let due = self.sent.back().is_none_or(|noted| at.since(noted.at) >= NOTED_EVERY);
        if due && self.sent.len() < NOTED_MAX {
            self.sent.push_back(Sent { seq, beat, at });
        }
    }

    /// Returns when what is shown now was sent.
    fn confirm(&mut self, is_shown: impl Fn(&Sent) -> bool) -> Vec<Timestamp> {
        let mut confirmed = Vec::new();
        while let Some(sent) = self.sent.pop_front_if(|sent| is_shown(sent)) {
            self.shows_as_of = self.shows_as_of.max(Some(sent.at));
            confirmed.push(sent.at);
        }
        confirmed
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut table = self.displays.0.lock().unwrap_or_else(PoisonError::into_inner);
        table.open.remove(&self.number);
        table.count.send_replace(table.open.len());
    }
}

#[cfg(test)]
mod tests;
