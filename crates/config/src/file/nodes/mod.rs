//! Groups and modules in the file, and their relations.

pub(crate) mod filters;
pub(crate) mod other;
pub(crate) mod policy;
pub(crate) mod wording;

use super::forms::{self, ID, WRITERS};
use super::monitors::Monitor;
use crate::decode::{All, Entries, FromNode, Spanned};
use crate::fields::Fields;
use filters::{Filter, Writers};
use policy::Policy;
use telltale_engine::model::wording::Advice;
use telltale_engine::model::{Combine, Stage, Within};
use telltale_engine::state::State;
use telltale_engine::text::Text;
use telltale_yaml::decode::word;
use telltale_yaml::schema::{Json, default, least, most, needs_any, needs_one, not_empty, one_of, words};
use telltale_yaml::{KeyDoc, Kind, Log, Members, Node, Problem, Schema, Span, key, map};
use wording::RawWording;

#[derive(Debug)]
pub(crate) struct Group {
    pub span: Span,
    pub id: Option<Spanned<String>>,
    pub name: Option<Text>,
    pub tile: Option<Spanned<Tile>>,
    pub filters: Vec<Filter>,
    pub empty: Option<State>,
    /// The number of its modules that is right.
    pub count: Option<Spanned<u64>>,
    pub depends_on: Vec<Dependency>,
    pub when: Option<When>,
    pub combine: Option<Combine>,
    pub modules: Vec<Module>,
    pub groups: Vec<Group>,
}

impl FromNode for Group {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, map("group", "a group"), log)?;
        Some(Group {
            span: fields.span(),
            id: fields.required(ID),
            name: fields.optional("name"),
            tile: fields.optional("tile"),
            filters: fields.or_default(
                key("match").about("Statuses that match any of these become modules of this group."),
            ),
            empty: fields.choice(
                key("empty")
                    .about("The state of the group while it has no member.")
                    .rules(|| vec![default(State::Unknown.as_str())]),
                "state of an empty group",
                &[State::Ok, State::Unknown].map(|state| (state.as_str(), state)),
            ),
            count: fields.optional(
                key("count")
                    .about("How many modules the group must have, with those under `modules` and without nested groups: with another number it is in ERROR, after a `timeout` from the start. With `empty: ok`, none at all is right too.")
                    .rules(|| vec![least(1), most(COUNT_MAX)]),
            ),
            depends_on: fields.or_default(DEPENDS_ON),
            when: fields.optional("when"),
            combine: fields.optional(
                key("combine")
                    .about("`any`: redundant members; the best counts.")
                    .rules(|| vec![default("worst")]),
            ),
            modules: fields.or_default("modules"),
            groups: fields.or_default(key("groups").about("Groups inside of this one.")),
        })
    }
}

/// The largest number of modules that a group may be told to have.
pub(crate) const COUNT_MAX: u64 = 100_000;

impl FromNode for Combine {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "way to combine", &[("worst", Combine::Worst), ("any", Combine::Any)])
    }

    fn form(_: &mut Schema) -> Members {
        words(["worst", "any"])
    }
}

const DEPENDS_ON: KeyDoc = key("depends_on").about("What must work before this can be judged.");

/// The last column and the last row.
pub(crate) const TILE_MAX: u64 = 12;

#[derive(Debug, Clone, Copy)]
pub(crate) struct Tile {
    pub column: Option<u64>,
    pub row: Option<u64>,
}

impl FromNode for Tile {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let about = "The place of a group of the top level on the operator's screen.";
        let mut fields = Fields::of(node, map("tile", "a tile").about(about), log)?;
        let range = || vec![least(1), most(TILE_MAX)];
        let column = fields.required(key("column").rules(range));
        Some(Tile { column, row: fields.required(key("row").rules(range)) })
    }
}

#[derive(Debug)]
pub(crate) struct Dependency {
    pub span: Span,
    pub on: DependsOn,
    pub masks_unknown: bool,
    pub within: Option<Within>,
}

#[derive(Debug)]
pub(crate) enum DependsOn {
    Node(Spanned<String>),
    AnyOf(Vec<Spanned<String>>),
}

impl FromNode for Dependency {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let span = node.span;
        if let Kind::Scalar { .. } = node.kind {
            let name = FromNode::from_node(node, log)?;
            return Some(Dependency { span, on: DependsOn::Node(name), masks_unknown: false, within: None });
        }
        let doc = map("long_dependency", "a dependency").rules(|| vec![needs_one(&[&["on"], &["any_of"]])]);
        let mut fields = Fields::of(node, doc, log)?;
        let on = fields.optional(key("on").form(forms::node));
        let any_of = key("any_of")
            .about("Redundant: it blocks only when every one of these does.")
            .form(forms::nodes)
            .rules(not_empty);
        let any_of = fields.optional::<All<_>>(any_of);
        let masks_when: Option<Spanned<All<MasksWhen>>> =
            fields.optional(key("masks_when").about("The states of the dependency that mask.").rules(|| {
                let error = ("contains", Json::Object(vec![("const", "error".into())]));
                vec![("type", "array".into()), error, default(vec!["error"])]
            }));
        let within = fields.optional(key("within").about(
            "How far apart the beginnings of a cause and of an ERROR that it explains may be; `always`: any time. Otherwise the ERROR is a second fault and is shown. The default is `explains_within` of `defaults`.",
        ));
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
        let masks_unknown = masks_when.is_some_and(|states| masks(&states, State::Unknown));
        let on = on.map(DependsOn::Node).or(any_of.map(|All(names)| DependsOn::AnyOf(names)))?;
        Some(Dependency { span, on, masks_unknown, within })
    }

    fn form(schema: &mut Schema) -> Members {
        schema.define("dependency", |schema| one_of([forms::node(schema), schema.decoder(Self::from_node)]))
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

    fn form(_: &mut Schema) -> Members {
        words([State::Error, State::Unknown].map(State::as_str))
    }
}

#[derive(Debug)]
pub(crate) struct When {
    pub span: Span,
    /// Empty if no stage is named.
    pub stages: Vec<Stage>,
    pub signals: Entries<bool>,
}

impl FromNode for When {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let doc = map("when", "a `when`")
            .about("Where a condition does not hold, the node is ignored.")
            .rules(|| vec![("minProperties", 1.into())]);
        let mut fields = Fields::of(node, doc, log)?;
        let stages: Option<Spanned<All<Stage>>> =
            fields.optional(key("stages").about("Without it, every stage but `locked`.").rules(not_empty));
        if let Some(empty) = stages.as_ref().filter(|stages| stages.value.0.is_empty()) {
            let problem = Problem::at(empty.span, "without a stage this would never be diagnosed");
            fields.log.push(problem.help("name the stages, or remove `stages`"));
        }
        if fields.key_span("stages").is_none() && fields.key_span("signals").is_none() {
            let problem = Problem::at(node.span, "this `when` has no condition");
            fields.log.push(problem.help("add `stages: [...]` or `signals: { NAME: true }`, or remove it"));
        }
        let stages = stages.map(|stages| stages.value.0).unwrap_or_default();
        Some(When {
            span: node.span,
            stages,
            signals: fields
                .or_default(key("signals").about("The value that each of these signals must have.")),
        })
    }
}

impl FromNode for Stage {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "stage", &Stage::ALL.map(|stage| (stage.as_str(), stage)))
    }

    fn form(schema: &mut Schema) -> Members {
        schema.define("stage", |_| words(Stage::ALL.map(Stage::as_str)))
    }
}

#[derive(Debug)]
pub(crate) struct Module {
    pub span: Span,
    pub id: Option<Spanned<String>>,
    pub name: Option<RawWording<Text>>,
    pub help: Option<RawWording<Advice>>,
    pub policy: Policy,
    pub writers: Option<Writers>,
    pub when: Option<When>,
    pub depends_on: Vec<Dependency>,
    pub monitor: Option<Monitor>,
}

impl FromNode for Module {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let doc = map("module", "a module").rules(|| vec![needs_any(&[&["status"], &["monitor"]])]);
        let mut fields = Fields::of(node, doc, log)?;
        let status: Option<Spanned<String>> = fields.optional(key("status").about(
            "The exact name of the status that the module takes; beside `monitor` only with self_state and external.",
        ));
        let mut module = Module {
            span: fields.span(),
            id: fields.required(ID),
            name: fields.optional(key("name").about("What the fault is called. One text is for WARNING and ERROR.")),
            help: fields.optional(key("help").about("What the operator should do about it. One text is for the ERROR alone, and for the stages `cleared` and `active`.")),
            policy: Policy::of_module(&mut fields),
            writers: fields.optional(WRITERS),
            when: fields.optional("when"),
            depends_on: fields.or_default(DEPENDS_ON),
            monitor: fields.optional(key("monitor").about("How the module is judged; one kind.")),
        };
        let keys = (fields.key_span("status"), fields.key_span("monitor"));
        match keys {
            (None, None) => {
                let problem = Problem::at(module.span, "a module needs `status` or `monitor`");
                fields.log.push(problem.help("add `status: 'NAME OF THE STATUS'`"));
            }
            (_, None) => module.monitor = status.map(|status| Monitor::SelfState { status: Some(status) }),
            (place, Some(monitor)) => status_of_monitor(&mut module, status, (place, monitor), fields.log),
        }
        Some(module)
    }
}

/// A monitor of a status may take it from the module; no other kind of monitor is possible beside a `status`.
fn status_of_monitor(
    module: &mut Module,
    status: Option<Spanned<String>>,
    (place, monitor): (Option<Span>, Span),
    log: &mut Log,
) {
    let own = match &mut module.monitor {
        Some(Monitor::SelfState { status } | Monitor::External { status, .. }) => Some(status),
        _ => None,
    };
    match (own, place) {
        (Some(own @ None), Some(_)) => *own = status,
        (Some(None), None) => {
            let problem = Problem::at(monitor, "a monitor of a status needs `status`");
            log.push(problem.help("add `status: 'NAME OF THE STATUS'` to it"));
        }
        (_, Some(place)) => {
            let problem = Problem::at(monitor, "a module has either `status` or `monitor`");
            log.push(problem.also(place, "and here").help("remove one of the two"));
        }
        _ => {}
    }
}
