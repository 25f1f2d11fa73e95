//! Signals as they are written: a field, or a condition over values (`DESIGN.md` 5).

use super::monitors::INPUTS_MAX;
use super::sources::{ScalarSource, Source, Topic};
use crate::config::describe::words::counted;
use crate::engine::model::monitors::FieldKind;
use crate::engine::time;
use crate::yaml::decode::AllEntries;
use crate::yaml::{Fields, FromNode, Log, Node, Problem, Span, Spanned};

/// What the one value is called by which a condition without `inputs` asks.
const VALUE: &str = "value";

#[derive(Debug)]
pub(in crate::config) struct Signal {
    pub from: Option<SignalFrom>,
    pub timeout: Option<Spanned<time::Span>>,
    pub present_for: Option<Spanned<time::Span>>,
}

#[derive(Debug)]
pub(in crate::config) enum SignalFrom {
    Field {
        topic: Spanned<String>,
        type_name: Option<Spanned<String>>,
        field: Option<Spanned<String>>,
    },
    /// True while `when` holds.
    Condition {
        inputs: Vec<(Spanned<String>, Source)>,
        when: Spanned<String>,
    },
}

impl FromNode for Signal {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a signal", log)?;
        let (timeout, present_for) = (fields.optional("timeout"), fields.optional("present_for"));
        let when: Option<Spanned<String>> = fields.optional("when");
        let places = ["when", "inputs", "status", "key"].map(|key| fields.key_span(key));
        let from = match places {
            [None, None, None, None] => field(&mut fields),
            [Some(place), None, ..] => one_value(&mut fields, when, place),
            [Some(place), Some(_), ..] => values(&mut fields, when, place),
            [None, inputs, status, key] => {
                let place = inputs.or(status).or(key).unwrap_or(node.span);
                let problem = Problem::at(place, "a signal of values needs `when`");
                fields.log.push(problem.help("say when it is true, for example `when: value == 1`"));
                None
            }
        };
        // The other ways to write one, so that a key of theirs is known.
        for key in ["topic", "type", "field", "status", "key", "unit", "inputs"] {
            fields.node(key);
        }
        fields.finish();
        Some(Signal { from, timeout, present_for })
    }
}

fn field(fields: &mut Fields) -> Option<SignalFrom> {
    let (topic, type_name) = (fields.required("topic"), fields.optional("type"));
    let field = fields.optional("field");
    Some(SignalFrom::Field { topic: topic?, type_name, field })
}

/// `{ topic: /battery, type: T, field: power_supply_status, when: 'value == 1' }`
fn one_value(fields: &mut Fields, when: Option<Spanned<String>>, place: Span) -> Option<SignalFrom> {
    let whole = fields.key_span("topic").is_some() && fields.key_span("field").is_none();
    let source = if whole { only_field(Topic::of(fields)?, fields.log) } else { Source::of(fields, false) }?;
    let name = Spanned { value: VALUE.to_owned(), span: place };
    Some(SignalFrom::Condition { inputs: vec![(name, source)], when: when? })
}

/// Of a message with one field it need not be named.
fn only_field(topic: Topic, log: &mut Log) -> Option<Source> {
    if let Some(Spanned { value: type_name, span }) = &topic.type_name
        && !type_name.starts_with("std_msgs/")
    {
        let problem = Problem::at(*span, format!("which field of a {type_name}?"));
        log.push(problem.help("add `field: PATH`"));
        return None;
    }
    let path = Spanned { value: "data".to_owned(), span: topic.place() };
    Some(Source::Field { topic, path, kind: FieldKind::Scalar })
}

/// `{ inputs: { status: { topic, type, field } }, when: 'status == 1' }`
fn values(fields: &mut Fields, when: Option<Spanned<String>>, place: Span) -> Option<SignalFrom> {
    if let Some(beside) =
        ["topic", "type", "field", "status", "key"].iter().find_map(|key| fields.key_span(key))
    {
        let problem = Problem::at(beside, "the values of a condition come from `inputs`");
        fields.log.push(problem.also(place, "the condition").help("move this into one of the `inputs`"));
    }
    let inputs: Option<Spanned<AllEntries<ScalarSource>>> = fields.optional("inputs");
    let inputs = inputs?;
    let count = inputs.value.0.len();
    if !(1..=INPUTS_MAX).contains(&count) {
        let problem = Problem::at(inputs.span, format!("{}, not 1 to {INPUTS_MAX}", counted(count, "input")));
        fields
            .log
            .push(problem.help("name what the condition uses: `x: { topic: /t, type: T, field: PATH }`"));
    }
    let named = inputs.value.0.into_iter();
    let named =
        named.map(|(key, ScalarSource(source))| (Spanned { value: key.text, span: key.span }, source));
    Some(SignalFrom::Condition { inputs: named.collect(), when: when? })
}
