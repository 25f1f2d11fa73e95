//! The services that Telltale can offer to other ROS 2 nodes. Each does something that moves nothing.

/// A service, by what it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Service {
    /// Takes note of alarms.
    Acknowledge,
    /// Resets the latched ERROR of a module.
    Reset,
    /// Reads the configuration again.
    Reload,
    /// Marks the present moment in the recording.
    Mark,
}

impl Service {
    pub const ALL: [Service; 4] = [Service::Acknowledge, Service::Reset, Service::Reload, Service::Mark];

    /// Its key in the configuration, and its name in the ROS 2 graph behind that of the node.
    pub const fn as_str(self) -> &'static str {
        match self {
            Service::Acknowledge => "acknowledge",
            Service::Reset => "reset",
            Service::Reload => "reload",
            Service::Mark => "mark",
        }
    }

    /// Whether its request has a text. The others have no argument.
    pub const fn has_argument(self) -> bool {
        matches!(self, Service::Acknowledge | Service::Reset)
    }
}
