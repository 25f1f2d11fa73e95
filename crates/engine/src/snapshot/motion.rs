//! The vehicle's motion as it is shown.

use serde::{Deserialize, Serialize};

/// Whether the vehicle moves, how fast, and where to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Motion {
    pub moving: Moving,
    /// Whole km/h without a sign; `None` while unknown. A moving vehicle has at least 1, a standing one 0.
    pub speed_kmh: Option<u32>,
    /// The configuration names the source of the speed.
    pub has_source: bool,
    /// By position in [`Layout::stops`](super::Layout).
    pub destination: Option<usize>,
}

impl Motion {
    /// Whether the vehicle moves, or may: nothing says that it stands although something should.
    pub fn may_move(self) -> bool {
        match self.moving {
            Moving::Yes => true,
            Moving::No => false,
            Moving::Unknown => self.has_source,
        }
    }
}

/// Whether the vehicle moves. Nothing is concluded from what was not heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Moving {
    Yes,
    No,
    #[default]
    Unknown,
}

impl Moving {
    pub const ALL: [Moving; 3] = [Moving::Yes, Moving::No, Moving::Unknown];

    /// The word on the wire.
    pub const fn as_str(self) -> &'static str {
        match self {
            Moving::Yes => "yes",
            Moving::No => "no",
            Moving::Unknown => "unknown",
        }
    }
}
