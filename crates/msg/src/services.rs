//! The requests and replies of Telltale's services on the wire, as Cyclone DDS and Fast DDS write them under
//! ROS 2.
//!
//! rmw_cyclonedds puts 16 bytes before each request and reply, which name the client and number
//! its requests; rmw_fastrtps has them in the protocol. Topics and types are the same, so a server tells by each
//! request which of the two its client is.

use super::cdr::{Endian, Reader, Writer};
use super::messages::dds_type_name;
use super::sample_bytes::Guid;
use telltale_engine::model::service::Service;

/// A longer argument is refused: names of nodes are shorter.
pub const ARGUMENT_BYTES_MAX: usize = 1024;
/// The longest message of a reply.
pub const MESSAGE_BYTES_MAX: usize = 8 << 10;

/// The vendor id of Fast DDS, with which the GUIDs of its participants begin (RTPS 2.5, 9.3.1.5).
const FAST_DDS: [u8; 2] = [0x01, 0x0f];
/// In its place for a session of Zenoh, whose requests have no header either. No vendor of DDS has it.
pub const ZENOH: [u8; 2] = *b"zn";

/// How a client knows the reply to its request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Correlation {
    /// By the first bytes of the body, which the reply repeats.
    Header { client: u64, sequence: i64 },
    /// By the identity of the sample, which the protocol carries.
    Sample,
}

/// A request as it was received.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    pub correlation: Correlation,
    /// The argument; empty for a service without one. Or what is wrong with it.
    pub argument: Result<Box<str>, &'static str>,
}

/// The reply to a request: each type of the services has these two fields.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply {
    pub success: bool,
    pub message: Box<str>,
}

impl Reply {
    pub fn done(message: impl Into<Box<str>>) -> Reply {
        Reply { success: true, message: message.into() }
    }

    pub fn refused(message: impl Into<Box<str>>) -> Reply {
        Reply { success: false, message: message.into() }
    }
}

/// The type that every ROS 2 installation has for a service.
const fn type_name(service: Service) -> &'static str {
    if service.has_argument() { "diagnostic_msgs/srv/AddDiagnostics" } else { "std_srvs/srv/Trigger" }
}

/// The names of the requests' type and of the replies' type on the wire.
pub fn dds_types(service: Service) -> [String; 2] {
    // A name with three parts always has a name on the wire.
    ["Request", "Response"]
        .map(|part| dds_type_name(&format!("{}_{part}", type_name(service))).unwrap_or_default())
}

impl Request {
    /// Reads the body of a request by this writer. What cannot be read is answered too, so a request always
    /// has a correlation.
    pub fn read(service: Service, body: &[u8], endian: Endian, writer: &Guid) -> Request {
        let has_no_header = writer.starts_with(&FAST_DDS) || writer.starts_with(&ZENOH);
        let header = header(body, endian);
        if !service.has_argument() {
            // An empty request has one byte, and up to three more of padding.
            let correlation = header.filter(|_| !has_no_header).unwrap_or(Correlation::Sample);
            return Request { correlation, argument: Ok(Box::default()) };
        }
        let plain = (Correlation::Sample, text(body, 0, endian));
        let with_header = header.map(|header| (header, text(body, HEADER_BYTES, endian)));
        let [first, second] =
            if has_no_header { [Some(plain), with_header] } else { [with_header, Some(plain)] };
        let mut forms = [first, second].into_iter().flatten().peekable();
        let likely = forms.peek().map_or(Correlation::Sample, |(correlation, _)| *correlation);
        let (correlation, bytes) = forms.find(|(_, bytes)| bytes.is_some()).unwrap_or((likely, None));
        let argument = match bytes {
            Some(bytes) if bytes.len() > ARGUMENT_BYTES_MAX => Err("the argument is too long"),
            Some(bytes) => Ok(String::from_utf8_lossy(bytes).trim().into()),
            None => Err(
                "the request has another type: it needs one string, as diagnostic_msgs/srv/AddDiagnostics has",
            ),
        };
        Request { correlation, argument }
    }
}

pub(crate) const HEADER_BYTES: usize = 16;

pub(crate) fn header(body: &[u8], endian: Endian) -> Option<Correlation> {
    let mut reader = Reader::new(body, endian);
    let client = u64::from_le_bytes(reader.scalar().ok()?);
    let sequence = i64::from_le_bytes(reader.scalar().ok()?);
    Some(Correlation::Header { client, sequence })
}

/// The string behind so many bytes, if nothing but padding follows it. An empty string has its terminator: four
/// zeros are an empty request.
fn text(body: &[u8], behind: usize, endian: Endian) -> Option<&[u8]> {
    let mut reader = Reader::new(body, endian);
    reader.octets(behind).ok()?;
    reader.clone().u32().ok().filter(|length| *length > 0)?;
    let text = reader.string().ok()?;
    (reader.remaining() < 4).then_some(text)
}

impl Correlation {
    /// The body of a reply.
    pub fn reply(self, reply: &Reply) -> Vec<u8> {
        let message = &reply.message[..reply.message.floor_char_boundary(MESSAGE_BYTES_MAX)];
        let mut writer = Writer::with_capacity(message.len() + 32);
        if let Correlation::Header { client, sequence } = self {
            writer.octets(&client.to_le_bytes());
            writer.octets(&sequence.to_le_bytes());
        }
        writer.u8(u8::from(reply.success));
        writer.string(message);
        writer.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLONE: Guid = [1, 0x10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1];
    const FAST: Guid = [1, 0x0f, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1];
    const HEADER: Correlation = Correlation::Header { client: 0x0102_0304_0506_0708, sequence: 9 };

    fn with_text(header: bool, text: &[u8], endian: Endian) -> Vec<u8> {
        let order = |mut bytes: Vec<u8>| {
            if endian == Endian::Big {
                bytes.reverse();
            }
            bytes
        };
        let mut body = Vec::new();
        if header {
            body.extend(order(0x0102_0304_0506_0708_u64.to_le_bytes().to_vec()));
            body.extend(order(9_u64.to_le_bytes().to_vec()));
        }
        body.extend(order((text.len() as u32 + 1).to_le_bytes().to_vec()));
        body.extend(text);
        body.push(0);
        body.resize(body.len().next_multiple_of(4), 0);
        body
    }

    #[test]
    fn requests_of_both_vendors_are_told_apart_in_both_orders_of_bytes() {
        for endian in [Endian::Little, Endian::Big] {
            for text in ["", "7", "sensors/lidar", "seventeen letters"] {
                for (writer, header) in [(CYCLONE, true), (FAST, false), ([7; 16], true), ([7; 16], false)] {
                    let body = with_text(header, text.as_bytes(), endian);
                    let found = Request::read(Service::Acknowledge, &body, endian, &writer);
                    let correlation = if header { HEADER } else { Correlation::Sample };
                    assert_eq!(found, Request { correlation, argument: Ok(text.into()) }, "{endian:?}");
                }
            }
        }
        let mut empty = with_text(true, b"", Endian::Little)[..HEADER_BYTES].to_vec();
        empty.push(0);
        let read = |body: &[u8], writer| Request::read(Service::Reload, body, Endian::Little, &writer);
        assert_eq!(read(&empty, CYCLONE), Request { correlation: HEADER, argument: Ok("".into()) });
        assert_eq!(read(&[0], FAST), Request { correlation: Correlation::Sample, argument: Ok("".into()) });
        assert_eq!(read(&[], FAST), Request { correlation: Correlation::Sample, argument: Ok("".into()) });
    }

    #[test]
    fn what_cannot_be_read_can_be_answered() {
        let long = vec![b'x'; ARGUMENT_BYTES_MAX + 1];
        for (body, writer, correlation) in [
            (with_text(true, &long, Endian::Little), CYCLONE, HEADER),
            (with_text(false, &long, Endian::Little), FAST, Correlation::Sample),
            // A client of the type without an argument.
            ([&with_text(true, b"", Endian::Little)[..HEADER_BYTES], &[0]].concat(), CYCLONE, HEADER),
            (vec![0; 4], FAST, Correlation::Sample),
            (vec![], CYCLONE, Correlation::Sample),
            (vec![0xff; 12], FAST, Correlation::Sample),
        ] {
            let found = Request::read(Service::Reset, &body, Endian::Little, &writer);
            assert_eq!(found.correlation, correlation, "{body:?}");
            assert!(found.argument.is_err(), "{found:?}");
        }
        let bytes = with_text(false, b"a\xff", Endian::Little);
        let found = Request::read(Service::Reset, &bytes, Endian::Little, &FAST);
        assert_eq!(found.argument, Ok("a\u{fffd}".into()));
    }

    #[test]
    fn a_reply_repeats_what_its_client_asked_with() {
        let reply = Reply::done("ok");
        let plain = [1, 0, 0, 0, 3, 0, 0, 0, b'o', b'k', 0, 0];
        assert_eq!(Correlation::Sample.reply(&reply), plain);
        let header = with_text(true, b"", Endian::Little)[..HEADER_BYTES].to_vec();
        assert_eq!(HEADER.reply(&reply), [&header[..], &plain].concat());
        let long = Reply::refused("ü".repeat(MESSAGE_BYTES_MAX));
        assert!(Correlation::Sample.reply(&long).len() <= MESSAGE_BYTES_MAX + 12);
    }

    #[test]
    fn every_service_has_types_on_the_wire() {
        let types = Service::ALL.map(dds_types);
        assert_eq!(types[0][0], "diagnostic_msgs::srv::dds_::AddDiagnostics_Request_");
        assert_eq!(types[3][1], "std_srvs::srv::dds_::Trigger_Response_");
    }
}
