//! The quality of service with which Telltale publishes and reads.

/// How a topic is offered to its readers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quality {
    /// Reliable, volatile.
    Reliable,
    /// Best effort, volatile: as sensors publish.
    BestEffort,
    /// Reliable, transient local: late joiners get the last value. No reader holds it back.
    LastValue,
    /// Reliable, volatile: small messages for the vehicle, which no reader holds back.
    Command,
    /// Reliable, volatile: replies of a service to many clients at once.
    Reply,
    /// As rcl offers `/rosout`: late joiners get the lines of the last ten seconds.
    Log,
}

impl Quality {
    pub const ALL: [Quality; 6] = [
        Quality::Reliable,
        Quality::BestEffort,
        Quality::LastValue,
        Quality::Command,
        Quality::Reply,
        Quality::Log,
    ];
    pub const COUNT: u8 = Quality::ALL.len() as u8;

    /// Its index in [`Quality::ALL`].
    pub const fn number(self) -> u8 {
        self as u8
    }
}

/// The reader through which a sample came. The readers of a topic share one cache in the library, so each
/// may see samples for another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Via {
    Reliable,
    /// Reliable, and asks for the last value from before its start.
    LastValue,
    BestEffort,
}
