//! The DDS bridge.

pub mod cdr;
mod interfaces;
pub mod messages;
pub mod options;
mod raw;
mod step;
