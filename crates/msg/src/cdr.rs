//! XCDR1, the encoding of messages on the wire: a reader that never panics and never allocates by an unchecked
//! length, and a writer with the padding that other vendors' readers need.

use std::fmt;

/// The byte order that the encapsulation of a message names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Endian {
    Big,
    Little,
}

/// Where and why a message does not follow its type.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Offset in the body, after the encapsulation.
    pub at: usize,
    pub what: FaultKind,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FaultKind {
    /// The message ends where `needed` more bytes are expected and only `left` are there.
    Cut { needed: u64, left: usize },
    /// More elements than this program accepts.
    TooMany { claimed: u32, limit: usize },
    /// The whole message is larger than this program accepts.
    TooLarge { bytes: usize, limit: usize },
    /// This program cannot read this encapsulation.
    Encoding([u8; 2]),
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.what {
            FaultKind::Cut { needed, left } => {
                write!(f, "cut at byte {}: {needed} bytes are needed, {left} are left", self.at)
            }
            FaultKind::TooMany { claimed, limit } => {
                write!(f, "{claimed} elements at byte {}, only the first {limit} were taken", self.at)
            }
            FaultKind::TooLarge { bytes, limit } => {
                write!(f, "a message of {bytes} bytes; at most {limit} are taken")
            }
            FaultKind::Encoding([high, low]) => {
                write!(f, "encoding {high:02x}{low:02x} is not plain CDR; the publisher must use XCDR1")
            }
        }
    }
}

/// Reads the body of a message, without its encapsulation. Alignment counts from the body's start.
#[derive(Debug, Clone)]
pub struct Reader<'a> {
    body: &'a [u8],
    at: usize,
    endian: Endian,
}

impl<'a> Reader<'a> {
    pub fn new(body: &'a [u8], endian: Endian) -> Reader<'a> {
        Reader { body, at: 0, endian }
    }

    pub fn at(&self) -> usize {
        self.at
    }

    pub fn remaining(&self) -> usize {
        self.body.len() - self.at
    }

    /// # Errors
    /// The body ends too early, as in all methods below.
    #[inline]
    pub fn u8(&mut self) -> Result<u8, Fault> {
        let byte = *self.body.get(self.at).ok_or_else(|| self.cut(1))?;
        self.at += 1;
        Ok(byte)
    }

    /// # Errors
    #[inline]
    pub fn u32(&mut self) -> Result<u32, Fault> {
        self.scalar().map(u32::from_le_bytes)
    }

    /// A number of `N` bytes, which is also its alignment, in little endian.
    ///
    /// # Errors
    #[inline]
    pub fn scalar<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let start = self.at.next_multiple_of(N);
        let Some(&(mut bytes)) = self.body.get(start..).and_then(|rest| rest.first_chunk::<N>()) else {
            return Err(self.cut(N as u64));
        };
        self.at = start + N;
        if self.endian == Endian::Big {
            bytes.reverse();
        }
        Ok(bytes)
    }

    /// The bytes of `count` numbers of this size, as they stand in the message.
    ///
    /// # Errors
    pub fn numbers(&mut self, count: u32, bytes: u8) -> Result<&'a [u8], Fault> {
        if count == 0 {
            return Ok(&[]);
        }
        let start = self.at.next_multiple_of(usize::from(bytes));
        let needed = u64::from(count) * u64::from(bytes);
        let end = usize::try_from(needed).ok().and_then(|size| start.checked_add(size));
        let Some(found) = end.and_then(|end| self.body.get(start..end)) else { return Err(self.cut(needed)) };
        self.at = start + found.len();
        Ok(found)
    }

    /// Skips this many bytes.
    ///
    /// # Errors
    #[inline]
    pub fn skip(&mut self, bytes: u64) -> Result<(), Fault> {
        if bytes > self.remaining() as u64 {
            return Err(self.cut(bytes));
        }
        self.at += bytes as usize;
        Ok(())
    }

    /// # Errors
    #[inline]
    pub fn octets(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let Some(bytes) = self.body[self.at..].get(..count) else {
            return Err(self.cut(count as u64));
        };
        self.at += count;
        Ok(bytes)
    }

    /// The bytes of a string without its terminator. A missing terminator and the length 0, which the
    /// standard forbids, are tolerated, because some publishers send them.
    ///
    /// # Errors
    #[inline]
    pub fn string(&mut self) -> Result<&'a [u8], Fault> {
        let length = self.u32()?;
        let bytes = self.octets(length as usize)?;
        Ok(match bytes {
            [text @ .., 0] => text,
            text => text,
        })
    }

    #[cold]
    fn cut(&self, needed: u64) -> Fault {
        Fault { at: self.at, what: FaultKind::Cut { needed, left: self.remaining() } }
    }
}

/// Writes the body of a message in little endian.
#[derive(Debug, Default)]
pub struct Writer {
    body: Vec<u8>,
}

impl Writer {
    pub fn with_capacity(bytes: usize) -> Writer {
        Writer { body: Vec::with_capacity(bytes) }
    }

    pub fn u8(&mut self, value: u8) {
        self.body.push(value);
    }

    pub fn u32(&mut self, value: u32) {
        self.scalar(value.to_le_bytes());
    }

    pub fn f32(&mut self, value: f32) {
        self.scalar(value.to_le_bytes());
    }

    pub fn f64(&mut self, value: f64) {
        self.scalar(value.to_le_bytes());
    }

    pub fn octets(&mut self, bytes: &[u8]) {
        self.body.extend_from_slice(bytes);
    }

    pub fn string(&mut self, text: &str) {
        // A string of 4 GiB cannot occur: all text is bounded where it enters.
        self.u32(u32::try_from(text.len() + 1).unwrap_or(u32::MAX));
        self.body.extend_from_slice(text.as_bytes());
        self.body.push(0);
    }

    pub fn len(&self) -> usize {
        self.body.len()
    }

    pub fn is_empty(&self) -> bool {
        self.body.is_empty()
    }

    /// The body, padded to a multiple of four: Cyclone DDS drops fragmented messages without padding.
    pub fn finish(mut self) -> Vec<u8> {
        self.align(4);
        self.body
    }

    /// Numbers are aligned to their own size.
    fn scalar<const N: usize>(&mut self, little_endian: [u8; N]) {
        self.align(N);
        self.body.extend_from_slice(&little_endian);
    }

    fn align(&mut self, bytes: usize) {
        self.body.resize(self.body.len().next_multiple_of(bytes), 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_orders_of_bytes_and_alignment() {
        let little = [7, 0xff, 0xff, 0xff, 1, 2, 0, 0];
        let mut reader = Reader::new(&little, Endian::Little);
        assert_eq!((reader.u8(), reader.u32()), (Ok(7), Ok(0x0201)));
        let big = [7, 0, 0, 0, 0, 0, 2, 1];
        let mut reader = Reader::new(&big, Endian::Big);
        assert_eq!((reader.u8(), reader.u32()), (Ok(7), Ok(0x0201)));
        assert_eq!(reader.remaining(), 0);
    }

    #[test]
    fn strings_tolerate_what_publishers_send() {
        let cases: [(&[u8], &[u8]); 4] = [
            (&[3, 0, 0, 0, b'a', b'b', 0], b"ab"),
            (&[2, 0, 0, 0, b'a', b'b'], b"ab"),
            (&[0, 0, 0, 0], b""),
            (&[4, 0, 0, 0, b'a', 0, b'b', 0], b"a\0b"),
        ];
        for (body, expected) in cases {
            assert_eq!(Reader::new(body, Endian::Little).string(), Ok(expected));
        }
    }

    #[test]
    fn a_lying_length_is_refused() {
        let body = [0xff, 0xff, 0xff, 0xff, b'a'];
        let fault = Reader::new(&body, Endian::Little).string().unwrap_err();
        assert_eq!(fault.to_string(), "cut at byte 4: 4294967295 bytes are needed, 1 are left");
    }

    #[test]
    fn every_body_is_padded_to_four() {
        for text in ["", "a", "ab", "abc", "abcd"] {
            let mut writer = Writer::default();
            writer.string(text);
            let body = writer.finish();
            assert_eq!(body.len() % 4, 0);
            assert_eq!(Reader::new(&body, Endian::Little).string(), Ok(text.as_bytes()));
        }
    }
}
