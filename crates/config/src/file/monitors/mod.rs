//! How a monitor is written: one kind each, with its sources, its limits and its window.

mod agreement;
pub(crate) mod bands;
mod frozen;
pub(crate) mod sources;
pub(crate) mod system;
pub(crate) mod tf;
pub(crate) mod watchdog;

use super::forms::default_span;
use crate::decode::{AllEntries, FromNode, Spanned};
use crate::expression::TEXT_BYTES_MAX;
use crate::fields::Fields;
use bands::{Unit, bands, some_bands};
use sources::ScalarSource;
pub(crate) use sources::{Source, Topic};
use telltale_engine::model::monitors::{
    AgreementRule, Bands, Class, FieldKind, FrozenLimits, ProbeTarget, Resource, ValueRule,
};
use telltale_engine::model::sample::FieldValue;
use telltale_engine::state::State;
use telltale_engine::time;
use telltale_yaml::decode::did_you_mean;
use telltale_yaml::schema::{Json, needs_any};
use telltale_yaml::{KeyDoc, Kind, Log, Members, Node, Problem, Schema, Span, key, map, suggest};

pub(crate) type Decoder = fn(&Node, &mut Log) -> Option<Monitor>;

/// The kinds of monitor, each with its decoder.
pub(crate) const KINDS: [(&str, Decoder); 14] = [
    ("self_state", self_state),
    ("frequency", frequency),
    ("latency", latency),
    ("value", single),
    ("frozen", frozen::frozen),
    ("watchdog", watchdog::watchdog),
    ("system", system::system),
    ("rate_ratio", rate_ratio),
    ("sequence", sequence),
    ("agreement", agreement::agreement),
    ("tf", tf::tf),
    ("expression", expression),
    ("external", external),
    ("constant", constant),
];

/// The memory of a monitor grows with these.
pub(crate) const WINDOW_MAX: time::Span = time::Span::from_secs(600);
pub(crate) const AGE_MAX: time::Span = time::Span::from_secs(3600);
pub(crate) const INPUTS_MAX: usize = 32;

const WINDOW: time::Span = time::Span::from_secs(2);
const AGE: time::Span = time::Span::from_secs(1);

#[derive(Debug)]
pub(crate) enum Monitor {
    /// Without a status, the module has it.
    SelfState {
        status: Option<Spanned<String>>,
    },
    External {
        status: Option<Spanned<String>>,
        class: Class,
    },
    Frequency {
        topic: Topic,
        window: time::Span,
        bands: Bands,
    },
    Latency {
        topic: Topic,
        window: time::Span,
        bands: Bands,
    },
    Value {
        source: Source,
        rule: ValueRule,
        empty: Option<State>,
    },
    Frozen {
        source: Source,
        limits: FrozenLimits,
    },
    Watchdog {
        target: ProbeTarget,
        /// Of the target.
        place: Span,
        every: time::Span,
        misses: u32,
        bands: Bands,
    },
    System {
        resource: Resource,
        every: time::Span,
        bands: Bands,
    },
    RateRatio {
        input: Topic,
        output: Topic,
        window: time::Span,
        bands: Bands,
    },
    Sequence {
        earlier: Source,
        later: Source,
        max_gap: time::Span,
        bands: Bands,
    },
    Agreement {
        a: Source,
        b: Source,
        max_age: time::Span,
        motion_over: Option<time::Span>,
        rule: AgreementRule,
    },
    Tf {
        /// From the first one downwards.
        frames: Vec<Spanned<String>>,
        namespace: Option<Spanned<String>>,
        bands: Bands,
    },
    Expression(Expression),
    Constant(State),
}

#[derive(Debug)]
pub(crate) struct Expression {
    pub inputs: Vec<(Spanned<String>, Source)>,
    pub max_age: time::Span,
    pub warning: Option<Spanned<String>>,
    pub error: Option<Spanned<String>>,
    pub class: Class,
}

impl FromNode for Monitor {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let Kind::Mapping(entries) = &node.kind else {
            let problem = Problem::at(node.span, format!("expected a monitor, found {}", node.describe()));
            log.push(problem.help("write `monitor: { KIND: { ... } }`"));
            return None;
        };
        let names = KINDS.map(|(name, _)| name);
        let known = || format!("one of: {}", names.join(", "));
        let [(kind, value)] = &entries[..] else {
            log.push(Problem::at(node.span, "a monitor has one kind").help(known()));
            return None;
        };
        let Some((_, read)) = KINDS.iter().find(|(name, _)| *name == kind.text) else {
            let help = suggest(&kind.text, names).map_or_else(known, did_you_mean);
            let text = format!("unknown kind of monitor `{}`", kind.text);
            log.push(Problem::at(kind.span, text).help(help));
            return None;
        };
        read(value, log)
    }

    fn form(schema: &mut Schema) -> Members {
        let kinds = KINDS.map(|(name, read)| (name, Json::Object(schema.decoder(read))));
        vec![
            ("type", "object".into()),
            ("additionalProperties", false.into()),
            ("minProperties", 1.into()),
            ("maxProperties", 1.into()),
            ("properties", Json::Object(kinds.into())),
        ]
    }
}

const MODULE_STATUS: KeyDoc = key("status").about("Needed where the module has no `status`.");

fn self_state(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("self_state", "a self_state monitor").about("The level in a status.");
    let mut fields = Fields::of(node, doc, log)?;
    Some(Monitor::SelfState { status: fields.optional(MODULE_STATUS) })
}

fn external(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("external", "an external monitor")
        .about("The level in a status of a domain-specific module elsewhere.");
    let mut fields = Fields::of(node, doc, log)?;
    let (status, class) = (fields.optional(MODULE_STATUS), fields.required("class"));
    Some(Monitor::External { status, class: class? })
}

fn constant(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("constant", "a constant monitor").about("Always the same state.");
    let mut fields = Fields::of(node, doc, log)?;
    let states = [State::Ok, State::Warning, State::Error, State::Unknown];
    let state = fields.choice(key("state"), "state", &states.map(|state| (state.as_str(), state)));
    fields.needs("state", "`state: ok`");
    state.map(Monitor::Constant)
}

fn frequency(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("frequency", "a frequency monitor").about("Messages in a second; limits in hertz.");
    let mut fields = Fields::of(node, doc, log)?;
    let (topic, window) = (Topic::of(&mut fields), window(&mut fields));
    let bands = some_bands(&mut fields, Unit::Hertz);
    Some(Monitor::Frequency { topic: topic?, window, bands })
}

fn latency(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("latency", "a latency monitor")
        .about("Receipt minus the stamp in the header, the worst of the window; limits as durations.");
    let mut fields = Fields::of(node, doc, log)?;
    let (topic, window) = (Topic::of(&mut fields), window(&mut fields));
    let mut bands = some_bands(&mut fields, Unit::Duration);
    let ahead =
        key("ahead").about("The state of a stamp more than 50 ms in the future: unknown, if it is missing.");
    bands.unmeasurable = bands::unmeasurable(&mut fields, ahead);
    Some(Monitor::Latency { topic: topic?, window, bands })
}

fn single(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc =
        map("value", "a value monitor").about("One value against limits, or against the one that is good.");
    let mut fields = Fields::of(node, doc, log)?;
    let mut source = Source::of(&mut fields, false);
    let mut bands = bands(&mut fields, Unit::Number);
    bands.unmeasurable = bands::unmeasurable(&mut fields, NAN);
    let empty = fields.choice(EMPTY, "state", &[State::Ok, State::Unknown].map(|it| (it.as_str(), it)));
    match (empty, &source, fields.key_span("empty")) {
        (Some(_), Some(Source::Key { .. }), Some(at)) => {
            let problem = Problem::at(at, "`empty` is for a topic whose messages are events");
            fields
                .log
                .push(problem.help("a status is said again and again; `stale` says what its silence is"));
        }
        (Some(State::Ok), Some(Source::Field { topic, .. }), Some(at)) if !topic.is_of(GOALS) => {
            let problem = Problem::at(at, format!("`empty: ok` is for the goals of an action ({GOALS})"));
            fields.log.push(
                problem.help("write `empty: unknown`: nobody knows the state before the first message"),
            );
        }
        _ => {}
    }
    let error: Option<Spanned<Literal>> =
        fields.optional(key("error_unless").about(
            "Any other value is an ERROR. A number may be called as in the definition of its message.",
        ));
    let warning: Option<Spanned<Literal>> =
        fields.optional(key("warning_unless").about("Any other value is a WARNING."));
    let unless = ["error_unless", "warning_unless"].into_iter().find_map(|key| fields.key_span(key));
    match (bands::any(&fields), unless) {
        (false, None) => {
            bands::without_a_limit(node.span, ", error_unless, warning_unless", fields.log);
        }
        (false, Some(unless)) if bands.unmeasurable.is_some() => {
            let problem = Problem::at(unless, "`nan` and `..._unless` do not go together");
            fields.log.push(problem.help("what is no number is not the one good value"));
        }
        (true, Some(unless)) => {
            let problem = Problem::at(unless, "limits and `..._unless` do not go together");
            fields.log.push(problem.help("limits are for numbers, `..._unless` is for the one good value"));
        }
        _ => {}
    }
    if let (Some(error), Some(warning)) = (&error, &warning)
        && error.value == warning.value
    {
        let problem = Problem::at(warning.span, "this WARNING is always an ERROR");
        fields.log.push(problem.also(error.span, "by this").help("remove one of the two"));
    }
    let mut wanted = error.iter().chain(&warning);
    if let Some(Source::Field { kind, .. }) = &mut source
        && unless.is_some()
        && wanted.all(|literal| matches!(literal.value.0, FieldValue::Text(_)))
    {
        *kind = FieldKind::Named;
    }
    let value = |literal: Option<Spanned<Literal>>| literal.map(|literal| literal.value.0);
    let rule = match unless {
        Some(_) => ValueRule::Unless { error: value(error), warning: value(warning) },
        None => ValueRule::Bands(bands),
    };
    Some(Monitor::Value { source: source?, rule, empty })
}

const NAN: KeyDoc = key("nan").about("The state of a value that is not a number: unknown, if it is missing.");

/// An action without a goal has nothing to say.
const GOALS: &str = "action_msgs/msg/GoalStatusArray";

const EMPTY: KeyDoc = key("empty").about(
    "Messages are events: the last one counts until the next one or, if it tells no fault, until all publishers have left, and `timeout` has no effect. The value is the state while somebody publishes the topic and nothing came. `ok` is for the goals of an action (action_msgs/msg/GoalStatusArray) alone: OK ten seconds after the publishers were found, if all of them are reliable and transient local, because others keep no message for late readers. With a best-effort publisher the state is UNKNOWN at best: a change may be lost.",
);

/// `true`, `3`, `armed`; in quotes it is a text.
#[derive(Debug, PartialEq)]
struct Literal(FieldValue);

impl FromNode for Literal {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let text = String::from_node(node, log)?;
        let plain = matches!(node.kind, Kind::Scalar { plain: true, .. });
        Some(Literal(match text.as_str() {
            "true" | "True" | "TRUE" if plain => FieldValue::Bool(true),
            "false" | "False" | "FALSE" if plain => FieldValue::Bool(false),
            _ if plain && text.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) => {
                FieldValue::Number(f64::from_node(node, log)?)
            }
            _ => FieldValue::Text(text.into()),
        }))
    }

    fn form(_: &mut Schema) -> Members {
        vec![("type", vec!["boolean", "number", "string"].into())]
    }
}

fn rate_ratio(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("rate_ratio", "a rate_ratio monitor")
        .about("The rate of the output divided by that of the input.");
    let mut fields = Fields::of(node, doc, log)?;
    let (input, output): (Option<Topic>, Option<Topic>) =
        (fields.required("input"), fields.required("output"));
    let window = window(&mut fields);
    let bands = some_bands(&mut fields, Unit::Size);
    let (input, output) = (input?, output?);
    if input.name.value == output.name.value {
        let problem = Problem::at(output.name.span, "input and output are one topic");
        fields.log.push(problem.also(input.name.span, "the input").help("name the topic that goes out"));
    }
    Some(Monitor::RateRatio { input, output, window, bands })
}

fn sequence(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("sequence", "a sequence monitor").about("Later minus earlier.");
    let mut fields = Fields::of(node, doc, log)?;
    let earlier = fields.required("earlier").map(|ScalarSource(source)| source);
    let later = fields.required("later").map(|ScalarSource(source)| source);
    let max_gap = age(&mut fields, key("max_gap").about("Values further apart are not compared."));
    let mut bands = some_bands(&mut fields, Unit::Number);
    bands.unmeasurable = bands::unmeasurable(&mut fields, NAN);
    Some(Monitor::Sequence { earlier: earlier?, later: later?, max_gap, bands })
}

fn expression(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("expression", "an expression monitor")
        .about("Conditions over the latest values of several sources.")
        .rules(|| vec![needs_any(&[&["warning"], &["error"]])]);
    let mut fields = Fields::of(node, doc, log)?;
    let inputs = key("inputs").about("The sources, by the names that the conditions use.").rules(input_rules);
    let inputs: Option<AllEntries<ScalarSource>> = fields.required(inputs);
    let max_age = age(&mut fields, MAX_AGE);
    let warning = fields.optional(key("warning").form(condition));
    let error = fields.optional(key("error").form(condition));
    if fields.key_span("warning").is_none() && fields.key_span("error").is_none() {
        let problem = Problem::at(node.span, "an expression needs `warning` or `error`");
        fields.log.push(problem.help("for example `error: x > 3 && !stopped`"));
    }
    let class = fields.optional("class");
    if let Some(inputs) = inputs.as_ref().filter(|inputs| !(1..=INPUTS_MAX).contains(&inputs.0.len())) {
        let text =
            format!("{}, not 1 to {INPUTS_MAX}", crate::describe::words::counted(inputs.0.len(), "input"));
        let problem = Problem::at(fields.key_span("inputs").unwrap_or(node.span), text);
        fields
            .log
            .push(problem.help("name what the conditions use: `x: { topic: /t, type: T, field: PATH }`"));
    }
    let inputs = inputs?.0.into_iter();
    // With a single input nothing is compared, so the diagnosis is isolated.
    let location = if inputs.len() == 1 { "isolated" } else { "contextual" };
    let named =
        inputs.map(|(key, ScalarSource(source))| (Spanned { value: key.text, span: key.span }, source));
    let class = class.unwrap_or(Class { location, information: "content", flow: None });
    Some(Monitor::Expression(Expression { inputs: named.collect(), max_age, warning, error, class }))
}

/// The inputs of a condition: at least one, each with a name that a condition can use.
pub(crate) fn input_rules() -> Members {
    let names = Json::Object(vec![("pattern", "^[A-Za-z_][A-Za-z0-9_]*$".into())]);
    vec![
        ("type", "object".into()),
        ("minProperties", 1.into()),
        ("maxProperties", INPUTS_MAX.into()),
        ("propertyNames", names),
    ]
}

fn condition(schema: &mut Schema) -> Members {
    schema.define("condition", |_| {
        let about = "In CEL: `speed > 3 && !stopped`. Numbers are doubles; functions are contains, startsWith, endsWith, double and those of math. Of a list: `goals.exists(goal, goal.status == 6)`, and `all`.";
        vec![
            ("description", about.into()),
            ("type", vec!["string", "boolean"].into()),
            ("maxLength", TEXT_BYTES_MAX.into()),
        ]
    })
}

fn window(fields: &mut Fields) -> time::Span {
    let doc = key("window")
        .about("The time over which the monitor judges: from 1ms to 10m.")
        .rules(|| vec![default_span(WINDOW)]);
    span(fields, doc, time::Span::from_millis(1), WINDOW_MAX).unwrap_or(WINDOW)
}

pub(crate) const MAX_AGE: KeyDoc = key("max_age").about("A value that is older is not used.");

/// The largest age of a value, or the largest time between two values.
pub(crate) fn age(fields: &mut Fields, key: KeyDoc) -> time::Span {
    let doc = key.rules(|| vec![default_span(AGE)]);
    span(fields, doc, time::Span::from_nanos(1), AGE_MAX).unwrap_or(AGE)
}

/// A duration within bounds.
pub(crate) fn span(
    fields: &mut Fields,
    doc: KeyDoc,
    least: time::Span,
    most: time::Span,
) -> Option<time::Span> {
    let span: Spanned<time::Span> = fields.optional(doc)?;
    if !(least..=most).contains(&span.value) {
        let (least, most) = (crate::describe::words::span(least), crate::describe::words::span(most));
        let problem = Problem::at(span.span, format!("`{}` is not between {least} and {most}", doc.name()));
        fields.log.push(problem.help("choose another duration"));
    }
    Some(span.value)
}
