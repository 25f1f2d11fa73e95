//! Countermeasures: what the vehicle is asked to do when something fails (`ENGINE.md` 10; paper,
//! Sec. IV-D).

use super::output::Output;
use super::{NodeId, Stage};
use crate::engine::state::State;
use crate::engine::text::Text;
use crate::engine::text::say;
use crate::engine::time::Span;

/// What is asked of the vehicle, weakest first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Request {
    /// On the screen alone.
    Notify,
    /// The maneuver component's own safe stop.
    ManeuverStop,
    /// To slow down by this much until it stands.
    Decelerate { mps2: f64 },
}

impl Request {
    pub const fn kind(self) -> RequestKind {
        match self {
            Request::Notify => RequestKind::Notify,
            Request::ManeuverStop => RequestKind::ManeuverStop,
            Request::Decelerate { .. } => RequestKind::Decelerate,
        }
    }

    /// The deceleration that is asked for, in m/s².
    pub const fn mps2(self) -> Option<f64> {
        match self {
            Request::Decelerate { mps2 } => Some(mps2),
            Request::Notify | Request::ManeuverStop => None,
        }
    }

    /// The word in files and on the wire.
    pub const fn as_str(self) -> &'static str {
        self.kind().as_str()
    }
}

/// A request without its figures, weakest first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RequestKind {
    Notify,
    ManeuverStop,
    Decelerate,
}

impl RequestKind {
    /// What the diagnosis of itself calls it.
    pub(in crate::engine) fn said(self) -> Text {
        match self {
            RequestKind::Decelerate => say!("decelerate", "Abbremsen"),
            RequestKind::ManeuverStop => say!("maneuver_stop", "sicheres Anhalten"),
            RequestKind::Notify => say!("notify", "Meldung"),
        }
    }

    /// On what a request of this kind is published.
    pub const fn output(self) -> Option<Output> {
        match self {
            RequestKind::Notify => None,
            RequestKind::ManeuverStop => Some(Output::ManeuverStop),
            RequestKind::Decelerate => Some(Output::Deceleration),
        }
    }

    pub const ALL: [RequestKind; 3] =
        [RequestKind::Notify, RequestKind::ManeuverStop, RequestKind::Decelerate];

    pub const fn as_str(self) -> &'static str {
        match self {
            RequestKind::Notify => "notify",
            RequestKind::ManeuverStop => "maneuver_stop",
            RequestKind::Decelerate => "decelerate",
        }
    }

    /// Whether the vehicle is asked to move differently, not only the operator to look.
    pub const fn moves(self) -> bool {
        !matches!(self, RequestKind::Notify)
    }
}

/// When one of the nodes shows at least `state` in one of the stages, `request` is made.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    pub request: Request,
    pub nodes: Vec<NodeId>,
    /// WARNING, UNKNOWN or ERROR, and what is worse.
    pub state: State,
    /// Never empty.
    pub stages: Vec<Stage>,
    pub confirmation: Option<Confirmation>,
}

/// How the vehicle says that it does what was asked.
#[derive(Debug, Clone, PartialEq)]
pub struct Confirmation {
    pub by: ConfirmedBy,
    /// Later than this after the request it counts as not confirmed.
    pub within: Span,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ConfirmedBy {
    /// Index of a signal that is true then.
    Signal(usize),
    /// The status of exactly this name is OK then.
    Status(Box<str>),
}
