//! The observations of a system: its messages and its discovery. Everything that others can make grow has a bound.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::names::{is_full_name, is_tool, is_type};
use super::rhythm::Rhythm;
use super::values;
use telltale_engine::discovery::{Discovery, TopicSeen};
use telltale_engine::input::{Input, NodeOf, StatusArray, WriterId};
use telltale_engine::model::monitors::{DIAGNOSTIC_ARRAY, DIAGNOSTICS, FieldKind, FieldSpec, TF_MESSAGE};
use telltale_engine::model::sample::{FieldValue, Fingerprint, Sample};
use telltale_engine::state::State;
use telltale_engine::time::Timestamp;

/// Statuses that are told apart, as many as a configuration discovers without more ado.
pub const STATUSES_MAX: usize = 4096;
/// Topics that are measured at a time: each has a reader.
pub const TOPICS_MAX: usize = 300;
/// Nodes that are remembered.
const NODES_MAX: usize = 20_000;
/// Writers of one status that are remembered.
const WRITERS_MAX: usize = 8;
const NAME_BYTES_MAX: usize = 256;
/// Frames of one topic of transforms that are told apart.
const FRAMES_MAX: usize = 64;
/// Transforms of one message that are read.
const TRANSFORMS_MAX: usize = 16;

/// Topics that belong to ROS itself, or repeat what others said.
const INFRASTRUCTURE: [&str; 6] = [
    "/rosout",
    "/parameter_events",
    "/clock",
    DIAGNOSTICS,
    "/diagnostics_agg",
    "/diagnostics_toplevel_state",
];

#[derive(Debug, Clone, Default)]
pub struct Observations {
    pub discovery: Arc<Discovery>,
    pub statuses: BTreeMap<Box<str>, Status>,
    /// Reports under names beyond the bound, without a name, or with one that is too long.
    pub refused: u64,
    pub topics: BTreeMap<Box<str>, Messages>,
    /// The nodes of writers of diagnostics.
    pub nodes: BTreeMap<WriterId, Arc<str>>,
    /// Every node that was ever announced: one that ended keeps its group.
    pub announced: BTreeSet<Box<str>>,
}

#[derive(Debug, Clone)]
pub struct Status {
    pub rhythm: Rhythm,
    pub last: State,
    pub worst: State,
    pub writers: BTreeSet<WriterId>,
}

/// The messages of a topic that was measured.
#[derive(Debug, Clone, Default)]
pub struct Messages {
    pub rhythm: Rhythm,
    /// The least and greatest time from the stamp to the receipt.
    pub age_ns: Option<(i64, i64)>,
    /// The content of the last one, if it can be read.
    content: Option<Fingerprint>,
    /// Messages with the same content as the one before them.
    pub repeated: u64,
    /// The last value of a field that is read because of its meaning.
    pub value: Option<FieldValue>,
    /// The child frames of transforms.
    pub frames: BTreeMap<Box<str>, Frame>,
}

/// A frame below another one.
#[derive(Debug, Clone)]
pub struct Frame {
    pub parent: Box<str>,
    pub rhythm: Rhythm,
    /// It has another parent, too.
    pub has_two: bool,
}

/// The fields that are read of messages of this type, beside a fingerprint of their content.
pub fn more_fields(type_name: &str) -> impl Iterator<Item = FieldSpec> {
    let count = if type_name == TF_MESSAGE { TRANSFORMS_MAX } else { 0 };
    let of = |at: usize| ["header.frame_id", "child_frame_id"].map(|name| format!("transforms[{at}].{name}"));
    let paths = (0..count).flat_map(of).chain(values::field(type_name).map(str::to_owned));
    paths.map(|path| FieldSpec::new(path, FieldKind::Scalar))
}

impl Messages {
    /// Takes the transforms of a message: pairs of a parent and a child.
    fn take_frames(&mut self, values: &[FieldValue], at: Timestamp) {
        for pair in values.chunks_exact(2) {
            let [FieldValue::Text(parent), FieldValue::Text(child)] = pair else { continue };
            let has_room = self.frames.len() < FRAMES_MAX || self.frames.contains_key(child);
            if !has_room || !is_frame(parent) || !is_frame(child) {
                continue;
            }
            let new = || Frame { parent: parent.clone(), rhythm: Rhythm::default(), has_two: false };
            let frame = self.frames.entry(child.clone()).or_insert_with(new);
            frame.has_two |= frame.parent != *parent;
            frame.rhythm.beat(at);
        }
    }

    /// Whether all of them could be compared, and each differed from the one before it.
    pub fn never_repeats(&self) -> bool {
        self.content.is_some() && self.repeated == 0
    }
}

impl Observations {
    /// Takes what discovery says now.
    pub fn see(&mut self, discovery: Arc<Discovery>) {
        let new = discovery.nodes.iter().map(|node| Box::from(&**node));
        let room = NODES_MAX.saturating_sub(self.announced.len());
        let new: Vec<Box<str>> = new.filter(|node| !self.announced.contains(node)).take(room).collect();
        self.announced.extend(new);
        self.discovery = discovery;
    }

    /// Takes an input of the bridge.
    pub fn take(&mut self, input: &Input, at: Timestamp) {
        match input {
            Input::Diagnostics(array) => self.hear(array, at),
            Input::Sample(sample) => self.measure(sample, at),
            Input::Writers(list) => {
                let named = list.writers.iter().filter_map(|(writer, node)| match node {
                    NodeOf::Named(name) => Some((*writer, name.clone())),
                    NodeOf::Pending | NodeOf::Unannounced => None,
                });
                self.nodes.extend(named.take(STATUSES_MAX.saturating_sub(self.nodes.len())));
            }
            _ => {}
        }
    }

    fn hear(&mut self, array: &StatusArray, at: Timestamp) {
        for status in array.iter() {
            let name = status.name();
            let has_room = self.statuses.len() < STATUSES_MAX || self.statuses.contains_key(name);
            if name.trim().is_empty() || name.len() > NAME_BYTES_MAX || !has_room {
                self.refused += 1;
                continue;
            }
            let state = status.state();
            let seen = self.statuses.entry(name.into()).or_insert_with(|| Status {
                rhythm: Rhythm::default(),
                last: state,
                worst: state,
                writers: BTreeSet::new(),
            });
            seen.rhythm.beat(at);
            (seen.last, seen.worst) = (state, seen.worst.max(state));
            if seen.writers.len() < WRITERS_MAX {
                seen.writers.insert(array.writer());
            }
        }
    }

    fn measure(&mut self, sample: &Sample, at: Timestamp) {
        let topic = &sample.source.topic;
        if self.topics.len() >= 2 * TOPICS_MAX && !self.topics.contains_key(topic) {
            return;
        }
        let messages = self.topics.entry(topic.clone()).or_default();
        if values::field(&sample.source.type_name).is_some() {
            messages.value = sample.values.get(1).filter(|value| **value != FieldValue::Absent).cloned();
        }
        // What was kept for those who come late has a value and no time.
        if sample.late {
            return;
        }
        messages.rhythm.beat(at);
        let content = match sample.values[..] {
            [FieldValue::Content(content), ..] => Some(content),
            _ => None,
        };
        messages.take_frames(sample.values.get(1..).unwrap_or_default(), at);
        if content.is_none() || content == messages.content {
            messages.repeated += 1;
        }
        messages.content = content;
        if let Some(stamp_ns) = sample.stamp_ns {
            let age = sample.received_wall_ns.saturating_sub(stamp_ns);
            let (least, most) = messages.age_ns.unwrap_or((age, age));
            messages.age_ns = Some((least.min(age), most.max(age)));
        }
    }

    /// The topics whose messages can be measured, with their types.
    pub fn measurable(&self) -> impl Iterator<Item = (&str, &str)> {
        self.discovery.topics.iter().filter_map(|topic| Some((&*topic.name, measured_type(topic)?)))
    }

    /// Topics of diagnostics beside `/diagnostics`, as robots with a namespace have them.
    pub fn more_diagnostics(&self) -> Vec<String> {
        let is_one = |topic: &&TopicSeen| {
            let published = topic.publishers.iter().any(|it| !it.ours && it.type_name == DIAGNOSTIC_ARRAY);
            published && is_full_name(&topic.name) && topic.name.ends_with("/diagnostics")
        };
        let names = self.discovery.topics.iter().filter(is_one).map(|topic| topic.name.clone());
        names.filter(|name| name != DIAGNOSTICS).take(30).collect()
    }

    /// Whether anybody else was found in the domain.
    pub fn is_empty(&self) -> bool {
        self.discovery.participants == 0 && self.statuses.is_empty() && self.topics.is_empty()
    }
}

/// A name that can stand in a comment as it is.
fn is_frame(name: &str) -> bool {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"_-./".contains(&byte);
    (1..=NAME_BYTES_MAX).contains(&name.len()) && !name.starts_with('/') && name.bytes().all(is_plain)
}

/// Whether a topic connects components, rather than to serve ROS itself. The status of an action does.
pub fn is_of_components(topic: &TopicSeen) -> bool {
    let name = &*topic.name;
    let shown = values::action(name).unwrap_or(name);
    let is_hidden = shown.split('/').any(|part| part.starts_with('_')) || name.starts_with("/telltale/");
    is_full_name(name) && !is_hidden && !INFRASTRUCTURE.contains(&name)
}

/// The type of a topic, if its messages can be measured: one type that is one of ROS.
pub fn measured_type(topic: &TopicSeen) -> Option<&str> {
    let publishers = || topic.publishers.iter().filter(|it| !it.ours);
    let first = &*publishers().next()?.type_name;
    let only = publishers().all(|it| it.type_name == first);
    let aggregated = first.starts_with("diagnostic_msgs/msg/Diagnostic");
    let by_tools = publishers().all(|it| it.node.as_deref().is_some_and(is_tool));
    (only && is_type(first) && !aggregated && !by_tools && is_of_components(topic)).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::init::{draft, text};
    use telltale_engine::discovery::Endpoint;
    use telltale_engine::model::monitors::TopicSpec;

    #[test]
    fn transforms_that_come_steadily_are_proposed_with_their_rate() {
        let (node, type_name) = (Some("/ekf".to_owned()), TF_MESSAGE.to_owned());
        let publisher = Endpoint { participant: "p".to_owned(), node, type_name, ..Endpoint::default() };
        let (name, publishers) = ("/tf".to_owned(), vec![publisher]);
        let topics =
            vec![TopicSeen { name, publishers, subscribers: Vec::new(), rate_hz: None, jitter_ms: None }];
        let nodes = ["/ekf".to_owned()].into_iter().collect();
        let mut seen = Observations::default();
        seen.see(Arc::new(Discovery { topics, nodes, participants: 1, ..Discovery::default() }));
        let whole = FieldSpec::new("", FieldKind::Content);
        let source = Arc::new(TopicSpec {
            topic: "/tf".into(),
            type_name: TF_MESSAGE.into(),
            stamp: false,
            fields: std::iter::once(whole).chain(more_fields(TF_MESSAGE)).collect(),
        });
        for tenth in 0..100 {
            let other = format!("other{tenth}");
            let frames = [
                ("map", "odom"),
                ("odom", "base_link"),
                (if tenth % 2 == 0 { "odom" } else { "base_link" }, "laser"),
                ("map", "new\nline"),
                ("map", &other),
            ];
            let names = frames.into_iter().flat_map(|(parent, child)| [parent, child]);
            let names = names.map(|name| FieldValue::Text(name.into()));
            let content = FieldValue::Content(Fingerprint(tenth));
            let mut values: Vec<FieldValue> = std::iter::once(content).chain(names).collect();
            values.resize(source.fields.len(), FieldValue::Unreadable("there is none".into()));
            let (source, values) = (source.clone(), values.into());
            let sample = Sample::of(source, values);
            seen.take(&Input::Sample(sample), Timestamp::from_millis(100 * tenth));
        }
        assert_eq!(seen.topics["/tf"].frames.len(), FRAMES_MAX);
        let text = text(&draft(&seen, Timestamp::ZERO, Timestamp::from_millis(10_000)), false);
        let odom = "# - { id: tf_odom, monitor: { tf: { frames: [map, odom], warning_above: 300ms, error_above: 600ms } } }  # 10.0 Hz";
        assert!(text.contains(odom) && text.contains("frames: [odom, base_link]"), "{text}");
        assert!(text.contains("the frame laser has two parents"), "{text}");
        assert!(!text.contains("line]") && !text.contains("other1"), "{text}");
    }
}
