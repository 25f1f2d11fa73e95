//! How reports become states, as it is written: timeouts, delays, latches.

use crate::engine::state::State;
use crate::engine::time;
use crate::yaml::decode::word;
use crate::yaml::{Fields, Spanned};

/// How reports become states, where it differs from what holds around it.
#[derive(Debug, Default, Clone, Copy)]
pub(in crate::config) struct Policy {
    pub timeout: Option<Spanned<time::Span>>,
    pub stale: Option<State>,
    pub raise_after: Option<time::Span>,
    pub clear_after: Option<time::Span>,
    /// While nobody publishes what the module watches.
    pub no_publisher: Option<State>,
    /// Only a module's own: what latches must be named.
    pub latch: Option<time::Span>,
    /// Of a module, of a filter, and by default of what filters and strays make.
    pub forget_after: Option<Spanned<time::Span>>,
}

impl Policy {
    pub fn of(fields: &mut Fields) -> Policy {
        let no_publisher = fields.node("no_publisher").and_then(|node| {
            let states = [State::Unknown, State::Error].map(|state| (state.as_str(), state));
            word(node, fields.log, "state", &states)
        });
        Policy {
            no_publisher,
            raise_after: fields.optional("raise_after"),
            clear_after: fields.optional("clear_after"),
            ..Policy::of_silence(fields)
        }
    }

    /// What becomes of who is silent.
    fn of_silence(fields: &mut Fields) -> Policy {
        let stale = fields.node("stale").and_then(|node| {
            let states = [State::Unknown, State::Warning, State::Error].map(|state| (state.as_str(), state));
            word(node, fields.log, "stale state", &states)
        });
        Policy { timeout: fields.optional("timeout"), stale, ..Policy::default() }
    }

    /// Of the modules that a filter makes.
    pub fn of_filter(fields: &mut Fields) -> Policy {
        Policy { forget_after: fields.optional("forget_after"), ..Policy::of_silence(fields) }
    }

    pub fn of_module(fields: &mut Fields) -> Policy {
        let (latch, forget_after) = (fields.optional("latch"), fields.optional("forget_after"));
        Policy { latch, forget_after, ..Policy::of(fields) }
    }
}
