//! The file as it is written: every key that a configuration knows, with its place. Nothing here
//! is checked against anything else; `resolve` does that.

use crate::engine::model::{Combine, Stage, StageModel, Text};
use crate::engine::state::State;
use crate::engine::time;
use crate::yaml::decode::{All, Entries, did_you_mean, scalar, word};
use crate::yaml::{Fields, FromNode, Kind, Log, Node, Problem, Span, Spanned, suggest};

/// The kinds of monitor (`ENGINE.md` 7).
const MONITORS: [&str; 10] = [
    "self_state",
    "frequency",
    "latency",
    "value",
    "watchdog",
    "rate_ratio",
    "sequence",
    "agreement",
    "expression",
    "external",
];

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
    pub groups: Vec<Group>,
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
        let main_only = ["vehicle", "defaults", "limits", "localized_after"];
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
            groups: fields.or_default("groups"),
        };
        unsupported(&mut fields, &["countermeasures"]);
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

#[derive(Debug)]
pub(super) struct Signal {
    pub topic: Option<Spanned<String>>,
    pub type_name: Option<Spanned<String>>,
    pub field: Option<Spanned<String>>,
    pub timeout: Option<Spanned<time::Span>>,
    pub present_for: Option<Spanned<time::Span>>,
}

impl FromNode for Signal {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a signal", log)?;
        let signal = Signal {
            topic: fields.required("topic"),
            type_name: fields.required("type"),
            field: fields.optional("field"),
            timeout: fields.optional("timeout"),
            present_for: fields.optional("present_for"),
        };
        fields.finish();
        Some(signal)
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
    /// Only a module's own: what latches must be named.
    pub latch: Option<time::Span>,
}

impl Policy {
    fn of(fields: &mut Fields) -> Policy {
        let stale = fields.node("stale").and_then(|node| {
            let states = [State::Unknown, State::Warning, State::Error].map(|state| (state.as_str(), state));
            word(node, fields.log, "stale state", &states)
        });
        Policy {
            timeout: fields.optional("timeout"),
            stale,
            raise_after: fields.optional("raise_after"),
            clear_after: fields.optional("clear_after"),
            latch: None,
        }
    }
}

#[derive(Debug, Default)]
pub(super) struct Defaults(pub Policy);

impl FromNode for Defaults {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "the defaults", log)?;
        let defaults = Defaults(Policy::of(&mut fields));
        fields.finish();
        Some(defaults)
    }
}

#[derive(Debug, Default)]
pub(super) struct Limits {
    pub discovered_modules: Option<Spanned<u64>>,
    pub values_per_status: Option<Spanned<u64>>,
    pub string_bytes: Option<Spanned<u64>>,
}

impl FromNode for Limits {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "the limits", log)?;
        let limits = Limits {
            discovered_modules: fields.optional("discovered_modules"),
            values_per_status: fields.optional("values_per_status"),
            string_bytes: fields.optional("string_bytes"),
        };
        fields.finish();
        Some(limits)
    }
}

#[derive(Debug)]
pub(super) struct Group {
    pub span: Span,
    pub id: Option<Spanned<String>>,
    pub name: Option<Text>,
    pub tile: Option<Spanned<Tile>>,
    pub filters: Vec<Filter>,
    pub depends_on: Vec<Dependency>,
    pub when: Option<When>,
    pub combine: Option<Combine>,
    pub modules: Vec<Module>,
    pub groups: Vec<Group>,
}

impl FromNode for Group {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a group", log)?;
        let group = Group {
            span: fields.span(),
            id: fields.required("id"),
            name: fields.optional("name"),
            tile: fields.optional("tile"),
            filters: fields.or_default("match"),
            depends_on: fields.or_default("depends_on"),
            when: fields.optional("when"),
            combine: fields.optional("combine"),
            modules: fields.or_default("modules"),
            groups: fields.or_default("groups"),
        };
        fields.finish();
        Some(group)
    }
}

impl FromNode for Combine {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "way to combine", &[("worst", Combine::Worst), ("any", Combine::Any)])
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Tile {
    pub column: Option<u64>,
    pub row: Option<u64>,
}

impl FromNode for Tile {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a tile", log)?;
        let tile = Tile { column: fields.required("column"), row: fields.required("row") };
        fields.finish();
        Some(tile)
    }
}

#[derive(Debug)]
pub(super) struct Filter {
    pub span: Span,
    pub kind: FilterKind,
    pub text: Spanned<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FilterKind {
    Name,
    Namespace,
    Contains,
    Regex,
}

impl FromNode for Filter {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        const KINDS: [(&str, FilterKind); 4] = [
            ("name", FilterKind::Name),
            ("namespace", FilterKind::Namespace),
            ("contains", FilterKind::Contains),
            ("regex", FilterKind::Regex),
        ];
        let mut fields = Fields::of(node, "a filter", log)?;
        let found: Vec<_> = KINDS
            .into_iter()
            .filter(|(key, _)| fields.node(key).is_some())
            .map(|(key, kind)| (key, kind))
            .collect();
        let filter = match found[..] {
            [(key, kind)] => fields.optional(key).map(|text| Filter { span: node.span, kind, text }),
            _ => {
                let problem =
                    Problem::at(node.span, "a filter needs one of `name`, `namespace`, `contains`, `regex`");
                fields.log.push(problem.help("write one filter for each: `- { namespace: /sensors }`"));
                None
            }
        };
        fields.finish();
        filter
    }
}

#[derive(Debug)]
pub(super) struct Dependency {
    pub span: Span,
    pub on: DependsOn,
    pub masks_unknown: bool,
}

#[derive(Debug)]
pub(super) enum DependsOn {
    Node(Spanned<String>),
    AnyOf(Vec<Spanned<String>>),
}

impl FromNode for Dependency {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let span = node.span;
        if let Kind::Scalar { .. } = node.kind {
            let name = FromNode::from_node(node, log)?;
            return Some(Dependency { span, on: DependsOn::Node(name), masks_unknown: false });
        }
        let mut fields = Fields::of(node, "a dependency", log)?;
        let (on, any_of) = (fields.optional("on"), fields.optional::<All<_>>("any_of"));
        let masks_when: Option<Spanned<All<MasksWhen>>> = fields.optional("masks_when");
        if let Some(states) = masks_when.as_ref().filter(|states| !masks(states, State::Error)) {
            let problem = Problem::at(states.span, "`masks_when` lacks `error`");
            fields.log.push(problem.help("write `[error]` or `[error, unknown]`"));
        }
        if fields.key_span("on").is_some() == fields.key_span("any_of").is_some() {
            let problem = Problem::at(span, "a dependency needs either `on` or `any_of`");
            fields
                .log
                .push(problem.help("write the name alone, `{ on: NAME }` or `{ any_of: [NAME, NAME] }`"));
        }
        fields.finish();
        let masks_unknown = masks_when.is_some_and(|states| masks(&states, State::Unknown));
        let on = on.map(DependsOn::Node).or(any_of.map(|All(names)| DependsOn::AnyOf(names)))?;
        Some(Dependency { span, on, masks_unknown })
    }
}

fn masks(states: &Spanned<All<MasksWhen>>, state: State) -> bool {
    states.value.0.iter().any(|MasksWhen(named)| *named == state)
}

/// A state of a dependency that masks.
#[derive(Debug)]
struct MasksWhen(State);

impl FromNode for MasksWhen {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let states = [State::Error, State::Unknown].map(|state| (state.as_str(), state));
        word(node, log, "masking state", &states).map(MasksWhen)
    }
}

#[derive(Debug)]
pub(super) struct When {
    /// Empty if no stage is named.
    pub stages: Vec<Stage>,
    pub signals: Entries<bool>,
}

impl FromNode for When {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a `when`", log)?;
        let stages: Option<Spanned<All<Stage>>> = fields.optional("stages");
        if let Some(empty) = stages.as_ref().filter(|stages| stages.value.0.is_empty()) {
            let problem = Problem::at(empty.span, "without a stage this would never be diagnosed");
            fields.log.push(problem.help("name the stages, or remove `stages`"));
        }
        if fields.key_span("stages").is_none() && fields.key_span("signals").is_none() {
            let problem = Problem::at(node.span, "this `when` has no condition");
            fields.log.push(problem.help("add `stages: [...]` or `signals: { NAME: true }`, or remove it"));
        }
        let stages = stages.map(|stages| stages.value.0).unwrap_or_default();
        let when = When { stages, signals: fields.or_default("signals") };
        fields.finish();
        Some(when)
    }
}

impl FromNode for Stage {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "stage", &Stage::ALL.map(|stage| (stage.as_str(), stage)))
    }
}

#[derive(Debug)]
pub(super) struct Module {
    pub span: Span,
    pub id: Option<Spanned<String>>,
    pub name: Option<Text>,
    pub help: Option<Text>,
    pub policy: Policy,
    pub when: Option<When>,
    pub depends_on: Vec<Dependency>,
    pub monitor: Option<Monitor>,
}

impl FromNode for Module {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a module", log)?;
        let status: Option<Spanned<String>> = fields.optional("status");
        let mut module = Module {
            span: fields.span(),
            id: fields.required("id"),
            name: fields.optional("name"),
            help: fields.optional("help"),
            policy: Policy { latch: fields.optional("latch"), ..Policy::of(&mut fields) },
            when: fields.optional("when"),
            depends_on: fields.or_default("depends_on"),
            monitor: fields.optional("monitor"),
        };
        match (fields.key_span("status"), fields.key_span("monitor")) {
            (Some(status), Some(monitor)) => {
                let problem = Problem::at(monitor, "a module has either `status` or `monitor`");
                fields.log.push(problem.also(status, "and here").help("remove one of the two"));
            }
            (None, None) => {
                let problem = Problem::at(module.span, "a module needs `status` or `monitor`");
                fields.log.push(problem.help("add `status: 'NAME OF THE STATUS'`"));
            }
            _ => module.monitor = module.monitor.or(status.map(|status| Monitor::SelfState { status })),
        }
        fields.finish();
        Some(module)
    }
}

#[derive(Debug)]
pub(super) enum Monitor {
    SelfState { status: Spanned<String> },
}

impl FromNode for Monitor {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let Kind::Mapping(entries) = &node.kind else {
            let problem = Problem::at(node.span, format!("expected a monitor, found {}", node.describe()));
            log.push(problem.help("write `monitor: { KIND: { ... } }`"));
            return None;
        };
        let [(kind, value)] = &entries[..] else {
            log.push(
                Problem::at(node.span, "a monitor has one kind")
                    .help(format!("one of: {}", MONITORS.join(", "))),
            );
            return None;
        };
        if kind.text == "self_state" {
            let mut fields = Fields::of(value, "a self_state monitor", log)?;
            let status = fields.required("status");
            fields.finish();
            return status.map(|status| Monitor::SelfState { status });
        }
        if MONITORS.contains(&kind.text.as_str()) {
            log.push(not_supported(kind.span, &format!("monitor: {}", kind.text)));
        } else {
            let help = suggest(&kind.text, MONITORS)
                .map_or_else(|| format!("one of: {}", MONITORS.join(", ")), did_you_mean);
            log.push(Problem::at(kind.span, format!("unknown kind of monitor `{}`", kind.text)).help(help));
        }
        None
    }
}

impl FromNode for Text {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if scalar(node).is_some() || !matches!(node.kind, Kind::Mapping(_)) {
            return String::from_node(node, log).map(|text| Text::plain(&text));
        }
        let mut fields = Fields::of(node, "a text in two languages", log)?;
        let (en, de): (Option<String>, Option<String>) = (fields.required("en"), fields.required("de"));
        fields.finish();
        Some(Text { en: en?.into(), de: de?.into() })
    }
}

/// Logs each of the keys that is there: it must not be taken for granted that it does something.
fn unsupported(fields: &mut Fields, keys: &[&'static str]) {
    for key in keys {
        fields.node(key);
        if let Some(span) = fields.key_span(key) {
            fields.log.push(not_supported(span, key));
        }
    }
}

fn not_supported(span: Span, what: &str) -> Problem {
    Problem::at(span, format!("`{what}` is not supported by this version")).help("remove it")
}
