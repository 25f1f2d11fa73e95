//! How the reports of a module become its state.

use super::NodeNames;
use crate::state::State;
use crate::time::Span;

/// How a module's reports become its own state.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Policy {
    /// Silence longer than this makes the module stale.
    pub timeout: Span,
    /// The state of a silent module: UNKNOWN, WARNING or ERROR.
    pub stale: State,
    /// The state rises to the best that was reported within this time.
    pub raise_after: Span,
    /// The state falls to the worst that was reported within this time.
    pub clear_after: Span,
    /// An ERROR that lasted this long stays until it is reset.
    pub latch: Option<Span>,
    /// After this long without a report, the last report no longer counts. A discovered module leaves then.
    pub forget_after: Option<Span>,
    /// The state while nobody publishes a topic that the module watches: UNKNOWN or ERROR.
    pub no_publisher: State,
    /// Full names of the nodes whose reports count; `None`: all.
    pub writers: Option<NodeNames>,
    /// How a reported state counts.
    pub counts_as: CountsAs,
}

/// How the reported state of a module counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum CountsAs {
    #[default]
    Reported,
    /// A WARNING is OK.
    WarningOk,
    /// A WARNING is an ERROR.
    WarningError,
    /// Every report is an ERROR.
    Error,
}

impl CountsAs {
    pub fn of(self, reported: State) -> State {
        match (self, reported) {
            (CountsAs::WarningOk, State::Warning) => State::Ok,
            (CountsAs::WarningError, State::Warning) | (CountsAs::Error, _) => State::Error,
            (CountsAs::Reported | CountsAs::WarningOk | CountsAs::WarningError, _) => reported,
        }
    }
}

impl Policy {
    /// How far back it looks. Latches and forgetting are states, not windows.
    pub(super) fn memory(&self) -> Span {
        self.timeout.max(self.raise_after).max(self.clear_after)
    }
}

impl Default for Policy {
    fn default() -> Policy {
        Policy {
            timeout: Span::from_secs(2),
            stale: State::Unknown,
            raise_after: Span::ZERO,
            clear_after: Span::ZERO,
            latch: None,
            forget_after: None,
            no_publisher: State::Unknown,
            writers: None,
            counts_as: CountsAs::Reported,
        }
    }
}
