//! The messages between the program and its DDS process: frames over a Unix socket.
//!
//! A frame is its length, followed by messages. All numbers are in little endian. Everything else is an
//! error: messages of the DDS process are trusted no more than a packet.

mod messages;

use std::net::Ipv4Addr;

use bytes::Bytes;
use tokio_util::codec::LengthDelimitedCodec;

use super::BODY_BYTES_MAX;
use super::quality::Via;
use super::{Found, Quality, RawSample, SampleId};
pub use messages::{Change, FromChild, Network, Order};
use telltale_engine::discovery::{Liveliness, LivelinessKind};
use telltale_msg::cdr::{Endian, Fault, FaultKind};
use telltale_msg::sample_bytes::Guid;

/// A frame is closed when it is longer than this; a single message may be longer.
pub const FRAME_BYTES: usize = 256 << 10;
/// The longest frame: the largest message, behind others.
pub const FRAME_BYTES_MAX: usize = BODY_BYTES_MAX + 2 * FRAME_BYTES;
/// Longer names of topics and types do not occur in ROS.
pub const NAME_BYTES_MAX: usize = 1024;

#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("byte {0} of a frame makes no sense")]
pub struct InvalidFrame(usize);

/// Finds the frames in what comes over the socket. A longer one than may be is an error.
pub fn frames() -> LengthDelimitedCodec {
    LengthDelimitedCodec::builder().little_endian().max_frame_length(FRAME_BYTES_MAX).new_codec()
}

/// Writes messages into a frame.
#[derive(Debug, Default)]
pub struct Frame(Vec<u8>);

impl Frame {
    pub fn new() -> Frame {
        Frame(vec![0; 4])
    }

    pub fn is_empty(&self) -> bool {
        self.0.len() <= 4
    }

    pub fn is_full(&self) -> bool {
        self.0.len() > FRAME_BYTES
    }

    /// The finished frame; further messages go into a new one.
    pub fn take(&mut self) -> Bytes {
        let mut bytes = std::mem::replace(&mut self.0, vec![0; 4]);
        let length = u32::try_from(bytes.len() - 4).unwrap_or(u32::MAX);
        bytes[..4].copy_from_slice(&length.to_le_bytes());
        bytes.into()
    }

    fn u8(&mut self, value: u8) -> &mut Frame {
        self.0.push(value);
        self
    }

    fn u16(&mut self, value: u16) -> &mut Frame {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u32(&mut self, value: u32) -> &mut Frame {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u64(&mut self, value: u64) -> &mut Frame {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn option(&mut self, value: Option<u64>) -> &mut Frame {
        match value {
            Some(value) => self.u8(1).u64(value),
            None => self.u8(0),
        }
    }

    fn sample_id(&mut self, value: Option<&SampleId>) -> &mut Frame {
        match value {
            Some(SampleId { writer, sequence }) => self.u8(1).guid(writer).u64(*sequence as u64),
            None => self.u8(0),
        }
    }

    fn bytes(&mut self, value: &[u8]) -> &mut Frame {
        // At once: a large message would be copied again each time that its frame grows.
        self.0.reserve(value.len() + 64);
        self.u32(u32::try_from(value.len()).unwrap_or(u32::MAX));
        self.0.extend(value);
        self
    }

    fn guid(&mut self, value: &Guid) -> &mut Frame {
        self.0.extend(value);
        self
    }

    pub fn order(&mut self, order: &Order) {
        match order {
            Order::Open(Network::Dds { domain, interfaces }) => {
                self.u8(0).u16(*domain).u8(interfaces.is_some().into());
                let interfaces = interfaces.as_deref().unwrap_or_default();
                self.u32(u32::try_from(interfaces.len()).unwrap_or(u32::MAX));
                interfaces.iter().for_each(|ip| self.0.extend(ip.octets()));
            }
            Order::Open(Network::Zenoh { domain, router }) => {
                self.u8(10).u16(*domain).u8(router.is_some().into());
                self.bytes(router.as_deref().unwrap_or_default().as_bytes());
            }
            Order::Reader { id, topic, type_name, via, depth } => {
                self.u8(1).u32(*id).bytes(topic.as_bytes()).bytes(type_name.as_bytes());
                self.u8(via_number(*via)).u32(*depth);
            }
            Order::EndReader { id } => drop(self.u8(2).u32(*id)),
            Order::Taken { id, bytes } => drop(self.u8(3).u32(*id).u32(*bytes)),
            Order::Deepen { topic, type_name, depth } => {
                self.u8(4).bytes(topic.as_bytes()).bytes(type_name.as_bytes()).u32(*depth);
            }
            Order::Writer { id, topic, type_name, quality } => {
                self.u8(5).u32(*id).bytes(topic.as_bytes()).bytes(type_name.as_bytes());
                self.u8(quality.number());
            }
            Order::Write { id, number, related, body } => {
                self.u8(6).u32(*id).u32(*number).sample_id(related.as_ref()).bytes(body);
            }
            Order::Close => drop(self.u8(7)),
            Order::Forget { participant } => self.u8(8).0.extend(participant),
            Order::FollowFirst { topic } => drop(self.u8(9).bytes(topic.as_bytes())),
        }
    }

    pub fn news(&mut self, news: &FromChild) {
        match news {
            FromChild::Ready { guid, participant } => drop(self.u8(0).guid(guid).u16(*participant)),
            FromChild::Made { id, guid } => drop(self.u8(1).u32(*id).guid(guid)),
            FromChild::Found(found) => self.found(found),
            FromChild::Gone { guid } => drop(self.u8(3).guid(guid)),
            FromChild::Sample { reader, sample } => self.sample(*reader, sample),
            FromChild::Fault { reader, reason } => drop(self.u8(5).u32(*reader).bytes(reason.as_bytes())),
            FromChild::Written { number, error } => {
                self.u8(6).u32(*number).u8(error.is_some().into());
                self.bytes(error.as_deref().unwrap_or_default().as_bytes());
            }
            FromChild::Beat { heard } => drop(self.u8(7).u64(*heard)),
            FromChild::Broken { reason } => drop(self.u8(8).bytes(reason.as_bytes())),
            FromChild::Participant { participant, change } => {
                self.u8(9).u8(*change as u8).0.extend(participant);
            }
            FromChild::Cut { of_ours, all } => drop(self.u8(10).u32(*of_ours).u32(*all)),
            FromChild::Missed { reader } => drop(self.u8(11).u32(*reader)),
        }
    }

    fn found(&mut self, found: &Found) {
        self.u8(2).guid(&found.guid).u8(found.writes.into());
        self.bytes(found.topic.as_bytes()).bytes(found.type_name.as_bytes());
        self.u8(found.reliable.into()).u8(found.transient_local.into()).option(found.deadline_ns);
        let kind = match found.liveliness.kind {
            LivelinessKind::Automatic => 0,
            LivelinessKind::ManualByParticipant => 1,
            LivelinessKind::ManualByTopic => 2,
        };
        self.u8(kind).option(found.liveliness.lease_ns).u8(found.takes);
    }

    fn sample(&mut self, reader: u32, sample: &RawSample) {
        self.u8(4).u32(reader).guid(&sample.writer).u64(sample.sequence as u64).option(sample.source);
        self.sample_id(sample.related.as_ref());
        match &sample.body {
            Ok((body, Endian::Little)) => drop(self.u8(0).bytes(body)),
            Ok((body, Endian::Big)) => drop(self.u8(1).bytes(body)),
            Err(Fault { what: FaultKind::TooLarge { bytes, .. }, .. }) => drop(self.u8(2).u64(*bytes as u64)),
            Err(Fault { what: FaultKind::Encoding([first, second]), .. }) => {
                self.u8(3).u8(*first).u8(*second);
            }
            // The adapter makes no other.
            Err(_) => drop(self.u8(3).u8(0).u8(0)),
        }
    }
}

/// Reads the messages of a frame.
struct Reading<'a> {
    frame: &'a Bytes,
    at: usize,
}

/// All orders of a frame.
///
/// # Errors
/// The frame does not consist of valid orders.
pub fn orders(frame: &Bytes) -> Result<Vec<Order>, InvalidFrame> {
    all(frame, Reading::order)
}

/// All news of a frame.
///
/// # Errors
/// The frame does not consist of valid news.
pub fn news(frame: &Bytes) -> Result<Vec<FromChild>, InvalidFrame> {
    all(frame, Reading::news)
}

fn all<'a, T>(
    frame: &'a Bytes,
    one: impl Fn(&mut Reading<'a>) -> Result<T, InvalidFrame>,
) -> Result<Vec<T>, InvalidFrame> {
    let mut reading = Reading { frame, at: 0 };
    let mut all = Vec::new();
    while reading.at < frame.len() {
        all.push(one(&mut reading)?);
    }
    Ok(all)
}

impl<'a> Reading<'a> {
    fn slice(&mut self, length: usize) -> Result<&'a [u8], InvalidFrame> {
        let nonsense = InvalidFrame(self.at);
        let end = self.at.checked_add(length).ok_or(nonsense)?;
        let slice = self.frame.get(self.at..end).ok_or(nonsense)?;
        self.at = end;
        Ok(slice)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], InvalidFrame> {
        let mut array = [0; N];
        array.copy_from_slice(self.slice(N)?);
        Ok(array)
    }

    fn u8(&mut self) -> Result<u8, InvalidFrame> {
        Ok(self.array::<1>()?[0])
    }

    fn u16(&mut self) -> Result<u16, InvalidFrame> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Result<u32, InvalidFrame> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, InvalidFrame> {
        self.array().map(u64::from_le_bytes)
    }

    /// A number below `count`.
    fn below(&mut self, count: u8) -> Result<u8, InvalidFrame> {
        let at = self.at;
        self.u8().and_then(|number| if number < count { Ok(number) } else { Err(InvalidFrame(at)) })
    }

    fn flag(&mut self) -> Result<bool, InvalidFrame> {
        Ok(self.below(2)? == 1)
    }

    fn option(&mut self) -> Result<Option<u64>, InvalidFrame> {
        Ok(if self.flag()? { Some(self.u64()?) } else { None })
    }

    fn sample_id(&mut self) -> Result<Option<SampleId>, InvalidFrame> {
        let is_some = self.flag()?;
        Ok(if is_some {
            Some(SampleId { writer: self.array()?, sequence: self.u64()? as i64 })
        } else {
            None
        })
    }

    fn bytes(&mut self, limit: usize) -> Result<&'a [u8], InvalidFrame> {
        let at = self.at;
        let length = self.u32()? as usize;
        if length > limit { Err(InvalidFrame(at)) } else { self.slice(length) }
    }

    fn body(&mut self) -> Result<Bytes, InvalidFrame> {
        // A frame lies in a buffer with others, which may be large: a body that shared it would keep all of it for as
        // long as the recorder keeps the body.
        self.bytes(BODY_BYTES_MAX).map(Bytes::copy_from_slice)
    }

    fn text(&mut self) -> Result<String, InvalidFrame> {
        let at = self.at;
        let bytes = self.bytes(NAME_BYTES_MAX)?;
        std::str::from_utf8(bytes).map(str::to_owned).map_err(|_| InvalidFrame(at))
    }

    fn order(&mut self) -> Result<Order, InvalidFrame> {
        Ok(match self.below(11)? {
            0 => {
                let (domain, is_some) = (self.u16()?, self.flag()?);
                let count = self.u32()? as usize;
                let octets = self.slice(count.saturating_mul(4))?;
                let ips = octets.chunks_exact(4).map(|ip| Ipv4Addr::new(ip[0], ip[1], ip[2], ip[3]));
                Order::Open(Network::Dds { domain, interfaces: is_some.then(|| ips.collect()) })
            }
            1 => Order::Reader {
                id: self.u32()?,
                topic: self.text()?,
                type_name: self.text()?,
                via: VIAS[usize::from(self.below(3)?)],
                depth: self.u32()?,
            },
            2 => Order::EndReader { id: self.u32()? },
            3 => Order::Taken { id: self.u32()?, bytes: self.u32()? },
            4 => Order::Deepen { topic: self.text()?, type_name: self.text()?, depth: self.u32()? },
            5 => Order::Writer {
                id: self.u32()?,
                topic: self.text()?,
                type_name: self.text()?,
                quality: Quality::ALL[usize::from(self.below(Quality::COUNT)?)],
            },
            6 => Order::Write {
                id: self.u32()?,
                number: self.u32()?,
                related: self.sample_id()?,
                body: self.body()?,
            },
            7 => Order::Close,
            8 => Order::Forget { participant: self.array()? },
            9 => Order::FollowFirst { topic: self.text()? },
            _ => {
                let (domain, is_some, router) = (self.u16()?, self.flag()?, self.text()?);
                Order::Open(Network::Zenoh { domain, router: is_some.then_some(router) })
            }
        })
    }

    fn news(&mut self) -> Result<FromChild, InvalidFrame> {
        Ok(match self.below(12)? {
            0 => FromChild::Ready { guid: self.array()?, participant: self.u16()? },
            1 => FromChild::Made { id: self.u32()?, guid: self.array()? },
            2 => FromChild::Found(self.found()?),
            3 => FromChild::Gone { guid: self.array()? },
            4 => FromChild::Sample { reader: self.u32()?, sample: self.sample()? },
            5 => FromChild::Fault { reader: self.u32()?, reason: self.text()? },
            6 => {
                let (number, is_some, text) = (self.u32()?, self.flag()?, self.text()?);
                FromChild::Written { number, error: is_some.then_some(text) }
            }
            7 => FromChild::Beat { heard: self.u64()? },
            8 => FromChild::Broken { reason: self.text()? },
            10 => FromChild::Cut { of_ours: self.u32()?, all: self.u32()? },
            11 => FromChild::Missed { reader: self.u32()? },
            _ => {
                let change = Change::ALL[usize::from(self.below(Change::ALL.len() as u8)?)];
                FromChild::Participant { participant: self.array()?, change }
            }
        })
    }

    fn found(&mut self) -> Result<Found, InvalidFrame> {
        Ok(Found {
            guid: self.array()?,
            writes: self.flag()?,
            topic: self.text()?,
            type_name: self.text()?,
            reliable: self.flag()?,
            transient_local: self.flag()?,
            deadline_ns: self.option()?,
            liveliness: Liveliness {
                kind: match self.below(3)? {
                    0 => LivelinessKind::Automatic,
                    1 => LivelinessKind::ManualByParticipant,
                    _ => LivelinessKind::ManualByTopic,
                },
                lease_ns: self.option()?,
            },
            takes: self.below(1 << Quality::COUNT)?,
        })
    }

    fn sample(&mut self) -> Result<RawSample, InvalidFrame> {
        let (writer, sequence, source) = (self.array()?, self.u64()? as i64, self.option()?);
        let related = self.sample_id()?;
        let body = match self.below(4)? {
            0 => Ok((self.body()?, Endian::Little)),
            1 => Ok((self.body()?, Endian::Big)),
            2 => {
                let bytes = usize::try_from(self.u64()?).unwrap_or(usize::MAX);
                Err(FaultKind::TooLarge { bytes, limit: BODY_BYTES_MAX })
            }
            _ => Err(FaultKind::Encoding(self.array()?)),
        };
        Ok(RawSample { writer, sequence, source, related, body: body.map_err(|what| Fault { at: 0, what }) })
    }
}

const VIAS: [Via; 3] = [Via::Reliable, Via::LastValue, Via::BestEffort];

fn via_number(via: Via) -> u8 {
    match via {
        Via::Reliable => 0,
        Via::LastValue => 1,
        Via::BestEffort => 2,
    }
}

/// A text of the DDS library, cut to the length of a message.
pub fn cut(text: &impl ToString) -> String {
    let mut text = text.to_string();
    text.truncate(text.floor_char_boundary(NAME_BYTES_MAX));
    text
}

#[cfg(test)]
mod tests;
