//! The ids of participants, and of their readers and writers.

use telltale_engine::text::hex;
use telltale_msg::sample_bytes::Guid;

/// The bytes of a GUID that name its participant (RTPS 2.5, 9.3.1).
pub const PREFIX: usize = 12;
/// The part of a GUID that names the participant.
pub type Prefix = [u8; PREFIX];

pub fn prefix(guid: &Guid) -> Prefix {
    std::array::from_fn(|index| guid[index])
}

/// The participant of a GUID.
pub fn participant_name(guid: &Guid) -> String {
    hex(&guid[..PREFIX])
}
