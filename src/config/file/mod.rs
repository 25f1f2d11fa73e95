//! The file as it is written: every key of a configuration, with its place. Nothing here is checked against
//! anything else; `resolve` does that.

pub(super) mod agreement;
pub(super) mod bands;
pub(super) mod countermeasure;
pub(super) mod monitors;
pub(super) mod nodes;
pub(super) mod policy;
pub(super) mod publishing;
pub(super) mod ros_names;
pub(super) mod signals;
pub(super) mod sources;
pub(super) mod units;
pub(super) mod watchdog;
pub(super) mod wording;

use crate::engine::model::monitors::StampClock;
use crate::engine::model::{Other, StageModel};
use crate::engine::text::Text;
use crate::engine::time;
use crate::yaml::decode::{Entries, scalar, word};
use crate::yaml::{Fields, FromNode, Kind, Log, Node, Problem, Span, Spanned};
use countermeasure::RawRule;
pub(super) use nodes::{Dependency, DependsOn, Filter, FilterKind, Group, Module, Tile, When, Writers};
pub(super) use policy::Policy;
use publishing::RawPublishing;
pub(super) use signals::{Signal, SignalFrom};
use sources::RawDiagnostics;

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
