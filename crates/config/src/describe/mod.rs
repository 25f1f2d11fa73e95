//! A configuration as text: its parts, its differences from another one, and the place of each node in the
//! file.

mod brief;
pub(super) mod difference;
pub(super) mod named;
pub(super) mod places;
pub mod words;
