//! The vehicle's stages, and the operator's actions with their checks (`ENGINE.md` 9).

pub(super) mod advance;
pub mod machine;
pub(super) mod operate;
