//! Masking: groups and modules with their dependencies, their relevance, and the root causes.

pub(super) mod causes;
pub(super) mod dropped;
pub(super) mod explained;
pub(super) mod kept;
pub(super) mod net;
pub(super) mod node;
pub(super) mod paths;
pub(super) mod relevance;
pub(super) mod responsible;
pub mod rules;
