//! Signals in the file: a field of a topic, or a condition over values.

use super::forms;
use super::monitors::sources::{ScalarSource, Source, Topic, may_have_source};
use super::monitors::{INPUTS_MAX, input_rules};
use crate::decode::{AllEntries, FromNode, Spanned};
use crate::describe::words::counted;
use crate::fields::Fields;
use telltale_engine::model::monitors::FieldKind;
use telltale_engine::text::Text;
use telltale_engine::time;
use telltale_yaml::schema::needs_any;
use telltale_yaml::{KeyDoc, Log, Node, Problem, Span, key, map};

/// The name of the value in a condition without `inputs`.
const VALUE: &str = "value";

#[derive(Debug)]
pub(crate) struct Signal {
    pub from: Option<SignalFrom>,
    pub title: Option<Text>,
    pub timeout: Option<Spanned<time::Span>>,
    pub present_for: Option<Spanned<time::Span>>,
}

#[derive(Debug)]
pub(crate) enum SignalFrom {
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

const FIELD: KeyDoc = key("field")
    .about("Path of a truth value, or of the `value` in `when`; `data` for std_msgs.")
    .form(forms::path);
const WHEN: KeyDoc = key("when")
    .about("A condition in CEL: the signal is true while it holds, unknown while an input is.")
    .rules(|| vec![("examples", vec!["value == 1", "status == 1 && speed < 0.1"].into())]);
const INPUTS: KeyDoc = key("inputs")
    .about("The sources of the condition, by the names that it uses. Without them it is about one `value`.")
    .rules(input_rules);

impl FromNode for Signal {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let doc = map("signal", "a signal")
            .about("A truth value of a topic, or a condition over values.")
            .rules(|| vec![needs_any(&[&["topic"], &["inputs", "when"], &["status", "key", "when"]])]);
        let mut fields = Fields::of(node, doc, log)?;
        // Every way to write a signal, so that the keys of each are known.
        may_have_source(&mut fields, FIELD);
        let when: Option<Spanned<String>> = fields.optional(WHEN);
        fields.may_have::<AllEntries<ScalarSource>>(INPUTS);
        let title = fields
            .optional(key("name").about("What the machine is while it is true, for the page: `on its way`."));
        let timeout = fields.optional(key("timeout").about("Older than this, the signal is unknown."));
        let present_for = fields.optional(
            key("present_for")
                .about("True for this long after each message: for topics whose message is an event."),
        );
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
        Some(Signal { from, title, timeout, present_for })
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

/// The field of a message with a single field need not be named.
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
