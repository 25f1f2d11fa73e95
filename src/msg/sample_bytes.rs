//! A message as it was received, before it is decoded.

use super::cdr::{Endian, Fault};

/// A writer's globally unique id, as its bytes.
pub type Guid = [u8; 16];

/// A message without its encapsulation, or why it cannot be read.
pub type RawBody = Result<(Vec<u8>, Endian), Fault>;
