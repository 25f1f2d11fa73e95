//! Restart and reload.

pub(super) mod missing_nodes;
pub mod preview;
pub(super) mod reload;
pub mod resume;
