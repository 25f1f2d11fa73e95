//! A received message before it is decoded.

use bytes::Bytes;

use super::cdr::{Endian, Fault};

/// A writer's globally unique id, as its bytes.
pub type Guid = [u8; 16];

/// A message without its encapsulation, or why it cannot be read.
pub type RawBody = Result<(Bytes, Endian), Fault>;
