//! The vehicle's stages, the operator's actions and what refuses them (`ENGINE.md` 9).

pub(super) mod advance;
pub mod machine;
pub(super) mod operate;
