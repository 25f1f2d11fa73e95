//! How reports become states, as it is written: timeouts, delays, latches.

use crate::decode::Spanned;
use crate::fields::Fields;
use crate::file::forms::{FORGET_AFTER, default_span};
use telltale_engine::model::{CountsAs, Policy as Resolved};
use telltale_engine::state::State;
use telltale_engine::time;
use telltale_yaml::key;
use telltale_yaml::schema::default;

/// The written parts of a policy; the rest comes from the defaults.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Policy {
    pub timeout: Option<Spanned<time::Span>>,
    pub stale: Option<State>,
    pub raise_after: Option<time::Span>,
    pub clear_after: Option<time::Span>,
    /// The state without a publisher of a watched topic.
    pub no_publisher: Option<State>,
    /// Only of a declared module.
    pub latch: Option<time::Span>,
    /// Of a module, of a filter, and, in the defaults, of all discovered modules.
    pub forget_after: Option<Spanned<time::Span>>,
    /// Only of a declared module.
    pub counts_as: Option<CountsAs>,
}

impl Policy {
    pub fn of(fields: &mut Fields) -> Policy {
        let doc = key("no_publisher")
            .about("The state of a module while nobody publishes a topic that it watches.")
            .rules(|| vec![default(Resolved::default().no_publisher.as_str())]);
        let states = [State::Unknown, State::Error].map(|state| (state.as_str(), state));
        let no_publisher = fields.choice(doc, "state", &states);
        Policy {
            no_publisher,
            raise_after: fields.optional(
                key("raise_after")
                    .about("The state becomes worse only when every report within this time was at least that bad.")
                    .rules(|| vec![default_span(Resolved::default().raise_after)]),
            ),
            clear_after: fields.optional(
                key("clear_after")
                    .about("The state falls to the worst that was reported within this time.")
                    .rules(|| vec![default_span(Resolved::default().clear_after)]),
            ),
            ..Policy::of_silence(fields)
        }
    }

    /// The keys about silent modules.
    fn of_silence(fields: &mut Fields) -> Policy {
        let doc = key("stale")
            .about("The state of a silent module.")
            .rules(|| vec![default(Resolved::default().stale.as_str())]);
        let states = [State::Unknown, State::Warning, State::Error].map(|state| (state.as_str(), state));
        let stale = fields.choice(doc, "stale state", &states);
        let timeout = key("timeout")
            .about("Silence longer than this makes a module stale.")
            .rules(|| vec![default_span(Resolved::default().timeout)]);
        Policy { timeout: fields.optional(timeout), stale, ..Policy::default() }
    }

    /// The policy of the modules that a filter makes.
    pub fn of_filter(fields: &mut Fields) -> Policy {
        Policy { forget_after: fields.optional(FORGET_AFTER), ..Policy::of_silence(fields) }
    }

    pub fn of_module(fields: &mut Fields) -> Policy {
        let latch = key("latch").about("An ERROR that lasted this long stays until it is reset.");
        let (latch, forget_after) = (fields.optional(latch), fields.optional(FORGET_AFTER));
        let doc = key("warning_as").about("A reported WARNING counts as this.");
        let ways = [("ok", CountsAs::WarningOk), ("error", CountsAs::WarningError)];
        let counts_as = fields.choice(doc, "way to count a warning", &ways);
        Policy { latch, forget_after, counts_as, ..Policy::of(fields) }
    }
}
