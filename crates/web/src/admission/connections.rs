//! Bounds the number of connections, and decides which connection is closed when there is no place for a
//! new one.
//!
//! A connection is anonymous until a request with an open session comes on it. Opening one silently, or
//! beginning a request without ending it, costs a client nothing, so anonymous connections must not keep
//! others out. If there is no place, the oldest that is not being answered is closed; connections from
//! addresses without a recent session go first. Connections with a session have places of their own, which
//! no anonymous one takes.

use std::collections::{HashMap, VecDeque};
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

use super::peer::network;
use telltale_store::{Caller, Role, Session};

/// How many anonymous connections there may be, and how many of them may be answered at once. The rest
/// takes in new ones: the connections of logged-in users begin there too.
#[derive(Debug)]
struct ConnectionBounds {
    open: usize,
    answered: usize,
}

/// From the vehicle's own displays. Sockets, once upgraded, are counted elsewhere.
const AT_VEHICLE: ConnectionBounds = ConnectionBounds { open: 96, answered: 64 };
/// From all others: they never take the places of those.
const ELSEWHERE: ConnectionBounds = ConnectionBounds { open: 128, answered: 96 };
/// From one network among the others.
const PER_NETWORK: ConnectionBounds = ConnectionBounds { open: 64, answered: 48 };

const fn bounds(caller: Caller) -> &'static ConnectionBounds {
    match caller {
        Caller::Vehicle => &AT_VEHICLE,
        Caller::Elsewhere => &ELSEWHERE,
    }
}

/// Connections with a session of an operator, of anybody else, and of one user.
const OPERATORS_MAX: usize = 64;
const OTHERS_MAX: usize = 96;
const PER_USER_MAX: usize = 48;
/// The number of remembered networks from which requests with a session came.
const KNOWN_MAX: usize = 64;

/// All open connections.
#[derive(Debug, Default, Clone)]
pub struct Connections(Arc<Mutex<Table>>);

#[derive(Debug, Default)]
struct Table {
    /// Numbers connections, and orders what happens to them.
    next: u64,
    open: HashMap<u64, Open>,
    /// Networks from which requests with a session came, the latest first.
    known: VecDeque<IpAddr>,
}

#[derive(Debug)]
struct Open {
    /// `None` for a proxy.
    network: Option<IpAddr>,
    caller: Caller,
    /// The user who holds the place; `None` for an anonymous connection.
    holder: Option<Holder>,
    /// When it was opened or its last answer was made, in order; `None` while it is answered.
    silent_since: Option<u64>,
    /// The connection closes when this is dropped.
    _stay: oneshot::Sender<()>,
}

#[derive(Debug, PartialEq, Eq)]
struct Holder {
    user: Arc<str>,
    is_operator: bool,
}

/// The place of one connection; it is free again when this is dropped.
#[derive(Debug)]
pub struct ConnectionPlace {
    connections: Connections,
    number: u64,
}

/// A request that came on a connection. The connection is silent again when this is dropped.
#[derive(Debug)]
pub struct Work(ConnectionHandle);

/// The connection on which a request came. The guard says who asks; until then it is anonymous.
#[derive(Debug, Clone)]
pub struct ConnectionHandle {
    connections: Connections,
    number: u64,
}

impl Connections {
    /// A place for one more connection, and a receiver that ends when the connection has to close for
    /// another. `None` if all connections are being answered.
    pub fn enter(&self, source: IpAddr, caller: Caller) -> Option<(ConnectionPlace, oneshot::Receiver<()>)> {
        self.enter_as(Some(network(source.to_canonical())), caller)
    }

    /// The same for a connection from a proxy, which brings many browsers.
    pub fn enter_proxied(&self) -> Option<(ConnectionPlace, oneshot::Receiver<()>)> {
        self.enter_as(None, Caller::Elsewhere)
    }

    fn enter_as(
        &self,
        network: Option<IpAddr>,
        caller: Caller,
    ) -> Option<(ConnectionPlace, oneshot::Receiver<()>)> {
        let mut table = self.table();
        if !table.make_room(network, caller) {
            return None;
        }
        let number = table.tick();
        let (stay, gone) = oneshot::channel();
        let open = Open { network, caller, holder: None, silent_since: Some(number), _stay: stay };
        table.open.insert(number, open);
        Some((ConnectionPlace { connections: self.clone(), number }, gone))
    }

    /// How many are open.
    pub fn count(&self) -> usize {
        self.table().open.len()
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

    fn make_room(&mut self, network: Option<IpAddr>, caller: Caller) -> bool {
        let alike = |open: &Open| open.holder.is_none() && open.caller == caller;
        let of_network = |open: &Open| alike(open) && open.network == network;
        if caller == Caller::Elsewhere && network.is_some() && self.count(of_network) >= PER_NETWORK.open {
            return self.send_away(of_network);
        }
        let all_max = bounds(caller).open;
        self.count(alike) < all_max || self.send_away(alike)
    }

    fn count(&self, of: impl Fn(&Open) -> bool) -> usize {
        self.open.values().filter(|open| of(open)).count()
    }

    /// Closes the one of these that has been silent longest. Before its head is read, an operator's tap is
    /// as anonymous as a stranger's request, so connections from networks without a recent session go first.
    fn send_away(&mut self, of: impl Fn(&Open) -> bool) -> bool {
        let silent = self.open.iter().filter(|(_, open)| of(open));
        let is_known = |open: &Open| open.network.is_some_and(|it| self.known.contains(&it));
        let longest =
            silent.filter_map(|(number, open)| Some((is_known(open), open.silent_since?, *number))).min();
        longest.is_some_and(|(.., number)| self.open.remove(&number).is_some())
    }

    fn know(&mut self, network: IpAddr) {
        self.known.retain(|it| *it != network);
        self.known.push_front(network);
        self.known.truncate(KNOWN_MAX);
    }

    /// Gives an anonymous connection a place among those of its session's user.
    fn hold(&mut self, number: u64, holder: Holder) -> bool {
        let Some(open) = self.open.get(&number) else { return false };
        if open.holder.as_ref() == Some(&holder) {
            return true;
        }
        let of_user = |open: &Open| open.holder.as_ref() == Some(&holder);
        let alike = |open: &Open| open.holder.as_ref().is_some_and(|it| it.is_operator == holder.is_operator);
        let all_max = if holder.is_operator { OPERATORS_MAX } else { OTHERS_MAX };
        let has_room = match () {
            () if self.count(of_user) >= PER_USER_MAX => self.send_away(of_user),
            () => self.count(alike) < all_max || self.send_away(alike),
        };
        if let Some(open) = self.open.get_mut(&number) {
            open.holder = has_room.then_some(holder);
        }
        has_room
    }

    /// Whether one more anonymous request of this connection's network may be answered.
    fn may_answer(&self, number: u64) -> bool {
        let Some(asked) = self.open.get(&number) else { return false };
        let alike =
            |open: &Open| open.holder.is_none() && open.caller == asked.caller && open.silent_since.is_none();
        let of_network = |open: &Open| alike(open) && open.network == asked.network;
        let all_max = bounds(asked.caller).answered;
        let is_shared = asked.caller == Caller::Vehicle || asked.network.is_none();
        self.count(alike) < all_max && (is_shared || self.count(of_network) < PER_NETWORK.answered)
    }
}

impl ConnectionPlace {
    /// A request came. `None` if the connection gave its place away a moment before.
    pub fn work(&self) -> Option<Work> {
        let is_open = self.connections.table().open.contains_key(&self.number);
        is_open.then(|| Work(ConnectionHandle { connections: self.connections.clone(), number: self.number }))
    }
}

impl Work {
    pub fn handle(&self) -> ConnectionHandle {
        self.0.clone()
    }
}

impl ConnectionHandle {
    /// Takes a place for a logged-in user's request: no anonymous connection takes that place, and the
    /// connection stays while the request is answered. Returns false without a login, or where all such
    /// places are taken.
    pub fn hold(&self, session: Option<&Session>) -> bool {
        let mut table = self.connections.table();
        let holder = session.map(|session| Holder {
            user: session.user.clone(),
            is_operator: session.role == Role::Operator,
        });
        let holds = holder.is_some_and(|holder| table.hold(self.number, holder));
        let mut known = None;
        if let Some(open) = table.open.get_mut(&self.number) {
            if holds {
                open.silent_since = None
            } else {
                open.holder = None
            }
            known = open.network.filter(|_| holds);
        }
        if let Some(network) = known {
            table.know(network);
        }
        holds
    }

    /// An anonymous request has come whole: its connection stays while it is answered. Returns whether
    /// that may be; too many others are answered if not.
    pub fn answer(&self) -> bool {
        let mut table = self.connections.table();
        let may = table.may_answer(self.number);
        if let Some(open) = table.open.get_mut(&self.number).filter(|_| may) {
            open.silent_since = None;
        }
        may
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        let mut table = self.0.connections.table();
        let now = table.tick();
        if let Some(open) = table.open.get_mut(&self.0.number) {
            open.silent_since = Some(now);
        }
    }
}

impl Drop for ConnectionPlace {
    fn drop(&mut self) {
        self.connections.table().open.remove(&self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_clock::Clock;
    use telltale_store::{DemoSecrets, Store};

    type Line = (ConnectionPlace, oneshot::Receiver<()>);

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    fn stays((_, goes): &mut Line) -> bool {
        goes.try_recv() == Err(oneshot::error::TryRecvError::Empty)
    }

    async fn session_of(store: &Store, name: &str, secret: &str) -> Session {
        let user = store.authenticate(name, secret).await.unwrap().unwrap();
        store.open_session(&user).await.unwrap().1
    }

    /// A connection on which somebody with a session asks for something.
    fn hold(connections: &Connections, from: &str, session: &Session) -> (Line, Work, bool) {
        let connection = connections
            .enter(ip(from), if from == "127.0.0.1" { Caller::Vehicle } else { Caller::Elsewhere })
            .unwrap();
        let work = connection.0.work().unwrap();
        let holds = work.handle().hold(Some(session));
        (connection, work, holds)
    }

    #[test]
    fn an_account_that_opens_many_loses_its_own_oldest_and_nobody_elses() {
        let connections = Connections::default();
        let mut display = connections.enter(ip("127.0.0.1"), Caller::Vehicle).unwrap();
        let mut other = connections.enter(ip("fd00:0:0:1::1"), Caller::Elsewhere).unwrap();
        // One who has an IPv6 network has many addresses in it.
        let mut flood: Vec<_> = (0..600)
            .map(|number| {
                connections.enter(ip(&format!("fd00:0:0:2::{number:x}")), Caller::Elsewhere).unwrap()
            })
            .collect();
        assert!(stays(&mut display) && stays(&mut other));
        assert_eq!(connections.table().open.len(), 2 + PER_NETWORK.open);
        let stayed: Vec<bool> = flood.iter_mut().map(stays).collect();
        assert!(stayed[600 - PER_NETWORK.open..].iter().all(|stays| *stays), "the newest have their places");
    }

    #[test]
    fn requests_that_are_not_whole_keep_nobody_out() {
        let connections = Connections::default();
        let mut begun: Vec<_> = (0..AT_VEHICLE.open)
            .map(|_| {
                let connection = connections.enter(ip("127.0.0.1"), Caller::Vehicle).unwrap();
                let work = connection.0.work().unwrap();
                assert!(!work.handle().hold(None));
                (connection, work)
            })
            .collect();
        let mut newest = connections.enter(ip("::ffff:127.0.0.1"), Caller::Vehicle).unwrap();
        assert!(!stays(&mut begun[0].0) && stays(&mut begun[1].0) && stays(&mut newest));
        assert!(begun[0].0.0.work().is_none() && newest.0.work().is_some());
    }

    #[test]
    fn anonymous_ones_that_are_answered_stay_and_leave_room_for_others() {
        let connections = Connections::default();
        for (source, caller, bounds) in [
            ("127.0.0.1", Caller::Vehicle, AT_VEHICLE),
            ("10.0.0.1", Caller::Elsewhere, PER_NETWORK),
            ("10", Caller::Elsewhere, ELSEWHERE),
        ] {
            let mut answered = Vec::new();
            for number in 0..bounds.open {
                let source = if source == "10" { &format!("10.1.{number}.1") } else { source };
                let connection = connections.enter(ip(source), caller).unwrap();
                let work = connection.0.work().unwrap();
                if work.handle().answer() {
                    answered.push((connection, work));
                }
            }
            assert_eq!(answered.len(), bounds.answered, "{source}");
            let (other, _goes) = connections.enter(ip("10.2.0.1"), caller).unwrap();
            assert!(
                other.work().is_some() && answered.iter_mut().all(|(connection, _)| stays(connection)),
                "{source}"
            );
        }
        assert!(connections.table().open.is_empty(), "nothing is kept of who has gone");
    }

    #[tokio::test]
    async fn a_new_connection_from_where_somebody_has_a_session_stays_longer_than_a_strangers() {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Accepted).unwrap();
        store.add_demo_users().await.unwrap();
        let operator = session_of(&store, "operator", "246810").await;
        let connections = Connections::default();
        let (page, work, holds) = hold(&connections, "10.0.0.1", &operator);
        assert!(holds);
        // The page's socket is none of these connections.
        drop((page, work));
        let mut tap = connections.enter(ip("10.0.0.1"), Caller::Elsewhere).unwrap();
        let mut stranger = connections.enter(ip("10.9.0.1"), Caller::Elsewhere).unwrap();
        let strangers: Vec<_> = (0..600)
            .map(|number| {
                connections
                    .enter(ip(&format!("10.1.{}.{}", number / 250, number % 250)), Caller::Elsewhere)
                    .unwrap()
            })
            .collect();
        assert!(stays(&mut tap) && !stays(&mut stranger));
        // They go as well where none but they are left.
        drop(strangers);
        let mut many: Vec<_> = (0..=PER_NETWORK.open)
            .map(|_| connections.enter(ip("10.0.0.1"), Caller::Elsewhere).unwrap())
            .collect();
        assert!(!stays(&mut tap) && many.iter_mut().rev().take(PER_NETWORK.open).all(stays));
        for number in 0..2 * KNOWN_MAX {
            drop(hold(&connections, &format!("10.2.0.{number}"), &operator));
        }
        assert_eq!(connections.table().known.len(), KNOWN_MAX);
    }

    #[tokio::test]
    async fn an_account_with_a_session_has_a_place_that_no_stranger_and_no_other_user_takes() {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Accepted).unwrap();
        store.add_demo_users().await.unwrap();
        let operator = session_of(&store, "operator", "246810").await;
        let connections = Connections::default();
        let (mut display, work, holds) = hold(&connections, "127.0.0.1", &operator);
        assert!(holds);
        drop(work);
        let strangers: Vec<_> =
            (0..500).map(|_| connections.enter(ip("127.0.0.1"), Caller::Vehicle).unwrap()).collect();
        assert!(stays(&mut display), "it is silent, and older than all of them");
        let mut held = Vec::new();
        let mut others = Vec::new();
        for (name, secret) in [("authority", "demo-authority"), ("developer", "demo-developer")] {
            let session = session_of(&store, name, secret).await;
            let all: Vec<_> = (0..100).map(|_| hold(&connections, "127.0.0.1", &session)).collect();
            held.push(all.iter().filter(|(.., holds)| *holds).count());
            others.push(all);
        }
        assert_eq!(held, [PER_USER_MAX; 2], "each of them is being answered");
        assert!(stays(&mut display));
        let (mut newest, _work, holds) = hold(&connections, "127.0.0.1", &operator);
        assert!(holds && stays(&mut newest));
        // Without the session it is one of many again.
        display.0.work().unwrap().handle().hold(None);
        let flood: Vec<_> =
            (0..500).map(|_| connections.enter(ip("127.0.0.1"), Caller::Vehicle).unwrap()).collect();
        assert!(!stays(&mut display) && stays(&mut newest));
        drop((strangers, others, flood));
    }
}
