//! The operator's actions: whether a tap counts for the state that it was shown with, and its result.

pub(super) mod act;
pub(super) mod actions;
pub(super) mod last_alarms;
pub(super) mod not_done;

pub(super) mod stop_once;
pub(super) mod tap;
pub(super) mod two_steps;
