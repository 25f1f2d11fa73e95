//! The parts of snapshots, explanations, and records of events.

pub(super) mod layout;
pub mod record;
pub mod ros_names;
pub(super) mod views;
pub mod why;
