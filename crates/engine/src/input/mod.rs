//! All inputs of the engine, as one closed type. The DDS bridge, the operator's page, simulation,
//! scenarios, recordings and tests feed it.

use serde::{Deserialize, Serialize};
mod recorded;

use super::model::output::Output;
use std::ops::Range;
use std::sync::Arc;

pub use super::action::{AlarmRef, OperatorAction, Place, Refusal, Response};
pub use super::discovery::{NodeOf, WriterId, WriterList};
use super::model::sample::{Probe, PublisherReport, Sample};
use super::state::State;
use super::text::Text;
use super::time::Span;

/// One input of the engine. Only [`Engine::handle`](super::Engine::handle) takes inputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Input {
    /// One `diagnostic_msgs/DiagnosticArray`.
    Diagnostics(StatusArray),
    /// The known writers of diagnostics with their nodes; sent at each change.
    Writers(Arc<WriterList>),
    /// A sample of a configured signal.
    Signal { name: Box<str>, value: bool },
    /// A message of a topic that a monitor watches.
    Sample(Sample),
    /// The publishers of a topic that a monitor watches; sent at the start and at each change.
    Topic(PublisherReport),
    /// The result of a watchdog's probe.
    Probe(Probe),
    /// A fault of the reception itself.
    Reception(ReceptionTrouble),
    /// Whether an output to the vehicle could be sent; sent at each change.
    Output(OutputReport),
    /// Whether an output to the vehicle has a reader; sent at each change. Until the first one, a reader is
    /// assumed.
    Listened(ListenerReport),
    /// Whether another program publishes the same aggregated diagnosis; sent at each change.
    Aggregator {
        /// The topic and the other program; `None`: there is none.
        other: Option<Box<str>>,
    },
    /// Whether another program tells the vehicle what Telltale tells it; sent at each change.
    Voices {
        /// The topics, each with the other program; `None`: there is none.
        other: Option<Box<str>>,
    },
    /// Whether several nodes have one name; sent at the start of the search and at each change.
    Nodes {
        /// The names, for a developer; `None`: each name is that of one node.
        repeated: Option<Box<str>>,
    },
    /// Whether the disk can store records; sent at each change.
    Storage {
        /// The fault, for a developer; `None`: there is none.
        fault: Option<Box<str>>,
    },
    /// Whether the DDS process runs. Without it nothing of the vehicle is received. Sent at each change, and at
    /// each further failure.
    Dds {
        /// The fault, for a developer; `None`: there is none.
        fault: Option<Box<str>>,
    },
    /// A problem around the program that stops nothing but needs repair; sent at each change.
    Upkeep(Upkeep),
    /// Whether the operator's display shows the present state; sent at each change.
    Display {
        /// The operator whose display is late; `None`: no display is late.
        late: Option<Box<str>>,
    },
    /// An action of the operator.
    Operator(OperatorAction),
    /// Only time has passed.
    Tick,
}

impl Input {
    /// About the bytes of its texts and lists.
    pub fn text_bytes(&self) -> usize {
        match self {
            Input::Diagnostics(array) => array.text.len() + array.statuses.len() * size_of::<StatusSpans>(),
            Input::Writers(list) => list.writers.len() * 96,
            Input::Sample(sample) => sample.value_bytes(),
            Input::Reception(trouble) => trouble.topic.len() + trouble.text.len(),
            Input::Tick => 0,
            _ => 64,
        }
    }
}

/// Problems of the wall clock, of the page's certificate, of the recording and of the line to the fleet; `None`: there is
/// none.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Upkeep {
    pub clock: Option<Text>,
    pub certificate: Option<Text>,
    pub recording: Option<Text>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fleet: Option<FleetFault>,
}

/// Why the fleet does not hear of this vehicle.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FleetFault {
    pub text: Text,
    /// It does not end by itself: an ERROR. Otherwise a WARNING.
    pub is_error: bool,
}

/// A fault of the reception, counted for its topic and shown to developers.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReceptionTrouble {
    /// The ROS name: `/diagnostics`.
    pub topic: Box<str>,
    pub kind: TroubleKind,
    /// The number of messages that this one input covers.
    pub count: u64,
    /// The fault, for a developer.
    pub text: Box<str>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TroubleKind {
    /// The bytes do not follow the type.
    Malformed,
    /// A publisher offers the topic with another type.
    WrongType,
    /// Sequence numbers are missing.
    Lost,
}

/// Whether an output to the vehicle could be sent.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct OutputReport {
    pub output: Output,
    /// The ROS name: `/telltale/clearance`.
    pub topic: Box<str>,
    /// The reason of the failure, for a developer; `None`: sending works again.
    pub error: Option<Box<str>>,
}

/// Whether an output to the vehicle has a reader.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ListenerReport {
    pub output: Output,
    /// The ROS name: `/telltale/maneuver_stop_request`.
    pub topic: Box<str>,
    pub heard: bool,
}

/// The statuses of one `diagnostic_msgs/DiagnosticArray`. One buffer holds all text, so an array of a thousand
/// statuses costs three allocations.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(from = "recorded::StatusArray", into = "recorded::StatusArray")]
pub struct StatusArray {
    text: String,
    statuses: Vec<StatusSpans>,
    values: Vec<(Range<u32>, Range<u32>)>,
    writer: WriterId,
    late: Span,
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct StatusSpans {
    level: u8,
    name: Range<u32>,
    message: Range<u32>,
    hardware_id: Range<u32>,
    values: Range<u32>,
}

impl StatusArray {
    pub fn with_capacity(statuses: usize, text_bytes: usize) -> StatusArray {
        StatusArray {
            text: String::with_capacity(text_bytes),
            statuses: Vec::with_capacity(statuses),
            values: Vec::new(),
            writer: WriterId::default(),
            late: Span::ZERO,
        }
    }

    /// The same array with its writer.
    pub fn said_by(self, writer: WriterId) -> StatusArray {
        StatusArray { writer, ..self }
    }

    pub fn writer(&self) -> WriterId {
        self.writer
    }

    /// The same array, received so much later than usual. It counts from when it should have come.
    pub fn received_late(self, late: Span) -> StatusArray {
        StatusArray { late, ..self }
    }

    pub fn late(&self) -> Span {
        self.late
    }

    /// Appends a status; the values pushed next belong to it.
    pub fn push_status(&mut self, level: u8, name: &str, message: &str, hardware_id: &str) {
        let name = self.append(name);
        let message = self.append(message);
        let hardware_id = self.append(hardware_id);
        let first = self.values.len() as u32;
        self.statuses.push(StatusSpans { level, name, message, hardware_id, values: first..first });
    }

    /// Appends a key and its value to the last status. Without a status it does nothing.
    pub fn push_value(&mut self, key: &str, value: &str) {
        if self.statuses.is_empty() {
            return;
        }
        let pair = (self.append(key), self.append(value));
        self.values.push(pair);
        if let Some(status) = self.statuses.last_mut() {
            status.values.end += 1;
        }
    }

    /// [`push_status`](Self::push_status) for received bytes: invalid UTF-8 and NUL become U+FFFD.
    pub fn push_status_lossy(&mut self, level: u8, name: &[u8], message: &[u8], hardware_id: &[u8]) {
        let name = self.append_lossy(name);
        let message = self.append_lossy(message);
        let hardware_id = self.append_lossy(hardware_id);
        let first = self.values.len() as u32;
        self.statuses.push(StatusSpans { level, name, message, hardware_id, values: first..first });
    }

    /// [`push_value`](Self::push_value) for received bytes.
    pub fn push_value_lossy(&mut self, key: &[u8], value: &[u8]) {
        if self.statuses.is_empty() {
            return;
        }
        let pair = (self.append_lossy(key), self.append_lossy(value));
        self.values.push(pair);
        if let Some(status) = self.statuses.last_mut() {
            status.values.end += 1;
        }
    }

    /// The same statuses, with `prefix` in front of each name.
    pub fn prefixed(&self, prefix: &str) -> StatusArray {
        let text_bytes = self.text.len() + prefix.len() * self.len();
        let mut out = StatusArray::with_capacity(self.len(), text_bytes);
        for status in self.iter() {
            let name = [prefix, status.name()].concat();
            out.push_status(status.level(), &name, status.message(), status.hardware_id());
            status.values().for_each(|(key, value)| out.push_value(key, value));
        }
        out.said_by(self.writer).received_late(self.late)
    }

    /// Keeps the first `count` statuses.
    pub fn truncate(&mut self, count: usize) {
        if let Some(first) = self.statuses.get(count) {
            self.text.truncate(first.name.start as usize);
            self.values.truncate(first.values.start as usize);
            self.statuses.truncate(count);
        }
    }

    pub fn len(&self) -> usize {
        self.statuses.len()
    }

    pub fn is_empty(&self) -> bool {
        self.statuses.is_empty()
    }

    pub fn get(&self, index: usize) -> Status<'_> {
        Status { array: self, spans: &self.statuses[index] }
    }

    pub fn iter(&self) -> impl ExactSizeIterator<Item = Status<'_>> {
        self.statuses.iter().map(move |spans| Status { array: self, spans })
    }

    fn append(&mut self, text: &str) -> Range<u32> {
        let start = self.text.len() as u32;
        self.text.push_str(text);
        start..self.text.len() as u32
    }

    fn append_lossy(&mut self, bytes: &[u8]) -> Range<u32> {
        match str::from_utf8(bytes) {
            Ok(text) if !bytes.contains(&0) => self.append(text),
            _ => self.append(&String::from_utf8_lossy(bytes).replace('\0', "\u{fffd}")),
        }
    }

    fn text(&self, range: &Range<u32>) -> &str {
        &self.text[range.start as usize..range.end as usize]
    }
}

/// One `diagnostic_msgs/DiagnosticStatus`, borrowed from its array.
#[derive(Debug, Clone, Copy)]
pub struct Status<'a> {
    array: &'a StatusArray,
    spans: &'a StatusSpans,
}

impl<'a> Status<'a> {
    /// The level byte as it was received.
    pub fn level(self) -> u8 {
        self.spans.level
    }

    pub fn state(self) -> State {
        State::from_level(self.spans.level)
    }

    pub fn name(self) -> &'a str {
        self.array.text(&self.spans.name)
    }

    pub fn message(self) -> &'a str {
        self.array.text(&self.spans.message)
    }

    pub fn hardware_id(self) -> &'a str {
        self.array.text(&self.spans.hardware_id)
    }

    pub fn values(self) -> impl ExactSizeIterator<Item = (&'a str, &'a str)> {
        let array = self.array;
        array.values[self.spans.values.start as usize..self.spans.values.end as usize]
            .iter()
            .map(move |(key, value)| (array.text(key), array.text(value)))
    }
}
