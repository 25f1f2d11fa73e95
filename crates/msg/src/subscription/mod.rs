//! The topics to read: `/diagnostics`, and the topics of the model's signals and monitors, each once.

mod untyped;

use std::collections::BTreeSet;
use std::sync::Arc;

use super::cdr::{Endian, Fault};
use super::fields::{BooleanReader, Definitions, EventReader, FieldError, FieldsError, NoValue, Reader};
use super::messages::{self, DIAGNOSTIC_ARRAY};
use super::ros_clock::{self, RosClock};
use super::sample_bytes::{Guid, RawBody};
use telltale_engine::input::{Input, StatusArray, WriterId};
use telltale_engine::model::monitors::{
    FieldKind, FieldSpec, RecordedTopic, StampClock, TopicSpec, WatchdogSpec, Watched,
};
use telltale_engine::model::sample::{FieldValue, Sample};
use telltale_engine::model::{FieldSource, Limits, Model, SignalSpec, same_topic};
use telltale_engine::time::Span;
pub use untyped::Learned;
use untyped::Untyped;

/// A topic with more bytes a second is large.
pub const LARGE_BYTES_PER_S: u64 = 1_000_000;

#[derive(Debug, thiserror::Error)]
pub enum SubscriptionError {
    #[error(
        "signal {signal}: `{field}` of {type_name} cannot be read as true or false: {why}. Use `present_for` if each \
         message is an event"
    )]
    NoBool { signal: Box<str>, type_name: Box<str>, field: Box<str>, why: FieldError },
    #[error("topic {topic}: {type_name:?} is no type: write it as package/msg/Name")]
    NoType { topic: Box<str>, type_name: Box<str> },
    #[error("topic {topic} is used with two types: {first} and {second}")]
    TwoTypes { topic: Box<str>, first: Box<str>, second: Box<str> },
    #[error("topic {topic} cannot be read: {why}")]
    Fields { topic: Box<str>, why: FieldsError },
}

/// Everything that a model needs to read.
#[derive(Debug, Default)]
pub struct Plan {
    pub subscriptions: Vec<Arc<Subscription>>,
    pub watchdogs: Vec<Arc<WatchdogSpec>>,
    /// Whole names of the nodes that the configuration names.
    pub nodes: Arc<BTreeSet<Box<str>>>,
    /// What is to be recorded beside them.
    pub watched: Watched,
    pub limits: Limits,
    pub definitions: Definitions,
}

/// One topic and the use of its messages.
#[derive(Debug, Clone)]
pub struct Subscription {
    /// By its ROS name: `/diagnostics`.
    pub topic: Arc<str>,
    pub type_name: Arc<str>,
    pub dds_topic: String,
    pub dds_type: String,
    /// The prefix of the names of its statuses, if it has one.
    diagnostics: Option<Box<str>>,
    /// This topic is `/clock`, the time of a simulation.
    pub is_clock: bool,
    /// The clock of its stamps.
    pub stamps: StampClock,
    signals: Vec<Signal>,
    watch: Option<WatchedFields>,
    /// The wanted fields, if the type must be learned; nothing is read until then.
    untyped: Option<Arc<Untyped>>,
    /// Its messages are recorded and mean nothing: the least time between two of them.
    recorded_every: Option<Span>,
    /// What a recording keeps of its messages.
    keeping: Keeping,
    /// Its messages may be of megabytes.
    may_be_large: bool,
    limits: Limits,
}

/// What a recording keeps of the messages of a topic that means something. Of the others it has their times and sizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Keeping {
    #[default]
    Whole,
    /// None.
    Never,
    /// One in this time.
    Every(Span),
    /// All, unless the topic is large: nothing reads their content.
    UnlessLarge,
}

#[derive(Debug, Clone)]
struct Signal {
    name: Box<str>,
    timeout: Option<Span>,
    meaning: Meaning,
}

/// The meaning of a message for a signal.
#[derive(Debug, Clone)]
enum Meaning {
    Level(BooleanReader),
    /// Each message that follows its type means true; if the type is unknown, each message does.
    Event(Option<EventReader>),
}

/// The fields that monitors watch.
#[derive(Debug, Clone)]
struct WatchedFields {
    spec: Arc<TopicSpec>,
    reader: Reader,
}

/// The time of publication, relative to our reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PublicationTime {
    Now,
    /// After our reader was made, and before we knew its publisher: its value is used, but it is neither
    /// counted nor timed.
    Late,
    /// Before our start, by a publisher that keeps it for late readers.
    Kept,
    /// Before our start, by another publisher: it shows that there is a publisher, and nothing current.
    Past,
}

/// A received message.
#[derive(Debug, Clone, Copy)]
pub struct Received<'a> {
    pub body: &'a RawBody,
    pub writer: Guid,
    /// By this machine's wall clock, since 1970.
    pub wall_ns: i64,
    pub when: PublicationTime,
}

impl Plan {
    /// The topics of diagnostics come first.
    ///
    /// # Errors
    /// A signal or a field that no message of its type can provide.
    pub fn of(model: &Model, definitions: &Definitions) -> Result<Plan, SubscriptionError> {
        let mut all = Vec::new();
        let stamps = model.watched.stamps;
        for (topic, prefix) in model.watched.diagnostics_topics() {
            subscribe(&mut all, topic, DIAGNOSTIC_ARRAY, &model.limits)?.diagnostics = Some(prefix.into());
        }
        if stamps == StampClock::Ros {
            subscribe(&mut all, ros_clock::TOPIC, ros_clock::TYPE, &model.limits)?.is_clock = true;
        }
        // The inputs of a condition are watched.
        let fields = model.signals.iter().filter_map(|spec| Some((spec, spec.source.field()?)));
        for (spec, source) in fields.filter(|(_, source)| !source.type_name.is_empty()) {
            let meaning = meaning(spec, source, definitions)?;
            subscribe(&mut all, &source.topic, &source.type_name, &model.limits)?.signals.push(Signal {
                name: spec.name.clone(),
                timeout: spec.timeout,
                meaning,
            });
        }
        for spec in model.watched.topics.iter().filter(|spec| !spec.type_name.is_empty()) {
            let subscription = subscribe(&mut all, &spec.topic, &spec.type_name, &model.limits)?;
            let reader = definitions
                .check(spec)
                .map_err(|why| SubscriptionError::Fields { topic: spec.topic.clone(), why })?;
            subscription.watch = Some(WatchedFields { spec: spec.clone(), reader });
        }
        all.extend(untyped::subscriptions(model, definitions));
        let keeping = |one: &Subscription| {
            let is_needed = one.diagnostics.is_some() || one.is_clock;
            match model.watched.recorded(&one.topic) {
                _ if is_needed => Keeping::Whole,
                Some(recorded) if recorded.every == RecordedTopic::NEVER => Keeping::Never,
                Some(recorded) if recorded.every > Span::ZERO => Keeping::Every(recorded.every),
                None if model.counted_topics().any(|topic| same_topic(topic, &one.topic)) => {
                    Keeping::UnlessLarge
                }
                _ => Keeping::Whole,
            }
        };
        let subscriptions = all
            .into_iter()
            .map(|one| {
                let may_be_large = definitions.may_be_large(&one.type_name);
                Arc::new(Subscription { stamps, keeping: keeping(&one), may_be_large, ..one })
            })
            .collect();
        let (watched, limits) = (model.watched.clone(), model.limits.clone());
        let definitions = definitions.clone();
        let nodes = model.named_nodes().map(|name| format!("/{}", name.trim_start_matches('/')).into());
        let (nodes, watchdogs) = (Arc::new(nodes.collect()), watched.watchdogs.clone());
        Ok(Plan { subscriptions, watchdogs, nodes, watched, limits, definitions })
    }

    /// Whether topics are read for recordings alone.
    pub fn records_more(&self) -> bool {
        !self.watched.recorded.is_empty()
    }

    /// The subscription that only records this topic, if the configuration wants that and nothing else reads it.
    /// `type_name` is `package/msg/Name`.
    pub fn recorded(&self, topic: &str, type_name: &str) -> Option<Subscription> {
        let recorded = self.watched.recorded(topic).filter(|it| it.every != RecordedTopic::NEVER)?;
        if self.subscriptions.iter().any(|known| *known.topic == *topic) {
            return None;
        }
        let mut all = Vec::with_capacity(1);
        let one = subscribe(&mut all, topic, type_name, &self.limits).ok()?;
        one.recorded_every = Some(recorded.every);
        one.may_be_large = self.definitions.may_be_large(type_name);
        all.pop()
    }
}

/// The subscription of a topic, which is made if there is none yet.
fn subscribe<'a>(
    all: &'a mut Vec<Subscription>,
    topic: &str,
    type_name: &str,
    limits: &Limits,
) -> Result<&'a mut Subscription, SubscriptionError> {
    let topic = format!("/{}", topic.trim_start_matches('/'));
    let at = match all.iter().position(|known| *known.topic == *topic) {
        Some(at) if *all[at].type_name != *type_name => {
            return Err(SubscriptionError::TwoTypes {
                topic: topic.into(),
                first: (*all[at].type_name).into(),
                second: type_name.into(),
            });
        }
        Some(at) => at,
        None => {
            let dds_type = messages::dds_type_name(type_name).ok_or_else(|| SubscriptionError::NoType {
                topic: topic.as_str().into(),
                type_name: type_name.into(),
            })?;
            all.push(Subscription {
                dds_topic: format!("rt{topic}"),
                topic: topic.into(),
                type_name: type_name.into(),
                dds_type,
                diagnostics: None,
                is_clock: false,
                stamps: StampClock::default(),
                signals: Vec::new(),
                watch: None,
                untyped: None,
                recorded_every: None,
                keeping: Keeping::Whole,
                may_be_large: true,
                limits: limits.clone(),
            });
            all.len() - 1
        }
    };
    Ok(&mut all[at])
}

/// A boolean field is a level; without one, a message can be an event.
fn meaning(
    spec: &SignalSpec,
    source: &FieldSource,
    definitions: &Definitions,
) -> Result<Meaning, SubscriptionError> {
    match definitions.boolean(&source.type_name, &source.field) {
        Ok(reader) => Ok(Meaning::Level(reader)),
        Err(_) if spec.present_for.is_some() => Ok(Meaning::Event(definitions.event(&source.type_name))),
        Err(why) => Err(SubscriptionError::NoBool {
            signal: spec.name.clone(),
            type_name: source.type_name.clone(),
            field: source.field.clone(),
            why,
        }),
    }
}

impl Subscription {
    /// Whether the last message from before our start counts. The level of a signal and a watched value count;
    /// an event and a message that is only counted do not. If the age of messages is watched, an old one would
    /// be judged as late.
    pub fn wants_last_value(&self) -> bool {
        self.recorded_every.is_some()
            || self.signals.iter().any(|signal| matches!(signal.meaning, Meaning::Level(_)))
            || self.watch.as_ref().is_some_and(WatchedFields::wants_last_value)
    }

    /// The least time between two messages that are recorded, if they serve nothing else.
    pub fn recorded_every(&self) -> Option<Span> {
        self.recorded_every
    }

    /// Whether its messages may be of megabytes, as images and point clouds are.
    pub fn may_be_large(&self) -> bool {
        self.may_be_large
    }

    /// What a recording keeps of its messages.
    pub fn keeping(&self) -> Keeping {
        self.keeping
    }

    /// The fields that monitors watch of this topic.
    pub fn watched(&self) -> Option<&Arc<TopicSpec>> {
        let untyped = || self.untyped.as_ref().and_then(|untyped| untyped.watch.as_ref());
        self.watch.as_ref().map(|watch| &watch.spec).or_else(untyped)
    }

    /// The inputs that a message of this topic means, and its faults.
    pub fn decode(&self, received: Received<'_>) -> (Vec<Input>, Option<NoValue>) {
        let mut inputs = Vec::with_capacity(1);
        if received.when == PublicationTime::Past {
            inputs.extend(self.watch.as_ref().map(|watch| Input::Sample(watch.past(received.wall_ns))));
            return (inputs, None);
        }
        let mut wrong = received.body.as_ref().err().cloned().map(NoValue::Fault);
        let readable = received.body.as_ref().ok().map(|(body, endian)| (&**body, *endian));
        if let Some((body, endian)) = readable {
            let history = received.when == PublicationTime::Kept;
            self.decode_readable((body, endian, received.writer), history, &mut inputs, &mut wrong);
        }
        if let Some(watch) = &self.watch {
            let sample = match received.when {
                PublicationTime::Kept if !watch.wants_last_value() => watch.past(received.wall_ns),
                _ => watch.sample(received, &mut wrong),
            };
            inputs.push(Input::Sample(sample));
        }
        (inputs, wrong)
    }

    /// The same, with the times of the clock that the configuration asks for. `received` has the system's.
    pub fn decode_by(&self, received: Received<'_>, clock: &RosClock) -> (Vec<Input>, Option<NoValue>) {
        if self.stamps == StampClock::System {
            return self.decode(received);
        }
        let mut of_clock = None;
        if let (true, Ok((body, endian))) = (self.is_clock, received.body) {
            of_clock = clock.take(body, *endian).err();
        }
        let (mut inputs, wrong) = self.decode(Received { wall_ns: clock.now_ns(), ..received });
        for input in &mut inputs {
            if let Input::Sample(sample) = input {
                sample.received_wall_ns = clock.at_stamp(sample.stamp_ns);
            }
        }
        (inputs, wrong.or(of_clock.map(NoValue::Fault)))
    }

    /// Whether an input is the value of a signal that was unknown again, by its timeout, when it came this late.
    pub fn is_over(&self, input: &Input, late: Span) -> bool {
        let Input::Signal { name, .. } = input else { return false };
        let mut levels = self.signals.iter().filter(|it| matches!(it.meaning, Meaning::Level(_)));
        levels.any(|it| it.name == *name && it.timeout.is_some_and(|timeout| late >= timeout))
    }

    fn decode_readable(
        &self,
        (body, endian, writer): (&[u8], Endian, Guid),
        history: bool,
        inputs: &mut Vec<Input>,
        wrong: &mut Option<NoValue>,
    ) {
        if let Some(prefix) = self.diagnostics.as_ref().filter(|_| !history) {
            let (array, fault) = statuses(body, endian, (prefix, writer), &self.limits);
            // A complete empty array is a message too; a message with a fault before the first status is
            // not.
            if !array.is_empty() || fault.is_none() {
                inputs.push(Input::Diagnostics(array));
            }
            *wrong = fault.map(NoValue::Fault);
        }
        for signal in &self.signals {
            let value = match &signal.meaning {
                Meaning::Level(reader) => reader.read(body, endian),
                Meaning::Event(_) if history => continue,
                Meaning::Event(Some(reader)) => reader.check(body, endian).map(|()| true),
                Meaning::Event(None) => Ok(true),
            };
            match value {
                Ok(value) => inputs.push(Input::Signal { name: signal.name.clone(), value }),
                Err(NoValue::Absent) => {}
                Err(why) => *wrong = Some(why),
            }
        }
    }
}

/// The statuses of a message of a topic with this prefix, by this writer; and the fault, if it is not whole.
fn statuses(
    body: &[u8],
    endian: Endian,
    (prefix, writer): (&str, Guid),
    limits: &Limits,
) -> (StatusArray, Option<Fault>) {
    let (array, fault) = messages::diagnostic_array(body, endian, limits);
    let array = if prefix.is_empty() { array } else { array.prefixed(prefix) };
    (array.said_by(WriterId(writer)), fault)
}

/// The statuses of a recorded message, as they were taken under a model when it was received.
pub fn recorded_statuses(
    model: &Model,
    topic: &str,
    body: &[u8],
    endian: Endian,
    writer: Guid,
) -> StatusArray {
    let named = model.watched.diagnostics_topics().find(|(it, _)| same_topic(it, topic));
    let prefix = named.map_or("", |(_, prefix)| prefix);
    statuses(body, endian, (prefix, writer), &model.limits).0
}

impl WatchedFields {
    fn wants_last_value(&self) -> bool {
        let is_static = |field: &FieldSpec| field.kind == FieldKind::Transforms;
        !self.spec.fields.is_empty() && !self.spec.stamp || self.spec.fields.iter().any(is_static)
    }

    fn sample(&self, received: Received<'_>, wrong: &mut Option<NoValue>) -> Sample {
        let reading = match received.body {
            Ok((body, endian)) => self.reader.read(body, *endian),
            Err(fault) => self.reader.unreadable(fault),
        };
        if let Some(fault) = reading.fault {
            *wrong = Some(NoValue::Fault(fault));
        }
        Sample {
            stamp_ns: reading.stamp_ns,
            received_wall_ns: received.wall_ns,
            late: received.when != PublicationTime::Now,
            ..Sample::of(self.spec.clone(), reading.values)
        }
    }

    /// The sample of a message that only shows that it came.
    fn past(&self, received_wall_ns: i64) -> Sample {
        let values = vec![FieldValue::Absent; self.spec.fields.len()].into();
        Sample { received_wall_ns, late: true, ..Sample::of(self.spec.clone(), values) }
    }
}

#[cfg(test)]
mod tests;
