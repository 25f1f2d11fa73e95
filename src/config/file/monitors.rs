//! Monitors as they are written (`DESIGN.md` 5).

use super::agreement;
use super::bands;
use super::bands::{Unit, bands};
use super::sources::ScalarSource;
pub(in crate::config) use super::sources::{Source, Topic};
use super::watchdog;
use crate::engine::model::monitors::Class;
use crate::engine::model::monitors::{AgreementRule, Bands, ProbeTarget, ValueRule};
use crate::engine::model::sample::FieldValue;
use crate::engine::time;
use crate::yaml::decode::{AllEntries, did_you_mean};
use crate::yaml::{Fields, FromNode, Kind, Log, Node, Problem, Spanned, suggest};

/// The kinds of monitor (`ENGINE.md` 7).
pub(in crate::config) const KINDS: [&str; 10] = [
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

/// What is kept grows with these.
pub(in crate::config) const WINDOW_MAX: time::Span = time::Span::from_secs(600);
pub(in crate::config) const AGE_MAX: time::Span = time::Span::from_secs(3600);
pub(in crate::config) const INPUTS_MAX: usize = 32;

const WINDOW: time::Span = time::Span::from_secs(2);
const AGE: time::Span = time::Span::from_secs(1);

#[derive(Debug)]
pub(in crate::config) enum Monitor {
    /// Without a status it is the module that names it.
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
    },
    Watchdog {
        target: ProbeTarget,
        every: time::Span,
        misses: u32,
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
    Expression(Expression),
}

#[derive(Debug)]
pub(in crate::config) struct Expression {
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
        let known = || format!("one of: {}", KINDS.join(", "));
        let [(kind, value)] = &entries[..] else {
            log.push(Problem::at(node.span, "a monitor has one kind").help(known()));
            return None;
        };
        match kind.text.as_str() {
            "self_state" => self_state(value, log),
            "external" => external(value, log),
            "frequency" => rate(value, log),
            "latency" => latency(value, log),
            "value" => single(value, log),
            "watchdog" => watchdog::watchdog(value, log),
            "rate_ratio" => rate_ratio(value, log),
            "sequence" => sequence(value, log),
            "agreement" => agreement::agreement(value, log),
            "expression" => expression(value, log),
            other => {
                let help = suggest(other, KINDS).map_or_else(known, did_you_mean);
                log.push(Problem::at(kind.span, format!("unknown kind of monitor `{other}`")).help(help));
                None
            }
        }
    }
}

fn self_state(node: &Node, log: &mut Log) -> Option<Monitor> {
    let mut fields = Fields::of(node, "a self_state monitor", log)?;
    let status = fields.optional("status");
    fields.finish();
    Some(Monitor::SelfState { status })
}

fn external(node: &Node, log: &mut Log) -> Option<Monitor> {
    let mut fields = Fields::of(node, "an external monitor", log)?;
    let (status, class) = (fields.optional("status"), fields.required("class"));
    fields.finish();
    Some(Monitor::External { status, class: class? })
}

fn rate(node: &Node, log: &mut Log) -> Option<Monitor> {
    let mut fields = Fields::of(node, "a frequency monitor", log)?;
    let (topic, window) = (Topic::of(&mut fields), window(&mut fields));
    let bands = some_bands(&mut fields, Unit::Hertz);
    fields.finish();
    Some(Monitor::Frequency { topic: topic?, window, bands })
}

fn latency(node: &Node, log: &mut Log) -> Option<Monitor> {
    let mut fields = Fields::of(node, "a latency monitor", log)?;
    let (topic, window) = (Topic::of(&mut fields), window(&mut fields));
    let bands = some_bands(&mut fields, Unit::Duration);
    fields.finish();
    Some(Monitor::Latency { topic: topic?, window, bands })
}

fn single(node: &Node, log: &mut Log) -> Option<Monitor> {
    let mut fields = Fields::of(node, "a value monitor", log)?;
    let source = Source::of(&mut fields, false);
    let bands = bands(&mut fields, Unit::Number);
    let error: Option<Spanned<Literal>> = fields.optional("error_unless");
    let warning: Option<Spanned<Literal>> = fields.optional("warning_unless");
    let unless = ["error_unless", "warning_unless"].into_iter().find_map(|key| fields.key_span(key));
    match (bands::any(&fields), unless) {
        (false, None) => {
            bands::without_a_limit(node.span, ", error_unless, warning_unless", fields.log);
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
    fields.finish();
    let value = |literal: Option<Spanned<Literal>>| literal.map(|literal| literal.value.0);
    let rule = match unless {
        Some(_) => ValueRule::Unless { error: value(error), warning: value(warning) },
        None => ValueRule::Bands(bands),
    };
    Some(Monitor::Value { source: source?, rule })
}

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
}

fn rate_ratio(node: &Node, log: &mut Log) -> Option<Monitor> {
    let mut fields = Fields::of(node, "a rate_ratio monitor", log)?;
    let (input, output): (Option<Topic>, Option<Topic>) =
        (fields.required("input"), fields.required("output"));
    let window = window(&mut fields);
    let bands = some_bands(&mut fields, Unit::Size);
    fields.finish();
    let (input, output) = (input?, output?);
    if input.name.value == output.name.value {
        let problem = Problem::at(output.name.span, "input and output are one topic");
        log.push(problem.also(input.name.span, "the input").help("name the topic that goes out"));
    }
    Some(Monitor::RateRatio { input, output, window, bands })
}

fn sequence(node: &Node, log: &mut Log) -> Option<Monitor> {
    let mut fields = Fields::of(node, "a sequence monitor", log)?;
    let earlier = fields.required("earlier").map(|ScalarSource(source)| source);
    let later = fields.required("later").map(|ScalarSource(source)| source);
    let max_gap = age(&mut fields, "max_gap");
    let bands = some_bands(&mut fields, Unit::Number);
    fields.finish();
    Some(Monitor::Sequence { earlier: earlier?, later: later?, max_gap, bands })
}

fn expression(node: &Node, log: &mut Log) -> Option<Monitor> {
    let mut fields = Fields::of(node, "an expression monitor", log)?;
    let inputs: Option<AllEntries<ScalarSource>> = fields.required("inputs");
    let max_age = age(&mut fields, "max_age");
    let (warning, error) = (fields.optional("warning"), fields.optional("error"));
    if fields.key_span("warning").is_none() && fields.key_span("error").is_none() {
        let problem = Problem::at(node.span, "an expression needs `warning` or `error`");
        fields.log.push(problem.help("for example `error: x > 3 && !stopped`"));
    }
    let class = fields.optional("class");
    if let Some(inputs) = inputs.as_ref().filter(|inputs| !(1..=INPUTS_MAX).contains(&inputs.0.len())) {
        let text = format!(
            "{}, not 1 to {INPUTS_MAX}",
            crate::config::describe::words::counted(inputs.0.len(), "input")
        );
        let problem = Problem::at(fields.key_span("inputs").unwrap_or(node.span), text);
        fields
            .log
            .push(problem.help("name what the conditions use: `x: { topic: /t, type: T, field: PATH }`"));
    }
    fields.finish();
    let inputs = inputs?.0.into_iter();
    // What looks at one value sets nothing against anything.
    let location = if inputs.len() == 1 { "isolated" } else { "contextual" };
    let named =
        inputs.map(|(key, ScalarSource(source))| (Spanned { value: key.text, span: key.span }, source));
    let class = class.unwrap_or(Class { location, information: "content", flow: None });
    Some(Monitor::Expression(Expression { inputs: named.collect(), max_age, warning, error, class }))
}

fn some_bands(fields: &mut Fields, unit: Unit) -> Bands {
    let found = bands(fields, unit);
    if !bands::any(fields) {
        bands::without_a_limit(fields.span(), "", fields.log);
    }
    found
}

fn window(fields: &mut Fields) -> time::Span {
    span(fields, "window", time::Span::from_millis(1), WINDOW_MAX).unwrap_or(WINDOW)
}

pub(in crate::config) fn age(fields: &mut Fields, key: &'static str) -> time::Span {
    span(fields, key, time::Span::from_nanos(1), AGE_MAX).unwrap_or(AGE)
}

/// A duration within bounds.
pub(in crate::config) fn span(
    fields: &mut Fields,
    key: &'static str,
    least: time::Span,
    most: time::Span,
) -> Option<time::Span> {
    let span: Spanned<time::Span> = fields.optional(key)?;
    if !(least..=most).contains(&span.value) {
        let (least, most) =
            (crate::config::describe::words::span(least), crate::config::describe::words::span(most));
        let problem = Problem::at(span.span, format!("`{key}` is not between {least} and {most}"));
        fields.log.push(problem.help("choose another duration"));
    }
    Some(span.value)
}
