//! The attachment of rmw_zenoh to each message: its number, its time, and the id of its publisher.

/// The id of a publisher or client: XXH3-128 of its token, the low half first.
pub type Gid = [u8; 16];

/// Its number among those of its publisher, and the publisher's clock in nanoseconds since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attachment {
    pub sequence: i64,
    pub stamp_ns: i64,
    pub gid: Gid,
}

/// Releases before Jazzy 0.2.4 and Humble 0.1.2 write these names before the fields.
const NAMES: [&[u8]; 3] = [b"\x0fsequence_number", b"\x10source_timestamp", b"\x0asource_gid"];
const GID_BYTES: u8 = 16;

impl Attachment {
    pub fn read(mut bytes: &[u8]) -> Option<Attachment> {
        let mut field = |name: usize, length: usize| {
            bytes = bytes.strip_prefix(NAMES[name]).unwrap_or(bytes);
            let (field, rest) = bytes.split_at_checked(length)?;
            bytes = rest;
            Some(field)
        };
        let sequence = i64::from_le_bytes(field(0, 8)?.try_into().ok()?);
        let stamp_ns = i64::from_le_bytes(field(1, 8)?.try_into().ok()?);
        let (length, gid) = field(2, 1 + usize::from(GID_BYTES))?.split_first()?;
        let gid = gid.try_into().ok().filter(|_| *length == GID_BYTES && bytes.is_empty())?;
        (sequence >= 0).then_some(Attachment { sequence, stamp_ns, gid })
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(33);
        bytes.extend(self.sequence.to_le_bytes());
        bytes.extend(self.stamp_ns.to_le_bytes());
        bytes.push(GID_BYTES);
        bytes.extend(self.gid);
        bytes
    }

    /// The publisher's clock as DDS has it: seconds since 1970 in 32.32 bits. None before 1970.
    pub fn source(&self) -> Option<u64> {
        let ns = u64::try_from(self.stamp_ns).ok()?;
        let fraction = ((ns % 1_000_000_000) << 32) / 1_000_000_000;
        Some((ns / 1_000_000_000) << 32 | fraction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_forms_are_read_and_nothing_else() {
        let whole = Attachment { sequence: 7, stamp_ns: 1_500_000_000, gid: [9; 16] };
        let bytes = whole.bytes();
        assert_eq!((bytes.len(), Attachment::read(&bytes)), (33, Some(whole)));
        let named = [NAMES[0], &bytes[..8], NAMES[1], &bytes[8..16], NAMES[2], &bytes[16..]].concat();
        assert_eq!(Attachment::read(&named), Some(whole));
        let below_zero = Attachment { sequence: -1, ..whole }.bytes();
        for wrong in [&bytes[..32], &[&bytes[..], &[0]].concat(), &[0; 33], &[], &below_zero] {
            assert_eq!(Attachment::read(wrong), None);
        }
        assert_eq!(whole.source(), Some(3 << 31));
        assert_eq!(Attachment { stamp_ns: -1, ..whole }.source(), None);
    }
}
