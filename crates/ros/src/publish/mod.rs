//! Everything that Telltale publishes over DDS.

pub mod log_lines;
pub mod outputs;
pub(super) mod publisher;
