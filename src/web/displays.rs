//! The open WebSockets: how many there are, and what each of them has shown.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::watch;

use crate::engine::time::Timestamp;
use crate::store::Session;

/// A vehicle has a few displays; more sockets than this are refused.
const SOCKETS_MAX: usize = 64;
/// A browser that reloads leaves old sockets behind for a moment.
const SOCKETS_PER_SESSION_MAX: usize = 16;

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
#[derive(Debug, Clone)]
pub struct Display {
    pub session: Session,
    /// The newest snapshot that the page confirmed to show, and when it said so.
    pub confirmed: Option<(u64, Timestamp)>,
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
        table.open.insert(number, Display { session: session.clone(), confirmed: None });
        table.count.send_replace(table.open.len());
        Some(Place { displays: self.clone(), number })
    }

    /// How many sockets are open.
    pub fn count(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).open.len()
    }

    /// The newest confirmation of any display of this session.
    pub fn confirmed(&self, session: &Session) -> Option<(u64, Timestamp)> {
        let table = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let displays = table.open.values().filter(|display| display.session.is(session));
        displays.filter_map(|display| display.confirmed).max()
    }

    /// Waits until no socket is open.
    pub async fn all_gone(&self) {
        let mut count = self.0.lock().unwrap_or_else(PoisonError::into_inner).count.subscribe();
        // The sender lives as long as `self`.
        let _ = count.wait_for(|count| *count == 0).await;
    }
}

impl Place {
    /// The page says that it shows `seq`.
    pub fn confirm(&self, seq: u64, now: Timestamp) {
        let mut table = self.displays.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(display) = table.open.get_mut(&self.number) {
            display.confirmed = display.confirmed.max(Some((seq, now)));
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
