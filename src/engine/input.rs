//! All inputs of the engine, as one closed type. The DDS bridge, the operator's page, simulation,
//! scenarios, recordings and tests feed it.

use super::model::output::Output;
use std::ops::Range;
use std::sync::Arc;

pub use super::action::{AlarmRef, OperatorAction, Place, Refusal, Response};
pub use super::discovery::{NodeOf, WriterId, WriterList};
use super::model::sample::{Probe, Sample, TopicNews};
use super::state::State;
use super::text::Text;

/// One thing that happened. Handled by [`Engine::handle`](super::Engine::handle), nowhere else.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// One `diagnostic_msgs/DiagnosticArray`.
    Diagnostics(StatusArray),
    /// Which writers of diagnostics there are, and whose. Said whenever that changes.
    Writers(Arc<WriterList>),
    /// A sample of a signal that the configuration names.
    Signal { name: Box<str>, value: bool },
    /// A message of a topic that monitors watch.
    Sample(Sample),
    /// Who publishes a topic that monitors watch; said at the start and whenever it changes.
    Topic(TopicNews),
    /// A watchdog's probe came to its end.
    Probe(Probe),
    /// Something about the reception itself went wrong.
    Reception(ReceptionTrouble),
    /// Something for the vehicle could, or could not, be sent. Said when that changes.
    Output(OutputNews),
    /// Somebody listens, or nobody, to what is published for the vehicle. Said when that changes;
    /// until then it is taken for heard.
    Listened(ListenNews),
    /// Another program publishes, or does not publish, the aggregated diagnosis that this one would.
    /// Said when that changes.
    Aggregator {
        /// Where and who; `None`: nobody.
        other: Option<Box<str>>,
    },
    /// What must be kept can, or cannot, be written down. Said when that changes.
    Storage {
        /// What is wrong, for a developer; `None`: nothing.
        fault: Option<Box<str>>,
    },
    /// The part that speaks DDS is up, or down: nothing of the vehicle can be heard then. Said when that
    /// changes, and each time it goes down.
    Dds {
        /// What is wrong, for a developer; `None`: nothing.
        fault: Option<Box<str>>,
    },
    /// What has to be put right around the program, and stops nothing. Said when that changes.
    Upkeep(Upkeep),
    /// The operator's display shows, or does not show, what is. Said when that changes.
    Display {
        /// Whose display it is; `None`: nothing is wrong.
        late: Option<Box<str>>,
    },
    /// An operator did something on the page.
    Operator(OperatorAction),
    /// Nothing but time passed.
    Tick,
}

/// What is wrong with the wall clock and with the certificate of the page; `None`: nothing.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Upkeep {
    pub clock: Option<Text>,
    pub certificate: Option<Text>,
}

/// A fault of the reception: counted for its topic and shown to the developer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReceptionTrouble {
    /// As ROS names it: `/diagnostics`.
    pub topic: Box<str>,
    pub kind: TroubleKind,
    /// How many messages this one input stands for.
    pub count: u64,
    /// What was wrong, for a developer.
    pub text: Box<str>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum TroubleKind {
    /// The bytes are not what the type says.
    Malformed,
    /// A publisher offers the topic with another type.
    WrongType,
    /// Sequence numbers are missing.
    Lost,
}

/// Whether something that is published for the vehicle could be sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputNews {
    pub output: Output,
    /// As ROS names it: `/telltale/clearance`.
    pub topic: Box<str>,
    /// Why it could not be sent, for a developer; `None`: it can be sent again.
    pub error: Option<Box<str>>,
}

/// Whether anybody listens to something that is published for the vehicle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ListenNews {
    pub output: Output,
    /// As ROS names it: `/telltale/maneuver_stop_request`.
    pub topic: Box<str>,
    pub heard: bool,
}

/// The statuses of one `diagnostic_msgs/DiagnosticArray`. All text lies in one buffer, so an
/// array of a thousand statuses costs three allocations.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct StatusArray {
    text: String,
    statuses: Vec<StatusSpans>,
    values: Vec<(Range<u32>, Range<u32>)>,
    writer: WriterId,
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
        }
    }

    /// The same, as this writer said it.
    pub fn said_by(self, writer: WriterId) -> StatusArray {
        StatusArray { writer, ..self }
    }

    pub fn writer(&self) -> WriterId {
        self.writer
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

    /// [`push_status`](Self::push_status) of text from outside: what is no UTF-8, and a NUL, becomes U+FFFD.
    pub fn push_status_lossy(&mut self, level: u8, name: &[u8], message: &[u8], hardware_id: &[u8]) {
        let name = self.append_lossy(name);
        let message = self.append_lossy(message);
        let hardware_id = self.append_lossy(hardware_id);
        let first = self.values.len() as u32;
        self.statuses.push(StatusSpans { level, name, message, hardware_id, values: first..first });
    }

    /// [`push_value`](Self::push_value) of text from outside.
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
        out.said_by(self.writer)
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
