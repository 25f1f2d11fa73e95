//! Countermeasures: the requests to the vehicle after a failure (paper, Sec. IV-D).

use super::output::Output;
use super::{NodeId, Stage};
use crate::files::float;
use crate::state::State;
use crate::text::{Text, say, words};
use crate::time::Span;
use serde::{Deserialize, Serialize};

/// A request to the vehicle, weakest first.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Request {
    /// Only shown on the screen.
    Notify,
    /// The maneuver component's own safe stop.
    ManeuverStop,
    /// A deceleration of this strength until the vehicle stands.
    Decelerate {
        #[serde(with = "float")]
        mps2: f64,
    },
}

/// The weakest deceleration, in m/s². A weaker one would hardly halt a vehicle.
pub const MPS2_MIN: f64 = 0.1;
/// The strongest deceleration for standing passengers, in m/s².
pub const MPS2_MAX: f64 = 3.0;
/// The deceleration where none is given, in m/s².
pub const MPS2: f64 = 1.0;

impl Request {
    /// A deceleration by a stored number. If that is damaged, the vehicle decelerates all the same.
    pub fn decelerate(mps2: Option<f64>) -> Request {
        let is_sound = |mps2: &f64| (MPS2_MIN..=MPS2_MAX).contains(mps2);
        Request::Decelerate { mps2: mps2.filter(is_sound).unwrap_or(MPS2) }
    }

    pub const fn kind(self) -> RequestKind {
        match self {
            Request::Notify => RequestKind::Notify,
            Request::ManeuverStop => RequestKind::ManeuverStop,
            Request::Decelerate { .. } => RequestKind::Decelerate,
        }
    }

    /// The requested deceleration, in m/s².
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

words! {
    /// A request without its figures, weakest first.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum RequestKind {
        Notify = "notify",
        ManeuverStop = "maneuver_stop",
        Decelerate = "decelerate",
    }
}

impl RequestKind {
    /// Its name in the messages of Telltale's own modules.
    pub(crate) fn said(self) -> Text {
        match self {
            RequestKind::Decelerate => say!("decelerate", "Abbremsen"),
            RequestKind::ManeuverStop => say!("maneuver_stop", "sicheres Anhalten"),
            RequestKind::Notify => say!("notify", "Meldung"),
        }
    }

    /// The topic of requests of this kind.
    pub const fn output(self) -> Option<Output> {
        match self {
            RequestKind::Notify => None,
            RequestKind::ManeuverStop => Some(Output::ManeuverStop),
            RequestKind::Decelerate => Some(Output::Deceleration),
        }
    }

    /// Whether the request changes the vehicle's motion, beyond a notice to the operator.
    pub const fn moves(self) -> bool {
        !matches!(self, RequestKind::Notify)
    }
}

/// When one of the nodes shows at least `state` in one of the stages, `request` is made.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    pub request: Request,
    pub nodes: Vec<NodeId>,
    /// The least state: WARNING, UNKNOWN or ERROR.
    pub state: State,
    /// Never empty.
    pub stages: Vec<Stage>,
    pub confirmation: Option<Confirmation>,
}

/// How the vehicle confirms that it carries out the request.
#[derive(Debug, Clone, PartialEq)]
pub struct Confirmation {
    pub by: ConfirmedBy,
    /// A later confirmation after the request counts as missing.
    pub within: Span,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ConfirmedBy {
    /// Index of a signal that is true then.
    Signal(usize),
    /// The status of exactly this name is OK then.
    Status(Box<str>),
}
