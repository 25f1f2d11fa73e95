//! What this program publishes over DDS.

pub mod outputs;
pub(super) mod publisher;
