//! The request of a lifecycle node's state and its reply on the wire: the service `get_state` of ROS 2
//! (lifecycle_msgs/srv/GetState), as servers of Cyclone DDS and of Fast DDS take it.

use super::cdr::{Endian, Reader, Writer};
use super::messages::dds_type_name;
use super::sample_bytes::Guid;
use super::services::{Correlation, HEADER_BYTES, header};

/// The vendor id of Cyclone DDS, with which the GUIDs of its participants begin (RTPS 2.5, 9.3.1.5).
const CYCLONE_DDS: [u8; 2] = [0x01, 0x10];

/// The state in which a lifecycle node does its work.
pub const ACTIVE: u8 = 3;

/// The name of the service behind that of its node.
pub const GET_STATE: &str = "get_state";

/// The names of the requests' type and of the replies' type on the wire.
pub fn dds_types() -> [String; 2] {
    ["Request", "Response"]
        .map(|part| dds_type_name(&format!("lifecycle_msgs/srv/GetState_{part}")).unwrap_or_default())
}

/// Whether the library of this participant puts the identity of a request before it and before its reply.
pub fn has_header(participant: &Guid) -> bool {
    participant.starts_with(&CYCLONE_DDS)
}

/// The body of a request, for a server with this reader of requests. Servers of Cyclone DDS repeat `client` and
/// `sequence` in their reply, others name the sample.
pub fn request(server: &Guid, client: u64, sequence: i64) -> Vec<u8> {
    let mut writer = Writer::with_capacity(HEADER_BYTES + 1);
    if has_header(server) {
        writer.octets(&client.to_le_bytes());
        writer.octets(&sequence.to_le_bytes());
    }
    // An empty structure has one byte.
    writer.u8(0);
    writer.finish()
}

/// The state in a reply by this writer, and the request to which it replies.
pub fn reply(body: &[u8], endian: Endian, server: &Guid) -> Option<(Correlation, u8)> {
    let (correlation, behind) = match has_header(server) {
        true => (header(body, endian)?, HEADER_BYTES),
        false => (Correlation::Sample, 0),
    };
    let mut reader = Reader::new(body, endian);
    reader.octets(behind).ok()?;
    let state = reader.u8().ok()?;
    reader.string().ok()?;
    Some((correlation, state))
}

/// The name of a state in lifecycle_msgs/msg/State.
pub fn state_name(state: u8) -> String {
    let name = match state {
        0 => "unknown",
        1 => "unconfigured",
        2 => "inactive",
        ACTIVE => "active",
        4 => "finalized",
        10 => "configuring",
        11 => "cleaning up",
        12 => "shutting down",
        13 => "activating",
        14 => "deactivating",
        15 => "processing an error",
        _ => return format!("state {state}"),
    };
    name.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLONE: Guid = [1, 0x10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1];
    const FAST: Guid = [1, 0x0f, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1];

    fn inactive() -> Vec<u8> {
        let mut writer = Writer::with_capacity(32);
        writer.u8(2);
        writer.string("inactive");
        writer.finish()
    }

    #[test]
    fn each_vendor_gets_its_own_request_and_its_reply_is_read() {
        // With padding.
        assert_eq!(request(&FAST, 7, 9), [0; 4]);
        assert_eq!(request(&CYCLONE, 7, 9), [&[7, 0, 0, 0, 0, 0, 0, 0, 9][..], &[0; 11]].concat());
        let with_header = [&request(&CYCLONE, 7, 9)[..HEADER_BYTES], &inactive()].concat();
        let asked = Correlation::Header { client: 7, sequence: 9 };
        assert_eq!(reply(&with_header, Endian::Little, &CYCLONE), Some((asked, 2)));
        assert_eq!(reply(&inactive(), Endian::Little, &FAST), Some((Correlation::Sample, 2)));
        assert_eq!(dds_types()[0], "lifecycle_msgs::srv::dds_::GetState_Request_");
    }

    #[test]
    fn what_is_no_reply_says_no_state() {
        for body in [&[][..], &[3], &[3, 0, 0, 0, 255, 255, 255, 255], &[0; 16]] {
            assert_eq!(reply(body, Endian::Little, &CYCLONE), None, "{body:?}");
        }
        assert_eq!(reply(&[3, 0, 0, 0, 255, 255, 255, 255], Endian::Little, &FAST), None);
        assert_eq!([2, 3, 200].map(state_name), ["inactive", "active", "state 200"]);
    }
}
