//! Everything that Telltale publishes over DDS.

pub mod outputs;
pub(super) mod publisher;
