//! The services that Telltale can offer to other ROS 2 nodes. Each does something that moves nothing.

use crate::text::words;

words! {
    /// A service, by what it does.
    /// Its word is its key in the configuration, and its name in the ROS 2 graph behind that of the node.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Service {
        /// Takes note of alarms.
        Acknowledge = "acknowledge",
        /// Resets the latched ERROR of a module.
        Reset = "reset",
        /// Reads the configuration again.
        Reload = "reload",
        /// Marks the present moment in the recording.
        Mark = "mark",
    }
}

impl Service {
    /// Whether its request has a text. The others have no argument.
    pub const fn has_argument(self) -> bool {
        matches!(self, Service::Acknowledge | Service::Reset)
    }
}
