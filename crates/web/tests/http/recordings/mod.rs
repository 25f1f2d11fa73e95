//! Incidents with their recordings, and replays.

pub mod incidents;
mod replay;
mod trusted_recordings;
