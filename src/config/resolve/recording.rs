//! Converts the settings of the recording, within their bounds.

use crate::config::describe::words;
use crate::config::file::publishing::Switch;
use crate::config::file::recording::{AFTER, BEFORE, DISK, KEEP, MEMORY, RawRecording};
use crate::config::recording::Recording;
use crate::yaml::{Log, Problem, Spanned};

/// `None`: it is switched off.
pub(in crate::config) fn recording(raw: Option<&Switch<RawRecording>>, log: &mut Log) -> Option<Recording> {
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
    })
}

fn size(value: Option<Spanned<crate::config::file::recording::Bytes>>) -> Option<Spanned<u64>> {
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
