//! The WebSockets: frames for pages and programs, the budget of incoming bytes, and what each page has
//! shown.

pub(super) mod byte_budget;
pub(super) mod client;
pub(super) mod displays;
pub(super) mod first_changes;
pub mod frame;
pub(super) mod pacing;
pub(super) mod socket;
pub(super) mod stream_query;
pub(super) mod trend_sampling;
