//! Going on after a restart, and with another configuration.

pub mod foresee;
pub(super) mod missing_nodes;
pub(super) mod reload;
pub mod resume;
