//! A configuration in words: its parts, what differs from another one, and where each node is written.

pub(super) mod difference;
pub(super) mod places;
pub mod words;
