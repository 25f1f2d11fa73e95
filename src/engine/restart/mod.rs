//! Restart and reload.

pub mod foresee;
pub(super) mod missing_nodes;
pub(super) mod reload;
pub mod resume;
