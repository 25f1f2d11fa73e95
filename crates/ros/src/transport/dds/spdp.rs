//! Announcements of participants, by the Simple Participant Discovery Protocol (RTPS 2.5, 8.5.3 and 9.6.2.2): read
//! from the network, and copied for the DDS library.

use std::net::{Ipv4Addr, SocketAddrV4};

use crate::transport::ids::{PREFIX, Prefix, prefix};
use telltale_engine::time::Span;
use telltale_msg::sample_bytes::Guid;

/// The group to which participants announce themselves.
pub const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);

const PARTICIPANT_READER: [u8; 4] = [0, 1, 0, 0xc7];
const PARTICIPANT_WRITER: [u8; 4] = [0, 1, 0, 0xc2];
/// The library's vendor, and ours.
pub const VENDOR: [u8; 2] = [0x01, 0x12];

const HEADER: usize = 20;
const DATA: u8 = 0x15;
const PAD: u8 = 0x01;
const INFO_TS: u8 = 0x09;
const INFO_SRC: u8 = 0x0c;

/// What a DATA holds, as its flags.
const INLINE_QOS: u8 = 2;
pub const PAYLOAD: u8 = 4;

const SENTINEL: u16 = 0x01;
const LEASE: u16 = 0x02;
const PARTICIPANT_GUID: u16 = 0x50;
const DISCOVERY_ADDRESS: u16 = 0x32;
const KEY_HASH: u16 = 0x70;
const STATUS: u16 = 0x71;

/// The kind of an address: UDP over IPv4.
const UDP_V4: u32 = 1;
/// More addresses of one participant are not spoken to.
const ADDRESSES_MAX: usize = 8;
/// No announcement of a participant has a number as high.
const LAST: u64 = 1 << 32;
/// It is disposed of, and its writer is gone.
const GONE: [u8; 4] = [0, 0, 0, 3];

/// The lease of a participant that announces none, as the library takes it.
const LEASE_DEFAULT: Span = Span::from_secs(60);
/// The part of a second, in 2^-32 s, in the leases of copies: so they are told from what participants say themselves.
const COPY_MARK: u32 = 1 << 16;
/// A longer announcement is not kept: the longest known ones have some two kilobytes.
const BYTES_MAX: usize = 8 << 10;

/// The port on which participants listen for announcements to the group (RTPS 2.5, 9.6.2.3).
pub fn group_port(domain: u16) -> u16 {
    7400 + 250 * domain
}

/// The port on which one participant of a machine listens for announcements.
pub fn discovery_port(domain: u16, participant: u16) -> u16 {
    7410 + 250 * domain + 2 * participant
}

/// Whether a copy has this lease.
pub fn is_of_copy(lease_ns: i64) -> bool {
    lease_ns % 1_000_000_000 == (i64::from(COPY_MARK) * 1_000_000_000) >> 32
}

/// The announcement of a participant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Said {
    Here(Announcement),
    Leaving(Prefix),
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Announcement {
    pub prefix: Prefix,
    pub lease: Span,
    version: [u8; 2],
    vendor: [u8; 2],
    is_little: bool,
    /// Everything but the lease and the end.
    parameters: Box<[u8]>,
}

/// Reads a packet. `None` if no participant speaks of itself in it.
pub fn read(packet: &[u8]) -> Option<Said> {
    let header = packet.get(..HEADER).filter(|header| header.starts_with(b"RTPS"))?;
    let prefix: Prefix = header[8..].try_into().ok()?;
    let mut rest = &packet[HEADER..];
    while let Some((&[kind, flags, low, high], behind)) = rest.split_first_chunk() {
        let length = match usize::from(number(flags & 1 == 1, [low, high])) {
            // It reaches to the end of the packet.
            0 if kind != PAD && kind != INFO_TS => behind.len(),
            length => length,
        };
        let body = behind.get(..length)?;
        rest = &behind[length..];
        match kind {
            // The rest speaks for another participant.
            INFO_SRC => return None,
            DATA if body.get(8..12) == Some(&PARTICIPANT_WRITER) => {
                return payload(body, flags).map_or(Some(Said::Leaving(prefix)), |payload| {
                    let (version, vendor) = ([header[4], header[5]], [header[6], header[7]]);
                    announcement(payload, prefix).map(|(lease, is_little, parameters)| {
                        Said::Here(Announcement { prefix, lease, version, vendor, is_little, parameters })
                    })
                });
            }
            _ => {}
        }
    }
    None
}

/// The data of a DATA; none if it disposes of what it speaks of.
fn payload(body: &[u8], flags: u8) -> Option<&[u8]> {
    let is_little = flags & 1 == 1;
    let (has_inline_qos, has_data) = (flags & INLINE_QOS != 0, flags & PAYLOAD != 0);
    let to_inline_qos = body.get(2..4)?.try_into().ok()?;
    let mut rest = body.get(4 + usize::from(number(is_little, to_inline_qos))..)?;
    if has_inline_qos {
        while let (Some((id, _)), behind) = next_parameter(rest, is_little)? {
            rest = behind;
            if id == SENTINEL {
                break;
            }
        }
    }
    has_data.then_some(rest)
}

/// The lease, the byte order and the other parameters.
fn announcement(payload: &[u8], prefix: Prefix) -> Option<(Span, bool, Box<[u8]>)> {
    let is_little = match payload.get(..2)? {
        [0, 2] => false,
        [0, 3] => true,
        _ => return None,
    };
    let (mut lease, mut is_own, mut parameters) = (LEASE_DEFAULT, false, Vec::new());
    let mut rest = payload.get(4..)?;
    loop {
        let before = rest;
        let (Some((id, value)), behind) = next_parameter(rest, is_little)? else { return None };
        rest = behind;
        match id {
            SENTINEL => break,
            LEASE => lease = read_lease(value, is_little)?,
            _ => {
                is_own |= id == PARTICIPANT_GUID && value.starts_with(&prefix);
                parameters.extend(&before[..before.len() - behind.len()]);
            }
        }
    }
    (is_own && parameters.len() <= BYTES_MAX).then(|| (lease, is_little, parameters.into()))
}

type Parameter<'a> = (u16, &'a [u8]);

/// The first parameter of a list, and the rest. `None` outside if the list is cut, inside at its end.
fn next_parameter(list: &[u8], is_little: bool) -> Option<(Option<Parameter<'_>>, &[u8])> {
    let (&[a, b, c, d], behind) = list.split_first_chunk()?;
    let (id, length) = (number(is_little, [a, b]), usize::from(number(is_little, [c, d])));
    if id == SENTINEL {
        return Some((Some((id, &[])), behind));
    }
    let value = behind.get(..length)?;
    Some((Some((id, value)), &behind[length..]))
}

fn read_lease(value: &[u8], is_little: bool) -> Option<Span> {
    let seconds: [u8; 4] = value.get(..4)?.try_into().ok()?;
    let seconds = if is_little { i32::from_le_bytes(seconds) } else { i32::from_be_bytes(seconds) };
    // A part of a second counts as none.
    Some(Span::from_secs(u64::try_from(seconds).unwrap_or(0)))
}

fn address(value: &[u8], is_little: bool) -> Option<SocketAddrV4> {
    let (head, ip) = (value.first_chunk::<8>()?, value.get(20..24)?);
    let word = |bytes: &[u8]| {
        let bytes = bytes.try_into().ok()?;
        Some(if is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    };
    let (kind, port) = (word(&head[..4])?, u16::try_from(word(&head[4..])?).ok()?);
    let ip: [u8; 4] = ip.try_into().ok()?;
    (kind == UDP_V4 && port > 0).then(|| SocketAddrV4::new(ip.into(), port))
}

fn number(is_little: bool, bytes: [u8; 2]) -> u16 {
    if is_little { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) }
}

/// The goodbye of a participant. The library's own goodbye names the participant in a payload alone, which
/// Fast DDS does not read.
pub fn goodbye(own: &Guid) -> Vec<u8> {
    let parameters = [parameter(KEY_HASH, own), parameter(STATUS, &GONE), parameter(SENTINEL, &[])];
    [header(prefix(own)), data(INLINE_QOS, LAST, &parameters.concat())].concat()
}

/// The beginning of a packet.
pub fn header(sender: Prefix) -> Vec<u8> {
    [&b"RTPS\x02\x03"[..], &VENDOR, &sender].concat()
}

/// DATA of the writer of participants, in little endian, with what `holds` says.
pub fn data(holds: u8, sequence: u64, content: &[u8]) -> Vec<u8> {
    let mut body = vec![0, 0, 16, 0];
    body.extend(PARTICIPANT_READER);
    body.extend(PARTICIPANT_WRITER);
    body.extend(((sequence >> 32) as u32).to_le_bytes());
    body.extend((sequence as u32).to_le_bytes());
    body.extend(content);
    [&[DATA, 1 | holds][..], &(body.len() as u16).to_le_bytes(), &body].concat()
}

/// A parameter in little endian.
pub fn parameter(id: u16, value: &[u8]) -> Vec<u8> {
    [&id.to_le_bytes()[..], &(value.len() as u16).to_le_bytes(), value].concat()
}

impl Announcement {
    /// Where the participant listens for announcements.
    pub fn addresses(&self) -> Vec<SocketAddrV4> {
        let mut addresses = Vec::new();
        let mut rest = &*self.parameters;
        while let Some((Some((id, value)), behind)) = next_parameter(rest, self.is_little) {
            rest = behind;
            if id == DISCOVERY_ADDRESS && addresses.len() < ADDRESSES_MAX {
                addresses.extend(address(value, self.is_little));
            }
        }
        addresses
    }

    /// The announcement as a packet for the library: the participant seems to say it now, with this lease. A number
    /// that the library has seen before would be taken for a repetition.
    ///
    /// The packet itself names no sender: the library would think that the participant is where the packet comes
    /// from.
    pub fn copy(&self, lease: Span, sequence: u64) -> Vec<u8> {
        let seconds = i32::try_from(lease.as_millis().div_ceil(1000)).unwrap_or(i32::MAX);
        let pair = |value: u16| if self.is_little { value.to_le_bytes() } else { value.to_be_bytes() };
        let mut content = vec![0, if self.is_little { 3 } else { 2 }, 0, 0];
        content.extend([pair(LEASE), pair(8)].concat());
        content.extend(if self.is_little { seconds.to_le_bytes() } else { seconds.to_be_bytes() });
        content.extend(if self.is_little { COPY_MARK.to_le_bytes() } else { COPY_MARK.to_be_bytes() });
        content.extend(&*self.parameters);
        content.extend([pair(SENTINEL), pair(0)].concat());
        let mut packet = header([0; PREFIX]);
        packet.extend([INFO_SRC, 1, 20, 0, 0, 0, 0, 0]);
        packet.extend(self.version);
        packet.extend(self.vendor);
        packet.extend(self.prefix);
        packet.extend(data(PAYLOAD, sequence, &content));
        packet
    }
}

#[cfg(test)]
pub mod tests {
    use proptest::prelude::*;

    use super::*;

    fn locator(kind: u32, port: u32, ip: [u8; 4]) -> Vec<u8> {
        [&kind.to_le_bytes()[..], &port.to_le_bytes(), &[0; 12], &ip].concat()
    }

    /// As a participant announces itself that speaks little endian.
    pub fn packet(prefix: u8, lease_s: i32) -> Vec<u8> {
        let guid = [&[prefix; PREFIX][..], &[0, 0, 1, 0xc1]].concat();
        let lease = [lease_s.to_le_bytes(), [0; 4]].concat();
        let parameters = [
            parameter(PARTICIPANT_GUID, &guid),
            parameter(LEASE, &lease),
            parameter(DISCOVERY_ADDRESS, &locator(UDP_V4, 7412, [10, 0, 0, prefix])),
            // Over IPv6, and none at all.
            parameter(DISCOVERY_ADDRESS, &locator(2, 7412, [0; 4])),
            parameter(DISCOVERY_ADDRESS, &locator(UDP_V4, 0x1_0000, [10, 0, 0, 1])),
            parameter(0x58, &[0x3f, 0, 0, 0]),
            parameter(SENTINEL, &[]),
        ];
        let inline_qos = [parameter(0x70, &guid), parameter(SENTINEL, &[])].concat();
        let numbers = [0, 0, 0, 0, 1, 0, 0, 0];
        let body = [
            &[0, 0, 16, 0][..],
            &[0; 4],
            &PARTICIPANT_WRITER,
            &numbers,
            &inline_qos,
            &[0, 3, 0, 0],
            &parameters.concat(),
        ]
        .concat();
        let time = [INFO_TS, 1, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        let data = [&[DATA, 0b0111][..], &(body.len() as u16).to_le_bytes(), &body].concat();
        [&b"RTPS\x02\x01\x01\x10"[..], &[prefix; PREFIX], &time, &data].concat()
    }

    pub fn here(prefix: u8, lease_s: i32) -> Announcement {
        let Some(Said::Here(announcement)) = read(&packet(prefix, lease_s)) else { panic!() };
        announcement
    }

    #[test]
    fn every_domain_has_ports_for_all_participants() {
        assert_eq!(group_port(0), 7400);
        assert_eq!(discovery_port(0, 0), 7410);
        assert_eq!(discovery_port(7, 3), 9166);
        assert_eq!(discovery_port(crate::DOMAIN_MAX, 31), 65_472);
    }

    #[test]
    fn an_announcement_is_read_and_its_copy_says_the_same_with_another_lease() {
        let said = here(7, 10);
        assert_eq!((said.prefix, said.lease), ([7; PREFIX], Span::from_secs(10)));
        let copy = said.copy(Span::from_millis(24_100), (1 << 32) + 5);
        // Nobody is the sender; the source is named behind.
        assert_eq!(copy[8..HEADER], [0; PREFIX]);
        assert_eq!(read(&copy), None);
        assert_eq!(copy[HEADER..HEADER + 4], [INFO_SRC, 1, 20, 0]);
        let inner = [&b"RTPS\x02\x01\x01\x10"[..], &[7; PREFIX], &copy[HEADER + 24..]].concat();
        let Some(Said::Here(again)) = read(&inner) else { panic!("{inner:x?}") };
        assert_eq!(again.lease, Span::from_secs(25));
        let lease = |fraction| rustdds::Duration::from_secs(25).to_nanoseconds() + fraction;
        assert_eq!([lease(15_258), lease(0), lease(500_000_000)].map(is_of_copy), [true, false, false]);
        assert_eq!(Announcement { lease: said.lease, ..again }, said);
    }

    #[test]
    fn a_participant_that_leaves_says_so_without_data() {
        let mut leaving = packet(7, 10);
        let flags = HEADER + 12 + 1;
        // A key in place of data.
        leaving[flags] = 0b1011;
        assert_eq!(read(&leaving), Some(Said::Leaving([7; PREFIX])));
        // Another writer's data.
        leaving[HEADER + 12 + 4 + 11] = 0xc3;
        assert_eq!(read(&leaving), None);
    }

    #[test]
    fn a_goodbye_is_read_as_one_and_an_announcement_says_where_to_send_it() {
        let own = [[7; PREFIX].as_slice(), &[0, 0, 1, 0xc1]].concat().try_into().unwrap();
        let goodbye = goodbye(&own);
        assert_eq!(read(&goodbye), Some(Said::Leaving([7; PREFIX])));
        let key = [&[0x70, 0, 16, 0], own.as_slice()].concat();
        assert!(goodbye.windows(key.len()).any(|window| window == key), "Fast DDS reads nothing else");
        assert_eq!(here(7, 10).addresses(), [SocketAddrV4::new([10, 0, 0, 7].into(), 7412)]);
    }

    #[test]
    fn who_speaks_for_another_is_not_heard() {
        let mut forged = packet(7, 10);
        forged[8..HEADER].fill(6);
        assert_eq!(read(&forged), None);
    }

    proptest! {
        #[test]
        fn garbage_is_refused_or_harmless(at in 0_usize..200, value in any::<u8>(), cut in 0_usize..200) {
            let mut bytes = packet(7, 10);
            let at = at % bytes.len();
            bytes[at] = value;
            bytes.truncate(bytes.len().saturating_sub(cut));
            if let Some(Said::Here(announcement)) = read(&bytes) {
                let _ = announcement.addresses();
            }
        }
    }
}
