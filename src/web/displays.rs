//! The open WebSockets: how many there are, and what each of them has shown.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval};

use super::state::AppState;
use crate::engine::input::{Input, Stamped};
use crate::engine::time::{Span, Timestamp};
use crate::store::Session;

/// Two hundred browsers at one vehicle are served; more sockets than this are refused.
const SOCKETS_MAX: usize = 256;
/// A browser that reloads leaves old sockets behind for a moment.
const SOCKETS_PER_SESSION_MAX: usize = 16;

/// A display that shows nothing younger than this is not live.
pub const LIVE_WITHIN: Span = Span::from_secs(2);
const CHECK_EVERY: Duration = Duration::from_millis(250);
/// States that were sent and not confirmed are noted at most this often, and at most so many.
const NOTED_EVERY: Span = Span::from_millis(100);
const NOTED_MAX: usize = 32;

/// All open sockets.
#[derive(Debug, Default, Clone)]
pub struct Displays(Arc<Mutex<Table>>);

#[derive(Debug, Default)]
struct Table {
    next: u64,
    open: HashMap<u64, Display>,
    count: watch::Sender<usize>,
}

/// One open socket.
#[derive(Debug)]
struct Display {
    session: Session,
    /// What was sent and is not confirmed: `seq` and when. Past the limit the oldest stay: they
    /// are what the display is late with.
    sent: VecDeque<(u64, Timestamp)>,
    /// When that was sent which the page shows now.
    shows_as_of: Option<Timestamp>,
}

/// The place of one socket in the table; it is free again when this is dropped.
#[derive(Debug)]
pub struct Place {
    displays: Displays,
    number: u64,
}

impl Displays {
    /// A place for one more socket, if there is one.
    pub fn enter(&self, session: &Session) -> Option<Place> {
        let mut table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let of_session = table.open.values().filter(|display| display.session.is(session)).count();
        if table.open.len() >= SOCKETS_MAX || of_session >= SOCKETS_PER_SESSION_MAX {
            return None;
        }
        let number = table.next;
        table.next += 1;
        table
            .open
            .insert(number, Display { session: session.clone(), sent: VecDeque::new(), shows_as_of: None });
        table.count.send_replace(table.open.len());
        Some(Place { displays: self.clone(), number })
    }

    /// How many sockets are open.
    pub fn count(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).open.len()
    }

    /// Of which instant the best display of a login shows the state, if one has confirmed any.
    pub fn shows_as_of(&self, session: &Session) -> Option<Timestamp> {
        self.newest(|display| display.session.is(session))
    }

    /// Whether a display of a login lives: it confirmed a recent state.
    pub fn is_live(&self, session: &Session, now: Timestamp) -> bool {
        self.shows_as_of(session).is_some_and(|shown| now.since(shown) < LIVE_WITHIN)
    }

    /// Whether whoever logged in sees the vehicle as it is: on a display of this login, or
    /// on another one of theirs where this login has none.
    pub fn is_live_for(&self, session: &Session, now: Timestamp) -> bool {
        let has_own = {
            let table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            table.open.values().any(|display| display.session.is(session))
        };
        let of = |display: &Display| match has_own {
            true => display.session.is(session),
            false => display.session.user == session.user,
        };
        self.newest(of).is_some_and(|shown| now.since(shown) < LIVE_WITHIN)
    }

    /// Whether a page of this user is open and none of theirs says that it shows anything.
    pub fn is_late(&self, user: &str, now: Timestamp) -> bool {
        let table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut late = false;
        for display in table.open.values().filter(|display| &*display.session.user == user) {
            if display.shows_as_of.is_some_and(|shown| now.since(shown) < LIVE_WITHIN) {
                return false;
            }
            late |= display.sent.front().is_some_and(|(_, sent)| now.since(*sent) >= LIVE_WITHIN);
        }
        late
    }

    fn newest(&self, of: impl Fn(&Display) -> bool) -> Option<Timestamp> {
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

/// Tells the engine while the operator's display shows nothing, for as long as the server runs.
pub async fn watch(app: AppState) {
    let mut checks = interval(CHECK_EVERY);
    checks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut told = false;
    loop {
        checks.tick().await;
        let now = app.clock.now();
        let operator = app.published().snapshot.operator.clone();
        let late = operator.filter(|operator| app.displays.is_late(operator, now));
        if late.is_some() == told {
            continue;
        }
        told = late.is_some();
        tracing::warn!(late = told, "the operator's display");
        let input = Input::Display { late: late.map(|operator| Box::from(&*operator)) };
        if app.link.inputs.send(Stamped { input, received: now }).await.is_err() {
            return;
        }
    }
}

impl Place {
    /// The state `seq` was sent, or said to be the present one still.
    pub fn sent(&self, seq: u64, now: Timestamp) {
        self.change(|display| {
            let due = display.sent.back().is_none_or(|(_, noted)| now.since(*noted) >= NOTED_EVERY);
            if due && display.sent.len() < NOTED_MAX {
                display.sent.push_back((seq, now));
            }
        });
    }

    /// The page says that it shows `seq`, and so everything that was sent up to it.
    pub fn confirm(&self, seq: u64) {
        self.change(|display| {
            while let Some((_, sent)) = display.sent.pop_front_if(|(sent, _)| *sent <= seq) {
                display.shows_as_of = display.shows_as_of.max(Some(sent));
            }
        });
    }

    fn change(&self, change: impl FnOnce(&mut Display)) {
        let mut table = self.displays.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(display) = table.open.get_mut(&self.number) {
            change(display);
        }
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
mod tests {
    use super::*;
    use crate::clock::Clock;
    use crate::store::{DemoSecrets, Store};

    #[tokio::test]
    async fn a_display_lives_by_what_it_confirms() {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Accepted).unwrap();
        store.add_demo_users().await.unwrap();
        let user = store.authenticate("operator", "246810").await.unwrap().unwrap();
        let (_, session) = store.open_session(&user).await.unwrap();
        let displays = Displays::default();
        let at = Timestamp::from_millis;
        assert!(!displays.is_live_for(&session, at(0)) && !displays.is_late("operator", at(9_000)));
        let place = displays.enter(&session).unwrap();
        place.sent(1, at(1_000));
        assert!(!displays.is_live_for(&session, at(1_000)), "nothing is confirmed");
        place.confirm(1);
        assert!(displays.is_live_for(&session, at(2_999)) && !displays.is_live_for(&session, at(3_000)));
        for ms in (2_000..9_000).step_by(100) {
            place.sent(ms, at(ms));
        }
        // It goes on to answer, but shows what is old.
        place.confirm(2_000);
        assert!(!displays.is_live_for(&session, at(4_000)) && displays.is_late("operator", at(4_100)));
        place.confirm(8_900);
        assert_eq!(displays.shows_as_of(&session).map(|shown| shown > at(5_000)), Some(true));
        place.sent(9_000, at(9_000));
        place.confirm(9_000);
        assert!(displays.is_live_for(&session, at(9_500)) && !displays.is_late("operator", at(10_900)));
        drop(place);
        assert!(!displays.is_live_for(&session, at(9_500)) && !displays.is_late("operator", at(20_000)));
    }
}
