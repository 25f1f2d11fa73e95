//! Logins, logouts, hand-overs, and sessions that end.

pub(super) mod expiry;
pub(super) mod handover;
pub(super) mod login;
pub(super) mod session_ends;
pub(super) mod sign_in_out;
pub(super) mod take_over;
