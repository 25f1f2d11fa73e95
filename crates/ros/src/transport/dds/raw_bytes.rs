//! Samples as bytes. The library's own decoding would lose a whole array for one bad string, and a panic in
//! it would poison the cache of the topic. It also runs under the lock of that cache, so this code only
//! copies the bytes out.

use crate::transport::BODY_BYTES_MAX;
use std::convert::Infallible;
use telltale_msg::sample_bytes::RawBody;

use rustdds::RepresentationIdentifier as Encoding;
use rustdds::bytes::Bytes;
use rustdds::no_key::{Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter};

use telltale_msg::cdr::{Endian, Fault, FaultKind};

pub struct RawAdapter;

/// Every encapsulation is accepted here, so that an unknown one can be reported with its topic.
static ENCODINGS: [Encoding; 17] = [
    Encoding::CDR_LE,
    Encoding::CDR_BE,
    Encoding::PL_CDR_BE,
    Encoding::PL_CDR_LE,
    Encoding::CDR2_BE,
    Encoding::CDR2_LE,
    Encoding::PL_CDR2_BE,
    Encoding::PL_CDR2_LE,
    Encoding::D_CDR_BE,
    Encoding::D_CDR_LE,
    Encoding::XML,
    Encoding::XCDR2_BE,
    Encoding::XCDR2_LE,
    Encoding::D_CDR2_BE,
    Encoding::D_CDR2_LE,
    Encoding::PL_XCDR2_BE,
    Encoding::PL_XCDR2_LE,
];

impl DeserializerAdapter<RawBody> for RawAdapter {
    type Error = Infallible;
    type Decoded = RawBody;

    fn supported_encodings() -> &'static [Encoding] {
        &ENCODINGS
    }

    fn transform_decoded(decoded: RawBody) -> RawBody {
        decoded
    }
}

impl DefaultDecoder<RawBody> for RawAdapter {
    type Decoder = CopyOut;
    const DECODER: CopyOut = CopyOut;
}

#[derive(Debug, Clone, Copy)]
pub struct CopyOut;

impl Decode<'_, RawBody> for CopyOut {
    type Error = Infallible;

    fn decode_bytes(self, input: &[u8], encoding: Encoding) -> Result<RawBody, Infallible> {
        let endian = match encoding {
            Encoding::CDR_LE => Endian::Little,
            Encoding::CDR_BE => Endian::Big,
            other => return Ok(Err(Fault { at: 0, what: FaultKind::Encoding(other.to_bytes()) })),
        };
        if input.len() > BODY_BYTES_MAX {
            let what = FaultKind::TooLarge { bytes: input.len(), limit: BODY_BYTES_MAX };
            return Ok(Err(Fault { at: 0, what }));
        }
        Ok(Ok((Bytes::copy_from_slice(input), endian)))
    }
}

/// A body that is written unchanged, in little endian.
impl SerializerAdapter<Bytes> for RawAdapter {
    type Error = Infallible;

    fn output_encoding() -> Encoding {
        Encoding::CDR_LE
    }

    fn to_bytes(value: &Bytes) -> Result<Bytes, Infallible> {
        Ok(value.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_orders_of_bytes_are_taken_and_other_encodings_named() {
        let taken = |encoding, input: &[u8]| match CopyOut.decode_bytes(input, encoding) {
            Ok(body) => body.map_err(|fault| fault.to_string()),
            Err(never) => match never {},
        };
        assert_eq!(taken(Encoding::CDR_LE, b"ab"), Ok((Bytes::from_static(b"ab"), Endian::Little)));
        assert_eq!(taken(Encoding::CDR_BE, b"ab"), Ok((Bytes::from_static(b"ab"), Endian::Big)));
        let error = taken(Encoding::XCDR2_LE, b"ab").unwrap_err();
        assert!(error.contains("encoding 0007"), "{error}");
    }
}
