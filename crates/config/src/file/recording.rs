//! The recording as it is written: `recording: { before: 30s, after: 10s, memory: 256MB, disk: 10GB, keep: 30d,
//! topics: [{ topic: /points, every: 500ms }] }`.

use super::forms::{default_span, duration, example, with_about};
use crate::decode::{All, FromNode, Spanned};
use crate::describe::words;
use crate::fields::Fields;
use crate::recording::Recording;
use telltale_engine::model::monitors::RecordedTopic;
use telltale_engine::time;
use telltale_yaml::decode::{scalar, scaled};
use telltale_yaml::schema::{default, one_of, pattern, words as words_of};
use telltale_yaml::{Log, Members, Node, Problem, Schema, Span, key, map};

/// The bounds of its keys.
pub(crate) const BEFORE: (time::Span, time::Span) = (time::Span::from_secs(1), time::Span::from_secs(120));
pub(crate) const AFTER: (time::Span, time::Span) = (time::Span::from_secs(1), time::Span::from_secs(60));
pub(crate) const MEMORY: (u64, u64) = (4_000_000, 16_000_000_000);
pub(crate) const DISK: (u64, u64) = (100_000_000, 100_000_000_000_000);
pub(crate) const EVERY: (time::Span, time::Span) = (time::Span::from_millis(1), time::Span::from_secs(3600));
pub(crate) const TOPICS_MAX: usize = 64;
pub(crate) const KEEP: (time::Span, time::Span) =
    (time::Span::from_secs(3600), time::Span::from_secs(3650 * 24 * 3600));

#[derive(Debug)]
pub(crate) struct RawRecording {
    pub before: Option<Spanned<time::Span>>,
    pub after: Option<Spanned<time::Span>>,
    pub memory: Option<Spanned<Bytes>>,
    pub disk: Option<Spanned<Bytes>>,
    pub keep: Option<Spanned<time::Span>>,
    pub topics: Vec<RawRecordedTopic>,
    pub span: Span,
}

impl FromNode for RawRecording {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let about = "The recording of every incident, from before its beginning; `false` switches it off.";
        let mut fields = Fields::of(node, map("recording", "the recording").about(about), log)?;
        Some(RawRecording {
            before: fields.optional(
                key("before")
                    .about("The time before the first trigger that a recording has, from 1s to 2m.")
                    .rules(|| vec![default_span(Recording::default().before)]),
            ),
            after: fields.optional(
                key("after")
                    .about("The time after the last trigger, from 1s to 1m.")
                    .rules(|| vec![default_span(Recording::default().after)]),
            ),
            memory: fields.optional(
                key("memory")
                    .about("The memory for the time before a trigger. If it is too small for `before`, a WARNING says so.")
                    .rules(|| vec![default(words::bytes(Recording::default().memory))]),
            ),
            disk: fields.optional(
                key("disk")
                    .about("All recordings together take at most this; beyond it the oldest are removed, but never a marked or kept one.")
                    .rules(|| vec![default(words::bytes(Recording::default().disk))]),
            ),
            keep: fields.optional(
                key("keep")
                    .about("An older recording is removed, unless it is marked or kept.")
                    .rules(|| vec![default_span(Recording::default().keep)]),
            ),
            topics: fields
                .optional(
                    key("topics")
                        .about("Topics to record beside those that Telltale reads anyway.")
                        .rules(|| vec![("maxItems", TOPICS_MAX.into())]),
                )
                .map_or_else(Vec::new, |All(topics)| topics),
            span: node.span,
        })
    }
}

#[derive(Debug)]
pub(crate) struct RawRecordedTopic {
    pub topic: Option<Spanned<String>>,
    pub every: Option<Spanned<Every>>,
}

impl FromNode for RawRecordedTopic {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let about = "A topic that is recorded, or several: `*` stands for any characters.";
        let mut fields = Fields::of(node, map("recorded_topic", "a recorded topic").about(about), log)?;
        let every = key("every")
            .about("At most one message of each topic in this time is recorded; without it, all are. From 1ms to 1h; or `never`: of a topic that a monitor reads, the times and sizes alone.");
        Some(RawRecordedTopic {
            topic: fields.required(
                key("topic").about("The full name, in which `*` stands for any characters: `/camera/*`."),
            ),
            every: fields.optional(every),
        })
    }
}

/// A time between two messages, or [`RecordedTopic::NEVER`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Every(pub time::Span);

impl FromNode for Every {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        match scalar(node) {
            Some("never") => Some(Every(RecordedTopic::NEVER)),
            _ => time::Span::from_node(node, log).map(Every),
        }
    }

    fn form(schema: &mut Schema) -> Members {
        one_of([duration(schema), words_of(["never"])])
    }
}

/// A number of bytes with its unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Bytes(pub u64);

/// A unit that ends with another one comes before it.
const UNITS: [(&str, u64); 4] =
    [("kB", 1_000), ("MB", 1_000_000), ("GB", 1_000_000_000), ("TB", 1_000_000_000_000)];

impl FromNode for Bytes {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let bytes = scalar(node).and_then(parse);
        if bytes.is_none() {
            let problem = Problem::at(node.span, format!("expected a size, found {}", node.describe()));
            log.push(
                problem.help("write a number with one of the units kB, MB, GB, TB: for example `256MB`"),
            );
        }
        bytes
    }

    fn form(schema: &mut Schema) -> Members {
        schema.define("bytes", |_| {
            let form = pattern("^[0-9]+(\\.[0-9]+)? *(kB|MB|GB|TB)$");
            example(&["256MB", "10GB"], with_about("A number of bytes with its unit.", form))
        })
    }
}

fn parse(text: &str) -> Option<Bytes> {
    let unit_start = text.find(|c: char| !c.is_ascii_digit() && c != '.')?;
    let (number, unit) = (&text[..unit_start], text[unit_start..].trim_start());
    let (_, scale) = UNITS.iter().find(|(name, _)| *name == unit)?;
    scaled(number, *scale).map(Bytes)
}
