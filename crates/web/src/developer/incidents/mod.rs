//! The pages of incidents: their list, one with everything that is known of it, and its report.

pub mod content;
pub mod list;
pub mod one;
pub(super) mod plots;
pub mod report;
pub(crate) mod sentences;
pub(super) mod told;
pub mod what_if;
