//! The state that survives a restart, and how another configuration is taken while the vehicle runs.

pub(super) mod missing_nodes;
pub mod preview;
pub(super) mod reload;
pub mod resume;
