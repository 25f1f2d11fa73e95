//! From the entries of a recording to what the engine takes.

use std::collections::{BTreeSet, HashMap, VecDeque};
use std::sync::Arc;

use bytes::Bytes;

use super::bag::{Bag, Place};
use super::bridge::Bridge;
use super::flows::Flows;
use super::recording::{Facts, Recording};
use super::times::Times;
use super::unheard::Unheard;
use telltale_engine::input::Input;
use telltale_engine::keyframe::Keyframe;
use telltale_engine::model::Model;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::messages::DIAGNOSTIC_ARRAY;
use telltale_msg::sample_bytes::RawBody;
use telltale_msg::subscription::{PublicationTime, Received, recorded_statuses};
use telltale_record::file::{Channel, Entry, JOURNAL, KEYFRAMES, Missing};
use telltale_record::journal::{Line, MessageRef, Took};
use telltale_record::ring::ConfigurationText;

/// Topics whose last message is at hand for the journal.
const TOPICS_MAX: usize = 4096;

/// Messages that mean nothing to the configuration let time pass.
const TICK: Span = Span::from_millis(100);

/// The next input of the engine.
#[derive(Debug, Clone)]
pub(super) enum Step {
    Input {
        at: Timestamp,
        input: Input,
    },
    /// The configuration of these files counts from here on.
    Reload {
        at: Timestamp,
        texts: Vec<ConfigurationText>,
    },
    /// The whole state, as it was here.
    State(Box<Keyframe>),
    /// Something is missing here.
    Lost(Loss),
}

/// The gap between two steps.
#[derive(Debug, Clone, Copy)]
pub(super) struct Loss {
    /// From the step before, if it is not known; up to the next one, if that is not known.
    pub from: Option<Timestamp>,
    pub to: Option<Timestamp>,
    /// The file is damaged.
    pub is_damage: bool,
}

impl Loss {
    const UNKNOWN: Loss = Loss { from: None, to: None, is_damage: false };

    /// Inputs that were taken up to this instant.
    fn until(at: Timestamp) -> Loss {
        Loss { to: Some(at), ..Loss::UNKNOWN }
    }
}

/// The parts of a recording that could not be used, apart from damage of the file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Notes {
    /// Inputs that the recorder did not keep, or whose message is missing.
    pub lost: u64,
    /// Lines of the journal that this version cannot read.
    pub unreadable: u64,
    /// Messages that do not follow their type.
    pub malformed: u64,
    /// Messages without a time, which got that of the message before.
    pub without_time: u64,
    /// Messages that stand behind later ones.
    pub out_of_order: u64,
    /// Messages of a time that cannot be, which are left out.
    pub of_other_times: u64,
    /// Sentences, each once.
    pub said: Vec<String>,
}

impl Notes {
    pub(super) fn say(&mut self, sentence: String) {
        if self.said.len() < 100 && !self.said.contains(&sentence) {
            self.said.push(sentence);
        }
    }
}

#[derive(Clone)]
struct LastMessage {
    channel: Arc<Channel>,
    /// The lower half of its sequence number.
    sequence: u32,
    body: RawBody,
    /// It was decoded for the other configuration.
    is_taken: bool,
}

/// A place among the steps, to which one can go back.
#[derive(Clone)]
pub(super) struct Mark {
    place: Place,
    bridge: Option<Bridge>,
    last: HashMap<Arc<str>, LastMessage>,
    ready: VecDeque<Step>,
    times: Times,
    ticked: Timestamp,
}

impl LastMessage {
    /// Whether the line names this one.
    fn is(&self, named: &MessageRef<'_>) -> bool {
        i64::from(self.sequence) == named.sequence & 0xffff_ffff
    }
}

/// The steps of a recording, in its order.
pub(super) struct Steps {
    reader: Bag,
    pub facts: Facts,
    /// Decodes the messages anew; `None`: the journal has what they meant.
    bridge: Option<Bridge>,
    /// The last message of each topic, for the lines of the journal that name it.
    last: HashMap<Arc<str>, LastMessage>,
    ready: VecDeque<Step>,
    times: Times,
    /// The time of the last step of a recording without a journal.
    ticked: Timestamp,
    pub notes: Notes,
    /// Counts the messages while it is there.
    pub flows: Option<Flows>,
    /// The earlier messages of latched topics are over.
    has_begun: bool,
}

impl Steps {
    /// The inputs of the engine, exactly.
    pub fn recorded(Recording { reader, facts }: Recording) -> Steps {
        Steps {
            reader,
            facts,
            bridge: None,
            last: HashMap::new(),
            ready: VecDeque::new(),
            times: Times::default(),
            ticked: Timestamp::ZERO,
            notes: Notes::default(),
            flows: None,
            has_begun: false,
        }
    }

    /// The inputs of an engine with another configuration.
    pub fn judged_anew(recording: Recording, bridge: Bridge) -> Steps {
        Steps { bridge: Some(bridge), ..Steps::recorded(recording) }
    }

    /// The place of the next step.
    pub fn mark(&self) -> Mark {
        Mark {
            place: self.reader.place(),
            bridge: self.bridge.clone(),
            last: self.last.clone(),
            ready: self.ready.clone(),
            times: self.times.clone(),
            ticked: self.ticked,
        }
    }

    /// Goes to a place, whose step is the next one.
    pub fn go_to(&mut self, mark: &Mark) {
        self.reader.go_to(mark.place);
        let Mark { place: _, bridge, last, ready, times, ticked } = mark.clone();
        (self.bridge, self.last, self.ready) = (bridge, last, ready);
        (self.times, self.ticked) = (times, ticked);
    }

    /// Parts of the file that cannot be used.
    pub fn reader(&self) -> &Bag {
        &self.reader
    }

    /// Topics of the configuration without any message so far.
    pub fn unheard(&self) -> BTreeSet<Unheard> {
        self.bridge.as_ref().map(Bridge::unheard).unwrap_or_default()
    }

    /// The topics of the recording whose messages mean nothing to the configuration.
    pub fn unread(&self) -> Vec<&Arc<Channel>> {
        let is_read = |topic: &str| self.bridge.as_ref().is_some_and(|bridge| bridge.reads(topic));
        self.reader.channels().iter().filter(|channel| !is_read(&channel.topic)).collect()
    }

    /// The next step. `model` is the configuration that counts now.
    pub fn next(&mut self, model: &Model) -> Option<Step> {
        loop {
            if let Some(step) = self.ready.pop_front() {
                return Some(step);
            }
            let entry = self.reader.next_entry()?;
            if let (Some(flows), Entry::Message { channel, stamps, body }) = (&mut self.flows, &entry) {
                let at_ns = if stamps.log_time_ns == 0 { stamps.publish_time_ns } else { stamps.log_time_ns };
                let bytes = body.as_ref().map_or(0, |(bytes, _)| bytes.len());
                flows.count(channel, at_ns, bytes, self.has_begun || !self.facts.has_journal);
            }
            self.has_begun |= matches!(&entry, Entry::Json { .. });
            match entry {
                Entry::Message { channel, stamps, body } => match &mut self.bridge {
                    // With a journal, its line knows who wrote it and when it was taken.
                    Some(bridge) if !self.facts.has_journal => {
                        let Some(ns) = self.times.take(stamps, &mut self.notes) else { continue };
                        let at = self.facts.at(ns);
                        let wall_ns = if stamps.log_time_ns == 0 { ns } else { stamps.log_time_ns };
                        let wall_ns = i64::try_from(wall_ns).unwrap_or(i64::MAX);
                        let received =
                            Received { body: &body, writer: [0; 16], wall_ns, when: PublicationTime::Now };
                        let inputs = bridge.take(&channel, received, &mut self.notes);
                        if inputs.is_empty() && at.since(self.ticked) >= TICK {
                            self.ready.push_back(Step::Input { at, input: Input::Tick });
                        }
                        if !self.ready.is_empty() || !inputs.is_empty() {
                            self.ticked = at;
                        }
                        self.ready.extend(inputs.into_iter().map(|input| Step::Input { at, input }));
                    }
                    // With the recorded configuration, the journal has what all others meant.
                    None if *channel.type_name != *DIAGNOSTIC_ARRAY => {}
                    _ if self.last.len() < TOPICS_MAX || self.last.contains_key(&channel.topic) => {
                        let topic = channel.topic.clone();
                        // A mark must not hold the chunk in which it lies.
                        let body = body.map(|(bytes, endian)| (Bytes::copy_from_slice(&bytes), endian));
                        let last = LastMessage { channel, sequence: stamps.sequence, body, is_taken: false };
                        self.last.insert(topic, last);
                    }
                    _ => {}
                },
                Entry::Json { channel, text, .. } if *channel.topic == *KEYFRAMES.topic => {
                    match serde_json::from_slice(&text) {
                        Ok(state) => return Some(Step::State(Box::new(state))),
                        Err(error) => {
                            self.notes.say(format!("a state of the engine cannot be read: {error}"))
                        }
                    }
                }
                Entry::Json { channel, text, .. } if *channel.topic == *JOURNAL.topic => {
                    let Ok(line) = serde_json::from_slice::<Line>(&text) else {
                        self.notes.unreadable += 1;
                        return Some(Step::Lost(Loss::UNKNOWN));
                    };
                    if let Some(step) = self.line(line, model) {
                        return Some(step);
                    }
                }
                Entry::Json { .. } => {}
                Entry::Missing(Missing { span_ns }) => {
                    let (from, to) = span_ns.unzip();
                    let [from, to] = [from, to].map(|ns| ns.map(|ns| self.facts.at(ns)));
                    return Some(Step::Lost(Loss { from, to, is_damage: true }));
                }
            }
        }
    }

    fn line(&mut self, Line { at_ns: at, took, message, .. }: Line<'_>, model: &Model) -> Option<Step> {
        let is_anew = self.bridge.is_some();
        match took {
            Took::Lost(count) => {
                self.notes.lost = self.notes.lost.saturating_add(count);
                Some(Step::Lost(Loss::until(at)))
            }
            // The other configuration stays. What the journal has from here on was meant for another one.
            Took::Reload(_) if is_anew => {
                self.bridge.iter_mut().for_each(|bridge| bridge.set_recorded(None));
                self.notes
                    .say("the vehicle took another configuration meanwhile, which is left out".to_owned());
                None
            }
            Took::Reload(texts) => Some(Step::Reload { at, texts }),
            Took::Input(_) | Took::Statuses
                if message.as_ref().is_some_and(|it| self.is_other(&it.topic)) =>
            {
                message.and_then(|message| self.decode(at, &message))
            }
            Took::Input(input) => {
                let input = input.into_owned();
                let input = match &self.bridge {
                    Some(bridge) if message.is_none() => bridge.fit(input)?,
                    _ => input,
                };
                Some(Step::Input { at, input })
            }
            Took::Statuses => {
                let found = message.and_then(|message| self.statuses(&message, model));
                if found.is_none() {
                    self.notes.lost += 1;
                }
                Some(found.map_or(Step::Lost(Loss::until(at)), |input| Step::Input { at, input }))
            }
        }
    }

    /// Whether the messages of a topic mean something else to this configuration than the journal says.
    fn is_other(&mut self, topic: &str) -> bool {
        self.bridge.as_mut().is_some_and(|bridge| !bridge.reads_the_same(topic))
    }

    /// Decodes the message of a line for the other configuration, once. One that means nothing to it lets time pass,
    /// as it did then: what was received earlier and taken later counts from there.
    fn decode(&mut self, at: Timestamp, named: &MessageRef<'_>) -> Option<Step> {
        let bridge = self.bridge.as_mut()?;
        let last = self.last.get_mut(&*named.topic).filter(|last| last.is(named));
        let Some(LastMessage { channel, body, is_taken, .. }) = last else {
            self.notes.lost += 1;
            return Some(Step::Lost(Loss::until(at)));
        };
        let tick = Step::Input { at, input: Input::Tick };
        if std::mem::replace(is_taken, true) {
            return Some(tick);
        }
        let received = Received {
            body,
            writer: named.writer()?,
            wall_ns: i64::try_from(named.received_ns).unwrap_or(i64::MAX),
            when: PublicationTime::Now,
        };
        let inputs = bridge.take(channel, received, &mut self.notes);
        self.ready.extend(inputs.into_iter().map(|input| Step::Input { at, input }));
        Some(self.ready.pop_front().unwrap_or(tick))
    }

    /// The statuses of a message, which stands before the line that names it.
    fn statuses(&self, named: &MessageRef<'_>, model: &Model) -> Option<Input> {
        let LastMessage { body, .. } = self.last.get(&*named.topic).filter(|last| last.is(named))?;
        let (body, endian) = body.as_ref().ok()?;
        let writer = named.writer()?;
        Some(Input::Diagnostics(recorded_statuses(model, &named.topic, body, *endian, writer)))
    }
}
