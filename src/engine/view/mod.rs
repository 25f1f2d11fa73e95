//! What snapshots are made of, explanations and the record of what happened.

pub(super) mod layout;
pub mod record;
pub mod ros_names;
pub(super) mod views;
pub mod why;
