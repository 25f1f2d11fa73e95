//! Converts signals from the file into signals of the model.

use std::collections::HashMap;

use super::names::check_id;
use super::topics::Topics;
use super::{monitors, twice};
use crate::decode::Spanned;
use crate::describe::places::SignalPlace;
use crate::expression;
use crate::file::monitors::sources::Source;
use crate::file::ros_names::check_path;
use crate::file::{Signal, SignalFrom};
use telltale_engine::model::monitors::Class;
use telltale_engine::model::{FieldSource, MonitorSpec, POSED_SIGNAL, SignalSource, SignalSpec};
use telltale_engine::time;
use telltale_yaml::tree::Key;
use telltale_yaml::{Log, Problem, Span};

/// The signals and their places.
pub(crate) fn signals(
    written: &[(Key, Signal)],
    topics: &mut Topics,
    log: &mut Log,
) -> (Vec<SignalSpec>, Vec<SignalPlace>) {
    let mut seen: HashMap<&str, Span> = HashMap::new();
    let (mut signals, mut places) = (Vec::new(), Vec::new());
    for (key, raw) in written {
        check_id(&Spanned { value: key.text.clone(), span: key.span }, "signal", log);
        if key.text == POSED_SIGNAL {
            let problem = Problem::at(key.span, "`posed` is built in: it says that the operator gave a pose");
            log.push(problem.help("choose another name"));
        }
        if let Some(first) = seen.insert(&key.text, key.span) {
            log.push(twice(key.span, first, &format!("signal `{}`", key.text)));
        }
        for span in [raw.timeout, raw.present_for].into_iter().flatten().filter(|span| span.value.is_zero()) {
            log.push(Problem::at(span.span, "expected a duration above 0").help("for example `2s`"));
        }
        let found = match &raw.from {
            None => None,
            Some(SignalFrom::Field { topic, type_name, field }) => {
                let is_event = raw.present_for.is_some();
                field_source(topic, type_name.as_ref(), field.as_ref(), is_event, topics, log)
            }
            Some(SignalFrom::Condition { inputs, when }) => condition(inputs, when, topics, log),
        };
        // Without a source the model is discarded; the signal keeps its name, which other keys refer to.
        let (source, place) = found.unwrap_or_else(|| {
            let nothing = FieldSource { topic: "".into(), type_name: "".into(), field: "".into() };
            (SignalSource::Field(nothing), SignalPlace::at(key.span))
        });
        places.push(place);
        signals.push(SignalSpec {
            name: key.text.as_str().into(),
            title: raw.title.clone(),
            source,
            timeout: raw.timeout.map(|span| span.value),
            present_for: raw.present_for.map(|span| span.value),
        });
    }
    (signals, places)
}

fn field_source(
    topic: &Spanned<String>,
    type_name: Option<&Spanned<String>>,
    field: Option<&Spanned<String>>,
    is_event: bool,
    topics: &mut Topics,
    log: &mut Log,
) -> Option<(SignalSource, SignalPlace)> {
    topics.read(topic, type_name, log);
    let path = match field {
        Some(field) => {
            check_path(field, log);
            &field.value
        }
        None if type_name.is_some_and(|it| it.value.starts_with("std_msgs/")) => "data",
        // Then only the arrival of a message counts.
        None if is_event => "",
        None => {
            // An unknown type is assumed to be one of std_msgs.
            let Some(Spanned { value, span }) = type_name else { return Some(of_any_type(topic)) };
            let problem = Problem::at(*span, format!("which field of a {value}?"));
            log.push(problem.help("add `field: PATH`, or `present_for: 1h` if only its arrival matters"));
            return None;
        }
    };
    let source = FieldSource {
        topic: topic.value.as_str().into(),
        type_name: type_name.map_or("", |type_name| &type_name.value).into(),
        field: path.into(),
    };
    let of_type = type_name.map_or(topic.span, |type_name| type_name.span);
    let field = field.map_or(of_type, |field| field.span);
    let place = SignalPlace { topic: topic.span, type_name: of_type, field };
    Some((SignalSource::Field(source), place))
}

fn of_any_type(topic: &Spanned<String>) -> (SignalSource, SignalPlace) {
    let name = topic.value.as_str().into();
    let source = FieldSource { topic: name, type_name: "".into(), field: "data".into() };
    (SignalSource::Field(source), SignalPlace::at(topic.span))
}

/// Completes the types of signals from other places of the file that name the same topic.
pub(crate) fn complete(signals: &mut [SignalSpec], topics: &Topics) {
    for signal in signals {
        if let SignalSource::Field(source) = &mut signal.source
            && source.type_name.is_empty()
        {
            source.type_name = topics.type_of(&source.topic).into();
        }
    }
}

fn condition(
    inputs: &[(Spanned<String>, Source)],
    when: &Spanned<String>,
    topics: &mut Topics,
    log: &mut Log,
) -> Option<(SignalSource, SignalPlace)> {
    for (name, _) in inputs {
        expression::check_name(name, log);
    }
    let inputs = monitors::inputs(inputs, &[when], topics, log);
    let names: Vec<&str> = inputs.iter().map(|(name, _)| &**name).collect();
    let condition = expression::condition(when, &names, log);
    let spec = MonitorSpec::Expression {
        inputs,
        // The signal's own timeout bounds their age.
        max_age: time::Span::from_nanos(u64::MAX),
        warning: None,
        error: Some(condition?),
        class: Class { location: "contextual", information: "content", flow: None },
    };
    Some((SignalSource::Condition(Box::new(spec)), SignalPlace::at(when.span)))
}
