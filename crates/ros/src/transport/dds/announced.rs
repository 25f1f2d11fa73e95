//! The participants that announce themselves on the network, heard beside the DDS library. It takes a participant for
//! gone after one lease, in which one lost packet is enough, and does not find it again. Here a participant lives
//! for three leases.

use std::collections::BTreeMap;
use std::io;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use socket2::{Protocol, Socket, Type};
use tokio::net::UdpSocket;
use tokio::task::AbortHandle;

use super::spdp::{self, Announcement, Said};
use crate::options::interfaces;
use crate::transport::Seen;
use crate::transport::ids::Prefix;
use telltale_clock::Clock;
use telltale_engine::time::{Span, Timestamp};

/// Participants that are remembered, and the number that no vehicle exceeds.
const PARTICIPANTS_MAX: usize = 1024;
const VEHICLE_MAX: usize = 256;
/// Leases that a participant lives after its last announcement, and the shortest time of that.
const LEASES: u64 = 3;
const LIFE_MIN: Span = Span::from_secs(10);
/// A participant that is heard later than this after it left has not left: somebody else said so.
pub const LEAVING: Span = Span::from_secs(1);
/// The library keeps to longer leases than this by itself.
const LEASE_MAX: Span = Span::from_secs(100);
/// Towards the end of a life nothing is copied: a shorter lease would not be repeated in time, and a longer one would
/// outlast the life. The copies before say when it ends.
const LEASE_MIN: Span = Span::from_secs(5);
/// Participants are addressed by their number on a machine, too. This many numbers are addressed at least by others.
const NUMBERS: u16 = 10;
/// No announcement of a participant has a number as high as those of the copies.
const COPIES_FROM: u64 = 1 << 32;
/// An announcement that is sent again is no longer than this.
const KEPT_BYTES_MAX: usize = 4096;
/// The longest packet of UDP.
const PACKET_BYTES_MAX: usize = 1 << 16;

/// Whether a participant lives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Life {
    /// Its last announcement.
    Heard(Timestamp),
    /// It has not announced itself for three leases, or said that it leaves.
    Over,
    /// It was never heard here. It may announce itself to the library alone.
    Unheard,
}

/// Listens until it is dropped.
#[derive(Debug)]
pub struct Announced {
    table: Mutex<Table>,
    group: Option<Arc<UdpSocket>>,
    clock: Clock,
    copies: AtomicU64,
    listening: Vec<AbortHandle>,
}

/// One for each domain: the participants of this program share what they hear.
static LISTENERS: Mutex<BTreeMap<u16, Weak<Announced>>> = Mutex::new(BTreeMap::new());

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Announced {
    /// Listens on these networks, or on all; on those where others listen already, too.
    pub fn on(domain: u16, networks: Option<&[Ipv4Addr]>) -> Arc<Announced> {
        let mut all = lock(&LISTENERS);
        let known = all.get(&domain).and_then(Weak::upgrade);
        let announced = known.unwrap_or_else(|| {
            let announced = Announced::open(domain, networks);
            all.retain(|_, known| known.strong_count() > 0);
            all.insert(domain, Arc::downgrade(&announced));
            announced
        });
        announced.join(networks);
        announced
    }

    /// Hears nobody: for a transport without participants of DDS.
    pub fn nobody() -> Arc<Announced> {
        let (table, clock, copies) = (Mutex::default(), Clock::start(), AtomicU64::new(COPIES_FROM));
        Arc::new(Announced { table, group: None, clock, copies, listening: Vec::new() })
    }

    /// Without a socket nothing is heard here, and everything else works.
    fn open(domain: u16, networks: Option<&[Ipv4Addr]>) -> Arc<Announced> {
        let said = |what: &str, error: io::Error| {
            tracing::warn!("participants are not heard beside the DDS library, on {what}: {error}");
        };
        let group = bind(SocketAddrV4::new(spdp::GROUP, spdp::group_port(domain)), true);
        let here = match networks {
            Some([ip]) if ip.is_loopback() => *ip,
            _ => Ipv4Addr::UNSPECIFIED,
        };
        let own = |number| bind(SocketAddrV4::new(here, spdp::discovery_port(domain, number)), false);
        // The low numbers are left to participants.
        let single = (0..NUMBERS).rev().find_map(|number| own(number).ok());
        let group = group.map_err(|error| said("their group", error)).ok().map(Arc::new);
        let sockets = group.clone().into_iter().chain(single.map(Arc::new));
        Arc::new_cyclic(|announced| Announced {
            table: Mutex::default(),
            listening: sockets
                .map(|socket| tokio::spawn(listen(announced.clone(), socket)).abort_handle())
                .collect(),
            group,
            clock: Clock::start(),
            copies: AtomicU64::new(COPIES_FROM),
        })
    }

    /// Joins the group on networks that may be new. An error means that it is joined, or that the interface is gone.
    fn join(&self, networks: Option<&[Ipv4Addr]>) {
        let Some(group) = &self.group else { return };
        let every = || interfaces::addresses().unwrap_or_default().into_iter().map(|address| address.ip);
        let networks = networks.map_or_else(|| every().collect(), <[_]>::to_vec);
        for ip in networks {
            let _ = group.join_multicast_v4(spdp::GROUP, ip);
        }
    }

    fn hear(&self, packet: &[u8]) {
        if let Some(said) = spdp::read(packet) {
            lock(&self.table).hear(said, packet, self.clock.now());
        }
    }

    /// The last announcement of a participant as it was sent.
    pub fn packet(&self, prefix: &Prefix) -> Option<Box<[u8]>> {
        lock(&self.table)
            .participants
            .get(prefix)
            .map(|known| known.packet.clone())
            .filter(|it| !it.is_empty())
    }

    pub fn now(&self) -> Timestamp {
        self.clock.now()
    }

    /// Notes whose endpoints one of our participants has found.
    pub fn note_met(&self, seen: &Seen) {
        for (prefix, known) in &mut lock(&self.table).participants {
            known.is_met |= seen.has_any_of(prefix);
        }
    }

    /// The library has heard a participant, perhaps by an announcement to itself alone.
    pub fn is_heard(&self, prefix: &Prefix) {
        if let Some(known) = lock(&self.table).participants.get_mut(prefix) {
            known.heard = self.clock.now();
        }
    }

    /// A participant has left: it said so to the library, or it is our own and has ended.
    pub fn has_left(&self, prefix: &Prefix) {
        lock(&self.table).hear(Said::Leaving(*prefix), &[], self.clock.now());
    }

    pub fn life(&self, prefix: &Prefix) -> Life {
        lock(&self.table).life(prefix, self.clock.now())
    }

    /// Those that live and that we have met.
    pub fn met(&self) -> Vec<Prefix> {
        let now = self.clock.now();
        let table = lock(&self.table);
        let met = table.participants.iter().filter(|(_, known)| known.is_met && known.lives(now));
        met.map(|(prefix, _)| *prefix).collect()
    }

    /// Those whose announcements are to be repeated to a library that has discovered some itself.
    pub fn to_repeat(&self, discovered: impl Fn(&Prefix) -> bool) -> Vec<Prefix> {
        lock(&self.table).to_repeat(self.clock.now(), discovered)
    }

    /// Where a participant that lives listens for announcements.
    pub fn addresses(&self, prefix: &Prefix) -> Vec<SocketAddrV4> {
        let table = lock(&self.table);
        table.participants.get(prefix).map(|known| known.announcement.addresses()).unwrap_or_default()
    }

    /// The news of a participant for the library, as long as it lives: its lease ends when its life ends here.
    pub fn copy(&self, prefix: &Prefix) -> Option<Vec<u8>> {
        let now = self.clock.now();
        let table = lock(&self.table);
        let known = table.participants.get(prefix).filter(|known| known.lives(now))?;
        let announcement = &known.announcement;
        let lease = known.lease_of_copy(now)?;
        Some(announcement.copy(lease, self.copies.fetch_add(1, Ordering::Relaxed)))
    }
}

impl Drop for Announced {
    fn drop(&mut self) {
        self.listening.iter().for_each(AbortHandle::abort);
    }
}

/// A socket that several programs of this machine may have, or one alone.
fn bind(address: SocketAddrV4, shared: bool) -> io::Result<UdpSocket> {
    let socket = Socket::new(socket2::Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_reuse_address(shared)?;
    socket.set_nonblocking(true)?;
    socket.bind(&address.into())?;
    UdpSocket::from_std(socket.into())
}

async fn listen(announced: Weak<Announced>, socket: Arc<UdpSocket>) {
    let mut packet = vec![0; PACKET_BYTES_MAX];
    loop {
        let received = socket.recv(&mut packet).await;
        // While it is being made, or after its end, nobody asks what was heard.
        let Some(announced) = announced.upgrade() else { continue };
        if let Ok(length) = received {
            announced.hear(&packet[..length]);
        }
    }
}

/// The participants by what they said last.
#[derive(Debug, Default)]
struct Table {
    participants: BTreeMap<Prefix, Known>,
}

#[derive(Debug)]
struct Known {
    announcement: Announcement,
    /// As it was sent; empty if that is large.
    packet: Box<[u8]>,
    heard: Timestamp,
    is_met: bool,
    left: Option<Timestamp>,
}

impl Known {
    fn ends(&self) -> Timestamp {
        let lease = self.announcement.lease.min(LEASE_MAX);
        self.heard + Span::from_nanos(lease.as_nanos() * LEASES).max(LIFE_MIN)
    }

    fn lives(&self, now: Timestamp) -> bool {
        self.left.is_none() && now < self.ends()
    }

    fn lease_of_copy(&self, now: Timestamp) -> Option<Span> {
        let lease = self.announcement.lease;
        let left = if lease > LEASE_MAX { lease } else { self.ends().since(now) };
        (left >= LEASE_MIN).then_some(left)
    }
}

impl Table {
    fn hear(&mut self, said: Said, packet: &[u8], now: Timestamp) {
        let announcement = match said {
            Said::Leaving(prefix) => {
                if let Some(known) = self.participants.get_mut(&prefix) {
                    known.left = Some(now);
                }
                return;
            }
            Said::Here(announcement) => announcement,
        };
        let packet = Box::from(if packet.len() > KEPT_BYTES_MAX { &[] } else { packet });
        if let Some(known) = self.participants.get_mut(&announcement.prefix) {
            // Its messages from before it left may come by another way.
            if known.left.is_none_or(|left| now.since(left) >= LEAVING) {
                (known.announcement, known.packet) = (announcement, packet);
                (known.heard, known.left) = (now, None);
            }
            return;
        }
        if self.participants.len() >= PARTICIPANTS_MAX {
            self.participants.retain(|_, known| known.lives(now));
        }
        // A stranger makes room for a stranger; those that we have met stay.
        if self.participants.len() >= PARTICIPANTS_MAX {
            let strangers = self.participants.iter().filter(|(_, known)| !known.is_met);
            let Some(oldest) = strangers.min_by_key(|(_, known)| known.heard).map(|(prefix, _)| *prefix)
            else {
                return;
            };
            self.participants.remove(&oldest);
        }
        let prefix = announcement.prefix;
        self.participants
            .insert(prefix, Known { announcement, packet, heard: now, is_met: false, left: None });
    }

    fn life(&self, prefix: &Prefix, now: Timestamp) -> Life {
        match self.participants.get(prefix) {
            None => Life::Unheard,
            Some(known) if known.lives(now) => Life::Heard(known.heard),
            Some(_) => Life::Over,
        }
    }

    /// Those that we have met, and others that the library has discovered itself: a packet that it does not survive must
    /// not be repeated to the next one. In a flood, with more participants than a vehicle has, those that we have met.
    fn to_repeat(&self, now: Timestamp, discovered: impl Fn(&Prefix) -> bool) -> Vec<Prefix> {
        let is_flood = self.participants.len() > VEHICLE_MAX;
        let living = self.participants.iter().filter(|(_, known)| known.lives(now));
        let wanted = living.filter(|(prefix, known)| known.is_met || !is_flood && discovered(prefix));
        wanted.map(|(prefix, _)| *prefix).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::spdp::tests::here;
    use super::*;

    fn at(seconds: u64) -> Timestamp {
        Timestamp::from_millis(1000 * seconds)
    }

    #[test]
    fn a_participant_lives_for_three_leases_or_until_it_leaves() {
        let mut table = Table::default();
        table.hear(Said::Here(here(1, 10)), &[], at(100));
        table.hear(Said::Here(here(2, 1)), &[], at(100));
        let life = |table: &Table, prefix, seconds| table.life(&[prefix; 12], at(seconds));
        assert_eq!(life(&table, 1, 129), Life::Heard(at(100)));
        assert_eq!(life(&table, 1, 130), Life::Over);
        assert_eq!([life(&table, 2, 109), life(&table, 2, 110)], [Life::Heard(at(100)), Life::Over]);
        assert_eq!(life(&table, 3, 100), Life::Unheard);
        assert_eq!(table.to_repeat(at(109), |_| true).len(), 2);
        assert_eq!(table.to_repeat(at(110), |_| true), [[1; 12]]);
        table.hear(Said::Leaving([1; 12]), &[], at(111));
        table.hear(Said::Here(here(1, 10)), &[], at(111));
        assert_eq!((life(&table, 1, 111), table.to_repeat(at(111), |_| true).len()), (Life::Over, 0));
        table.hear(Said::Here(here(1, 10)), &[], at(112));
        assert_eq!(life(&table, 1, 112), Life::Heard(at(112)), "somebody else said that it left");
    }

    #[test]
    fn no_copy_outlasts_the_life_of_its_participant() {
        let mut table = Table::default();
        for (prefix, lease) in [(1, 10), (2, 1), (3, 1000)] {
            table.hear(Said::Here(here(prefix, lease)), &[], at(100));
        }
        // When what the library was told ends, for a copy at each of these seconds.
        let ends = |prefix: u8, seconds: u64| {
            let lease = table.participants[&[prefix; 12]].lease_of_copy(at(seconds));
            lease.map(|lease| (at(seconds) + lease).as_nanos() / 1_000_000_000)
        };
        assert_eq!(
            [100, 110, 125, 126, 129].map(|it| ends(1, it)),
            [Some(130), Some(130), Some(130), None, None]
        );
        assert_eq!([100, 105, 106].map(|it| ends(2, it)), [Some(110), Some(110), None]);
        assert_eq!(ends(3, 126), Some(1126));
    }

    #[test]
    fn in_a_flood_those_that_we_have_met_are_kept_and_repeated_alone() {
        let mut table = Table::default();
        table.hear(Said::Here(here(1, 10)), &[], at(100));
        table.participants.get_mut(&[1; 12]).unwrap().is_met = true;
        for number in 0..3 * PARTICIPANTS_MAX as u32 {
            let mut prefix = [9; 12];
            prefix[..4].copy_from_slice(&number.to_le_bytes());
            let mut stranger = here(9, 10);
            stranger.prefix = prefix;
            table.hear(Said::Here(stranger), &[], at(101));
        }
        assert_eq!(table.participants.len(), PARTICIPANTS_MAX);
        assert_eq!(table.to_repeat(at(102), |_| true), [[1; 12]]);
        let mut table = Table::default();
        table.hear(Said::Here(here(1, 10)), &[], at(100));
        table.hear(Said::Here(here(2, 10)), &[], at(100));
        let discovered = |prefix: &Prefix| *prefix == [2; 12];
        assert_eq!(table.to_repeat(at(101), discovered), [[2; 12]], "the library has survived it");
    }
}
