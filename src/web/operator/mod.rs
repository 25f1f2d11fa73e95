//! The operator's actions: what a tap was shown, whether it counts, and what becomes of it.

pub(super) mod act;
pub(super) mod actions;
pub(super) mod not_done;
pub(super) mod pending_clearance;
pub(super) mod stop_once;
pub(super) mod tap;
