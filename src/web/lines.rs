//! Which connections there are, and which of them goes when there is no place for another.
//!
//! To open a connection and say nothing costs nobody anything, so the silent ones must not keep
//! others out: where there is no place, the one that has been silent longest gives its own.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

use super::throttle::network;

/// From the vehicle's own displays. Sockets, once upgraded, are counted elsewhere.
const NEAR_MAX: usize = 128;
/// From all others: they never take the places of those.
const FAR_MAX: usize = 256;
/// From one network among the others.
const PER_NETWORK_MAX: usize = 64;

/// All open connections.
#[derive(Debug, Default, Clone)]
pub struct Lines(Arc<Mutex<Table>>);

#[derive(Debug, Default)]
struct Table {
    /// Numbers connections, and orders what happens to them.
    next: u64,
    open: HashMap<u64, Open>,
}

#[derive(Debug)]
struct Open {
    network: IpAddr,
    is_near: bool,
    /// When it was opened or its last answer was made, in order; `None` while it is answered.
    silent_since: Option<u64>,
    /// Its end tells the connection that it has to go.
    _stay: oneshot::Sender<()>,
}

/// The place of one connection; it is free again when this is dropped.
#[derive(Debug)]
pub struct Place {
    lines: Lines,
    number: u64,
}

/// A request that is being answered: its connection is not silent.
#[derive(Debug)]
pub struct Work(Lines, u64);

impl Lines {
    /// A place for one more connection, and what ends when it has to give it to another. `None` if
    /// all places are of connections that are being answered.
    pub fn enter(&self, source: IpAddr, is_near: bool) -> Option<(Place, oneshot::Receiver<()>)> {
        let network = network(source.to_canonical());
        let mut table = self.table();
        if !table.make_room(network, is_near) {
            return None;
        }
        let number = table.tick();
        let (stay, gone) = oneshot::channel();
        table.open.insert(number, Open { network, is_near, silent_since: Some(number), _stay: stay });
        Some((Place { lines: self.clone(), number }, gone))
    }

    fn table(&self) -> MutexGuard<'_, Table> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Table {
    fn tick(&mut self) -> u64 {
        self.next += 1;
        self.next
    }

    fn make_room(&mut self, network: IpAddr, is_near: bool) -> bool {
        let alike = |open: &&Open| open.is_near == is_near;
        let all = self.open.values().filter(alike).count();
        let same = self.open.values().filter(alike).filter(|open| open.network == network).count();
        if !is_near && same >= PER_NETWORK_MAX {
            return self.send_away(|open| !open.is_near && open.network == network);
        }
        let all_max = if is_near { NEAR_MAX } else { FAR_MAX };
        all < all_max || self.send_away(|open| open.is_near == is_near)
    }

    /// Ends the one of these that has been silent longest, if any is.
    fn send_away(&mut self, of: impl Fn(&Open) -> bool) -> bool {
        let silent = self.open.iter().filter(|(_, open)| of(open));
        let longest = silent.filter_map(|(number, open)| Some((open.silent_since?, *number))).min();
        longest.is_some_and(|(_, number)| self.open.remove(&number).is_some())
    }
}

impl Place {
    /// Marks the connection as being answered. `None` if it gave its place away a moment before.
    pub fn work(&self) -> Option<Work> {
        self.lines.table().open.get_mut(&self.number)?.silent_since = None;
        Some(Work(self.lines.clone(), self.number))
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        let mut table = self.0.table();
        let now = table.tick();
        if let Some(open) = table.open.get_mut(&self.1) {
            open.silent_since = Some(now);
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.lines.table().open.remove(&self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn whoever_opens_many_loses_their_own_oldest_and_nobody_elses() {
        let lines = Lines::default();
        let (_display, mut display_goes) = lines.enter(ip("127.0.0.1"), true).unwrap();
        let (_other, mut other_goes) = lines.enter(ip("fd00:0:0:1::1"), false).unwrap();
        // One who has an IPv6 network has many addresses in it.
        let flood: Vec<_> = (0..600)
            .map(|number| lines.enter(ip(&format!("fd00:0:0:2::{number:x}")), false).unwrap())
            .collect();
        assert!(display_goes.try_recv().is_err_and(|why| why == oneshot::error::TryRecvError::Empty));
        assert!(other_goes.try_recv().is_err_and(|why| why == oneshot::error::TryRecvError::Empty));
        assert_eq!(lines.table().open.len(), 2 + PER_NETWORK_MAX);
        let stayed = |(_, mut goes): (Place, oneshot::Receiver<()>)| {
            goes.try_recv() == Err(oneshot::error::TryRecvError::Empty)
        };
        let stayed: Vec<bool> = flood.into_iter().map(stayed).collect();
        assert!(stayed[600 - PER_NETWORK_MAX..].iter().all(|stays| *stays), "the newest have their places");
    }

    #[test]
    fn those_who_are_answered_stay_and_places_of_the_vehicles_displays_are_their_own() {
        let lines = Lines::default();
        let far: Vec<_> = (0..FAR_MAX)
            .map(|number| {
                let (place, goes) =
                    lines.enter(ip(&format!("10.0.{}.{}", number / 64, number % 64)), false).unwrap();
                let work = place.work().unwrap();
                (place, goes, work)
            })
            .collect();
        assert!(lines.enter(ip("10.1.0.1"), false).is_none(), "each is being answered");
        let near: Vec<_> = (0..NEAR_MAX).map(|_| lines.enter(ip("127.0.0.1"), true).unwrap()).collect();
        let work = near[0].0.work().unwrap();
        let (newest, _goes) = lines.enter(ip("::ffff:127.0.0.1"), true).unwrap();
        assert!(near[1].0.work().is_none(), "the one that was silent longest is gone");
        drop(work);
        assert!(near[0].0.work().is_some() && newest.work().is_some());
        drop((far, near, newest));
        assert!(lines.table().open.is_empty(), "nothing is kept of who has gone");
    }
}
