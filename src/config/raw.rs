//! The file as it is written: every key that a configuration knows, with its place. Nothing here
//! is checked against anything else; `resolve` does that.

use super::countermeasures::RawRule;
use super::publishing::RawPublishing;
pub(super) use super::raw_node::{
    Dependency, DependsOn, Filter, FilterKind, Group, Module, Tile, When, Writers,
};
pub(super) use super::raw_signal::{Signal, SignalFrom};
use super::raw_source::RawDiagnostics;
use crate::engine::model::monitors::StampClock;
use crate::engine::model::{Other, StageModel};
use crate::engine::state::State;
use crate::engine::text::Text;
use crate::engine::time;
use crate::yaml::decode::{Entries, scalar, word};
use crate::yaml::{Fields, FromNode, Kind, Log, Node, Problem, Span, Spanned};

#[derive(Debug, Default)]
pub(super) struct File {
    /// Further files, relative to this one, whose lists are added to the lists of this one.
    pub include: Vec<Spanned<String>>,
    pub vehicle: Option<Vehicle>,
    pub signals: Entries<Signal>,
    pub stops: Vec<Stop>,
    pub defaults: Option<Defaults>,
    pub limits: Option<Limits>,
    pub localized_after: Option<time::Span>,
    pub other: Option<Other>,
    pub groups: Vec<Group>,
    /// The key `groups`, where there is one.
    pub groups_span: Option<Span>,
    pub countermeasures: Vec<RawRule>,
    pub publish: Option<RawPublishing>,
    /// Where components report; nothing: `/diagnostics`.
    pub diagnostics: Option<RawDiagnostics>,
    /// By which clock stamps are.
    pub clock: Option<StampClock>,
    /// Folders with definitions of messages, each relative to the file that names it.
    pub message_folders: Vec<Spanned<String>>,
    /// Keys that only the file which is named first may have, with their places.
    pub main_only: Vec<(&'static str, Span)>,
}

impl FromNode for File {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a configuration", log)?;
        if let Some(span) = fields.key_span("modules") {
            fields.node("modules");
            let problem = Problem::at(span, "a module stands in no group");
            fields.log.push(problem.help("move `modules` into one of the `groups`"));
        }
        let main_only =
            ["vehicle", "defaults", "limits", "localized_after", "other", "publish", "diagnostics", "clock"];
        let main_only = main_only.into_iter().filter_map(|key| Some((key, fields.key_span(key)?)));
        let file = File {
            main_only: main_only.collect(),
            include: fields.or_default("include"),
            vehicle: fields.optional("vehicle"),
            signals: fields.or_default("signals"),
            stops: fields.or_default("stops"),
            defaults: fields.optional("defaults"),
            limits: fields.optional("limits"),
            localized_after: fields.optional("localized_after"),
            other: fields.optional("other"),
            groups_span: fields.key_span("groups"),
            groups: fields.or_default("groups"),
            countermeasures: fields.or_default("countermeasures"),
            publish: fields.optional("publish"),
            diagnostics: fields.optional("diagnostics"),
            clock: fields.optional("clock"),
            message_folders: fields.or_default("message_folders"),
        };
        fields.finish();
        Some(file)
    }
}

#[derive(Debug, Default)]
pub(super) struct Vehicle {
    pub id: Option<Spanned<String>>,
    pub name: Option<Text>,
    pub stages: Option<StageModel>,
}

impl FromNode for Vehicle {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "the vehicle", log)?;
        let vehicle = Vehicle {
            id: fields.optional("id"),
            name: fields.optional("name"),
            stages: fields.optional("stages"),
        };
        fields.finish();
        Some(vehicle)
    }
}

impl FromNode for StageModel {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "stage model", &[("shuttle", StageModel::Shuttle), ("none", StageModel::None)])
    }
}

impl FromNode for Other {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "way to treat other statuses", &Other::ALL.map(|other| (other.as_str(), other)))
    }
}

#[derive(Debug)]
pub(super) struct Stop {
    pub id: Option<Spanned<String>>,
    pub name: Option<Text>,
    pub x: Option<f64>,
    pub y: Option<f64>,
    pub yaw_deg: Option<f64>,
}

impl FromNode for Stop {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a stop", log)?;
        let stop = Stop {
            id: fields.required("id"),
            name: fields.optional("name"),
            x: fields.required("x"),
            y: fields.required("y"),
            yaw_deg: fields.optional("yaw_deg"),
        };
        fields.finish();
        Some(stop)
    }
}

/// How reports become states, where it differs from what holds around it.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct Policy {
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

#[derive(Debug, Default)]
pub(super) struct Defaults(pub Policy);

impl FromNode for Defaults {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "the defaults", log)?;
        let forget_after = fields.optional("forget_after");
        let defaults = Defaults(Policy { forget_after, ..Policy::of(&mut fields) });
        fields.finish();
        Some(defaults)
    }
}

#[derive(Debug, Default)]
pub(super) struct Limits {
    pub discovered_modules: Option<Spanned<u64>>,
    pub values_per_status: Option<Spanned<u64>>,
    pub string_bytes: Option<Spanned<u64>>,
    pub status_bytes: Option<Spanned<u64>>,
    pub source_bytes: Option<Spanned<u64>>,
}

impl FromNode for Limits {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "the limits", log)?;
        let limits = Limits {
            discovered_modules: fields.optional("discovered_modules"),
            values_per_status: fields.optional("values_per_status"),
            string_bytes: fields.optional("string_bytes"),
            status_bytes: fields.optional("status_bytes"),
            source_bytes: fields.optional("source_bytes"),
        };
        fields.finish();
        Some(limits)
    }
}

impl FromNode for Text {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if scalar(node).is_some() || !matches!(node.kind, Kind::Mapping(_)) {
            return String::from_node(node, log).map(|text| Text::plain(&text));
        }
        let mut fields = Fields::of(node, "a text in two languages", log)?;
        let (en, de): (Option<String>, Option<String>) = (fields.optional("en"), fields.optional("de"));
        if fields.key_span("en").is_none() && fields.key_span("de").is_none() {
            let problem = Problem::at(node.span, "a text needs `en` or `de`");
            fields.log.push(problem.help("write the text alone, or `{ en: ..., de: ... }`"));
        }
        fields.finish();
        // One language is read by everybody.
        let (en, de) = (en.as_ref().or(de.as_ref())?.as_str(), de.as_ref().or(en.as_ref())?.as_str());
        Some(Text { en: en.into(), de: de.into() })
    }
}
