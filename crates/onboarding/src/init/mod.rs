//! A first configuration of a running ROS 2 system: what was heard and who publishes what becomes groups, modules
//! and monitors, each with its evidence as a comment. Pure: `cli/configuration/init` listens, this room concludes and writes.
//!
//! [`Observations`] -> [`Draft`] -> [`text`].

mod dependencies;
mod draft;
mod grouping;
mod names;
mod observations;
mod passing;
mod proposals;
mod rhythm;
mod yaml;

pub use draft::{Draft, Group, draft};
pub use observations::{DIAGNOSTICS, Observations, TOPICS_MAX};
pub use proposals::Proposal;
pub use yaml::{heard_text, text};
