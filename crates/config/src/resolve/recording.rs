//! Converts the settings of the recording, within their bounds.

use crate::decode::Spanned;
use crate::describe::words;
use crate::file::publishing::Switch;
use crate::file::recording::{
    AFTER, BEFORE, DISK, EVERY, KEEP, MEMORY, RawRecordedTopic, RawRecording, TOPICS_MAX,
};
use crate::file::ros_names::check_topic_pattern;
use crate::recording::Recording;
use telltale_engine::model::monitors::RecordedTopic;
use telltale_engine::time::Span;
use telltale_yaml::{Log, Problem};

/// `None`: it is switched off.
pub(crate) fn recording(raw: Option<&Switch<RawRecording>>, log: &mut Log) -> Option<Recording> {
    let default = Recording::default();
    let raw = match raw {
        None => return Some(default),
        Some(Switch::Off(_)) => return None,
        Some(Switch::On(raw)) => raw,
    };
    Some(Recording {
        before: within(raw.before, default.before, BEFORE, words::span, log),
        after: within(raw.after, default.after, AFTER, words::span, log),
        memory: within(size(raw.memory), default.memory, MEMORY, words::bytes, log),
        disk: within(size(raw.disk), default.disk, DISK, words::bytes, log),
        keep: within(raw.keep, default.keep, KEEP, words::span, log),
        topics: topics(raw, log),
    })
}

fn topics(raw: &RawRecording, log: &mut Log) -> Vec<RecordedTopic> {
    if raw.topics.len() > TOPICS_MAX {
        let text = format!("{} recorded topics; at most {TOPICS_MAX} can be named", raw.topics.len());
        log.push(Problem::at(raw.span, text).help("name several at once: `/camera/*`"));
    }
    let mut topics: Vec<RecordedTopic> = Vec::new();
    for RawRecordedTopic { topic, every } in &raw.topics {
        let Some(topic) = topic else { continue };
        check_topic_pattern(topic, log);
        if topics.iter().any(|known| *known.pattern == *topic.value) {
            let problem = Problem::at(topic.span, format!("{} is recorded already", topic.value));
            log.push(problem.help("name each topic once"));
        }
        let every = every.map(|Spanned { value, span }| Spanned { value: value.0, span });
        let is_possible = |every: &Spanned<Span>| {
            every.value == RecordedTopic::NEVER || (EVERY.0..=EVERY.1).contains(&every.value)
        };
        if let Some(every) = every.filter(|every| !is_possible(every)) {
            let [given, least, most] = [every.value, EVERY.0, EVERY.1].map(words::span);
            let problem = Problem::at(every.span, format!("{given} is not between {least} and {most}"));
            log.push(problem.help("without `every`, all messages are recorded"));
        }
        let every = every.map_or(Span::ZERO, |every| every.value);
        topics.push(RecordedTopic { pattern: topic.value.as_str().into(), every });
    }
    topics
}

fn size(value: Option<Spanned<crate::file::recording::Bytes>>) -> Option<Spanned<u64>> {
    value.map(|Spanned { value, span }| Spanned { value: value.0, span })
}

fn within<T: PartialOrd + Copy>(
    value: Option<Spanned<T>>,
    otherwise: T,
    (least, most): (T, T),
    words: impl Fn(T) -> String,
    log: &mut Log,
) -> T {
    let Some(value) = value else { return otherwise };
    if value.value < least || value.value > most {
        let [given, least, most] = [value.value, least, most].map(&words);
        let problem = Problem::at(value.span, format!("{given} is not between {least} and {most}"));
        log.push(problem.help(format!("the default is {}", words(otherwise))));
    }
    value.value
}
