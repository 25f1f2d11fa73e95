//! A first configuration of a running ROS 2 system: what was heard and who publishes what becomes groups, modules
//! and monitors, each with its evidence as a comment. Pure: `cli/configuration/init` listens, this
//! module concludes and writes.
//!
//! [`Observations`] -> [`Draft`] -> [`text`].

mod dependencies;
pub(crate) mod draft;
mod grouping;
pub(crate) mod names;
pub(crate) mod observations;
pub(crate) mod passing;
pub(crate) mod proposals;
mod rhythm;
pub(crate) mod values;
pub(crate) mod yaml;

pub use draft::{Draft, Group, ModuleKind, draft};
pub use observations::{Observations, STATUSES_MAX, TOPICS_MAX, more_fields};
pub use proposals::Proposal;
pub use yaml::{heard_text, text};
