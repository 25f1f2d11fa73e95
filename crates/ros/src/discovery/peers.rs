//! Announces our participant by unicast to hosts that multicast does not reach.
//!
//! The DDS library announces itself by multicast and to this machine only. But it answers every participant
//! that it hears of, and keeps up that contact. So only the first message is missing: one datagram with the
//! announcement of the Simple Participant Discovery Protocol (RTPS 2.5, 8.5.3 and 9.6.2.2).

use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use tokio::net::UdpSocket;
use tokio::task::AbortHandle;

use crate::every;
use crate::name_lookup::Lookup;
use crate::options::{BridgeOptions, Interface, interfaces};
use crate::transport::Participant;
use crate::transport::ids::prefix;
use crate::transport::spdp::{self, VENDOR, discovery_port};
use telltale_clock::Clock;

/// The interval of announcements, and so the time to find a peer that is started later.
const PERIOD: Duration = Duration::from_secs(2);
/// The number of participants that are addressed on one host: ROS 2 counts them from 0.
const PARTICIPANTS: u16 = 32;
/// The longest wait for name resolution in one round.
const RESOLVING: Duration = Duration::from_millis(500);

/// The lease of the announcement, as the library sets it. The library renews it more often.
const LEASE_S: u32 = 60;
/// Announcer and detector of participants, publications, subscriptions and topics, and the messages that assert
/// a participant's liveliness (RTPS 2.5, 9.3.2.12), as the library has them.
const BUILTIN_ENDPOINTS: u32 = 0b1111_0011_1111;

/// Announces until it is dropped.
#[derive(Debug)]
pub struct Announcer(AbortHandle);

impl Drop for Announcer {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Nothing is announced if no peers are listed.
pub fn announce(participant: &Participant, options: &BridgeOptions) -> Option<Announcer> {
    if options.peers.is_empty() {
        return None;
    }
    let own = Own {
        guid: participant.guid(),
        domain: options.domain,
        participant: participant.id(),
        interface: options.interface,
    };
    let clock = Clock::start();
    let peers = options.peers.iter().map(|peer| Peer::new(peer, clock)).collect();
    Some(Announcer(tokio::spawn(run(own, peers)).abort_handle()))
}

struct Own {
    guid: [u8; 16],
    domain: u16,
    participant: u16,
    interface: Interface,
}

/// A host, and the error that was last reported for it.
struct Peer {
    name: String,
    lookup: Lookup,
    trouble: Option<String>,
}

impl Peer {
    fn new(name: &str, clock: Clock) -> Peer {
        Peer { name: name.to_owned(), lookup: Lookup::of_host(name, clock), trouble: None }
    }

    /// Sends the message to every participant that the host may have. An error is returned when it begins,
    /// and again if it returns after a round without one.
    async fn speak(&mut self, socket: &UdpSocket, message: &[u8], domain: u16) -> Option<String> {
        // A resolver without an answer may have one in the next round.
        let resolved = tokio::time::timeout(RESOLVING, self.lookup.addresses()).await.ok()?;
        let v4 = |addresses: Vec<SocketAddr>| addresses.iter().map(SocketAddr::ip).find(|ip| ip.is_ipv4());
        let mut trouble = None;
        match resolved.map(v4) {
            Err(error) => trouble = Some(error.to_string()),
            Ok(None) => trouble = Some("it has no IPv4 address".to_owned()),
            Ok(Some(ip)) => {
                for number in 0..PARTICIPANTS {
                    if let Err(error) = socket.send_to(message, (ip, discovery_port(domain, number))).await {
                        trouble = Some(error.to_string());
                    }
                }
            }
        }
        let is_news = trouble.is_some() && self.trouble.is_none();
        self.trouble = trouble;
        self.trouble.clone().filter(|_| is_news)
    }
}

async fn run(own: Own, mut peers: Vec<Peer>) {
    let socket = match UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).await {
        Ok(socket) => socket,
        Err(error) => {
            tracing::error!("the hosts given as peers cannot be spoken to: {error}");
            return;
        }
    };
    let mut rounds = every(PERIOD);
    loop {
        rounds.tick().await;
        let message = announcement(&own, &addresses(own.interface));
        for peer in &mut peers {
            if let Some(trouble) = peer.speak(&socket, &message, own.domain).await {
                tracing::warn!("the peer {} cannot be spoken to: {trouble}", peer.name);
            }
        }
    }
}

/// The addresses by which others reach us.
fn addresses(interface: Interface) -> Vec<Ipv4Addr> {
    match interface {
        Interface::Ip(ip) => vec![ip],
        Interface::Loopback => vec![Ipv4Addr::LOCALHOST],
        Interface::All => {
            let all = interfaces::addresses().unwrap_or_default().into_iter().map(|address| address.ip);
            all.filter(|ip| !ip.is_loopback()).collect()
        }
    }
}

/// The announcement as bytes, in little endian.
fn announcement(own: &Own, addresses: &[Ipv4Addr]) -> Vec<u8> {
    // Parameters in little endian.
    let mut content = vec![0, 3, 0, 0];
    let mut parameter = |id: u16, value: &[u8]| content.extend(spdp::parameter(id, value));
    parameter(0x15, &[2, 3, 0, 0]);
    parameter(0x16, &[VENDOR[0], VENDOR[1], 0, 0]);
    parameter(0x50, &own.guid);
    let discovery = discovery_port(own.domain, own.participant);
    for ip in addresses {
        parameter(0x32, &locator(*ip, discovery));
        parameter(0x31, &locator(*ip, discovery + 1));
    }
    parameter(0x58, &BUILTIN_ENDPOINTS.to_le_bytes());
    parameter(0x02, &[LEASE_S.to_le_bytes(), [0; 4]].concat());
    parameter(0x01, &[]);
    // Each of the library's own announcements has a higher number.
    let data = spdp::data(spdp::PAYLOAD, 1, &content);
    [spdp::header(prefix(&own.guid)), data].concat()
}

/// UDP over IPv4.
fn locator(ip: Ipv4Addr, port: u16) -> [u8; 24] {
    let mut locator = [0; 24];
    locator[0] = 1;
    locator[4..6].copy_from_slice(&port.to_le_bytes());
    locator[20..].copy_from_slice(&ip.octets());
    locator
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn each_peer_that_cannot_be_spoken_to_is_said_once() {
        let clock = Clock::start();
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await.unwrap();
        let mut peers = ["127.0.0.1", "::1", "::2"].map(|name| Peer::new(name, clock));
        let none = Some("it has no IPv4 address");
        for expected in [[None, none, none], [None; 3]] {
            for (peer, expected) in peers.iter_mut().zip(expected) {
                let said = peer.speak(&socket, b"RTPS", 0).await;
                assert_eq!(said.as_deref(), expected, "{}", peer.name);
            }
        }
    }

    #[test]
    fn the_announcement_names_where_we_are_heard() {
        let own = Own { guid: [7; 16], domain: 1, participant: 2, interface: Interface::All };
        let message = announcement(&own, &[Ipv4Addr::new(10, 0, 0, 5)]);
        assert_eq!(&message[..20], [b"RTPS\x02\x03\x01\x12", &[7_u8; 12][..]].concat());
        let length = u16::from_le_bytes([message[22], message[23]]);
        assert_eq!(usize::from(length), message.len() - 24);
        let holds = |part: &[u8]| message.windows(part.len()).any(|window| window == part);
        assert!(holds(&locator(Ipv4Addr::new(10, 0, 0, 5), 7664)), "discovery");
        assert!(holds(&locator(Ipv4Addr::new(10, 0, 0, 5), 7665)), "messages");
    }
}
