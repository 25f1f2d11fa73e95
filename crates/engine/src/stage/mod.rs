//! The vehicle's stages, and the operator's actions with their checks.

pub(super) mod advance;
pub mod machine;
pub(super) mod operate;
