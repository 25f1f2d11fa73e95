//! Groups and modules as they are written, and their relations.

use super::monitors::Monitor;
use super::policy::Policy;
use super::wording::RawWording;
use crate::config::glob;
use crate::config::glob::is_glob;
use crate::engine::model::{Combine, Stage};
use crate::engine::state::State;
use crate::engine::text::Text;
use crate::yaml::decode::{All, Entries, did_you_mean, scalar, word};
use crate::yaml::{Fields, FromNode, Kind, Log, Node, Problem, Span, Spanned, suggest};

#[derive(Debug)]
pub(in crate::config) struct Group {
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
pub(in crate::config) struct Tile {
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
pub(in crate::config) struct Filter {
    pub span: Span,
    pub kind: FilterKind,
    pub text: Spanned<String>,
    /// Of the modules that it makes.
    pub policy: Policy,
    pub writers: Option<Writers>,
}

/// The nodes that may say a status.
pub(in crate::config) type Writers = Spanned<All<Spanned<String>>>;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::config) enum FilterKind {
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
        let found: Vec<_> = KINDS.into_iter().filter(|(key, _)| fields.node(key).is_some()).collect();
        let policy = Policy::of_filter(&mut fields);
        let writers = fields.optional("writers");
        let filter = match found[..] {
            [(key, kind)] => {
                let text = fields.optional(key);
                text.map(|text| Filter { span: node.span, kind, text, policy, writers })
            }
            [] if let Some(problem) = unknown(&fields, node) => {
                fields.log.push(problem);
                return None;
            }
            _ => {
                let text = "a filter needs one of `name`, `namespace`, `contains`, `regex`";
                let problem = Problem::at(node.span, text);
                fields.log.push(problem.help("write one filter for each: `- { namespace: /sensors }`"));
                None
            }
        };
        fields.finish();
        filter
    }
}

/// A filter that there is not, and how the same is written: people bring their words from elsewhere.
fn unknown(fields: &Fields, filter: &Node) -> Option<Problem> {
    let Kind::Mapping(entries) = &filter.kind else { return None };
    let (key, node) = entries.iter().find(|(key, _)| !fields.knows(&key.text))?;
    let text = scalar(node).unwrap_or("...");
    let escaped = || regex_syntax::escape(text);
    let plain = key.text.to_lowercase().replace(['_', '-'], "");
    let help = match plain.as_str() {
        "startswith" | "beginswith" | "prefix" => format!(
            "write `namespace: {text}` for names that begin with it up to a `/` or `:`, or `regex: '{}.*'` for any",
            escaped()
        ),
        "endswith" | "suffix" => format!("write `regex: '.*{}'`", escaped()),
        "glob" | "pattern" | "wildcard" | "fnmatch" | "like" if is_glob(text) => {
            format!("write {}", glob::instead(text))
        }
        "pattern" | "regexp" | "re" | "matches" => format!("write `regex: '{text}'`"),
        "glob" | "wildcard" | "fnmatch" | "like" | "includes" | "substring" => {
            format!("write `contains: {text}`")
        }
        "equals" | "exact" | "is" | "status" | "id" => format!("write `name: {text}`"),
        _ => did_you_mean(suggest(&key.text, ["name", "namespace", "contains", "regex"])?),
    };
    Some(Problem::at(key.span, format!("there is no filter `{}`", key.text)).help(help))
}

#[derive(Debug)]
pub(in crate::config) struct Dependency {
    pub span: Span,
    pub on: DependsOn,
    pub masks_unknown: bool,
}

#[derive(Debug)]
pub(in crate::config) enum DependsOn {
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
pub(in crate::config) struct When {
    pub span: Span,
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
        let when = When { span: node.span, stages, signals: fields.or_default("signals") };
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
pub(in crate::config) struct Module {
    pub span: Span,
    pub id: Option<Spanned<String>>,
    pub name: Option<RawWording>,
    pub help: Option<RawWording>,
    pub policy: Policy,
    pub writers: Option<Writers>,
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
            policy: Policy::of_module(&mut fields),
            writers: fields.optional("writers"),
            when: fields.optional("when"),
            depends_on: fields.or_default("depends_on"),
            monitor: fields.optional("monitor"),
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
        fields.finish();
        Some(module)
    }
}

/// A monitor of a status may leave its name to the module; no other kind goes with a `status`.
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
