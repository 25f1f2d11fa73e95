//! The last minutes of everything that the engine took, within a bound of bytes: the part of a recording from
//! before its trigger.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::latched::{Kept, Latched};
use super::transition::Change;
use telltale_engine::Engine;
use telltale_engine::input::Input;
use telltale_engine::time::{Span, Timestamp};
use telltale_engine::view::record::Record;
use telltale_msg::received::{Message, Stamped};

/// Nothing is kept for longer, even if there is room.
pub const KEPT_FOR: Span = Span::from_secs(300);

/// The engine's whole state is kept this often, so that a recording can begin with one.
pub const KEYFRAME_EVERY: Span = Span::from_secs(10);

/// Of states that are older, one is kept for each such time.
const THINNED_AFTER: Span = Span::from_secs(60);

/// Topics that are accounted for by name. Messages of further ones are not kept.
const TOPICS_MAX: usize = 1024;

/// The memory of an entry apart from its content, with its places in the queues, which grow by doubling.
const ENTRY_BYTES: usize = 160;

/// The memory of a message apart from its body, of an input, and of a change of the shown state or a word of the
/// program.
const MESSAGE_BYTES: usize = size_of::<Message>() + 96;
const INPUT_BYTES: usize = size_of::<Input>() + 32;
const RECORD_BYTES: usize = 320;

/// One thing that the engine took, in its order.
#[derive(Debug, Clone)]
pub struct Entry {
    /// The time with which the engine took it.
    pub at: Timestamp,
    pub taken: Taken,
    /// The message behind it; `None` if there was none, or if its bytes are no longer kept.
    pub message: Option<Arc<Message>>,
}

#[derive(Debug, Clone)]
pub enum Taken {
    Input(Arc<Input>),
    /// The statuses of the entry's message. They are decoded again in a replay.
    Statuses,
    /// From here on another configuration counts: the texts of its files.
    Reload(Arc<[ConfigurationText]>),
    /// The changes by earlier inputs: for readers, not for a replay.
    Transition(Arc<Record>),
    /// Events outside the engine: for readers, not for a replay.
    Told(Arc<Change<'static>>),
    /// The engine's whole state here; `None` if it is kept no longer.
    Keyframe(Option<Arc<Engine>>),
    /// Entries before this one are missing: the recorder did not keep up.
    Lost(u64),
}

impl Entry {
    /// The memory that it takes without its message, and without the engine's state.
    fn memory(&self) -> usize {
        ENTRY_BYTES
            + match &self.taken {
                Taken::Input(input) => INPUT_BYTES + input.text_bytes(),
                Taken::Transition(_) => RECORD_BYTES,
                Taken::Told(_) => RECORD_BYTES,
                Taken::Reload(texts) => texts.iter().map(|it| it.name.len() + it.text.len()).sum(),
                Taken::Statuses | Taken::Keyframe(_) | Taken::Lost(_) => 0,
            }
    }
}

/// The memory of a message whose body has so many bytes. Without any it is counted with the entry before.
fn memory_of(bytes: usize) -> usize {
    if bytes == 0 { 0 } else { bytes + MESSAGE_BYTES }
}

/// A file of a configuration.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ConfigurationText {
    pub name: String,
    pub text: String,
}

/// The place of an entry in the order of all entries since the start.
pub type Position = u64;

/// A bounded queue of entries and of the engine's states between them.
#[derive(Debug)]
pub struct Ring {
    entries: VecDeque<Entry>,
    /// The place of the oldest entry.
    first: Position,
    bytes: usize,
    bytes_max: usize,
    /// Of the engine's states.
    keyframe_bytes: usize,
    /// The places of the engine's states, with their times.
    keyframes: VecDeque<(Position, Timestamp)>,
    topics: BTreeMap<Arc<str>, Topic>,
    /// When messages of a topic last made place for another topic.
    forgot_topic_at: Option<Timestamp>,
    /// The last messages of latched topics among those that are gone.
    latched: Latched,
}

/// The messages of one topic in the ring.
#[derive(Debug, Default)]
struct Topic {
    held: VecDeque<(Position, Timestamp, usize)>,
    bytes: usize,
    /// Messages that made room for others before their time.
    dropped: u64,
    /// When the newest of them was received.
    dropped_at: Option<Timestamp>,
    /// Of the newest message there are only its times and its size.
    is_sizes_only: bool,
}

impl Topic {
    /// The oldest message makes room.
    fn drop_for_room(&mut self, received: Timestamp) {
        self.dropped += 1;
        self.dropped_at = Some(received);
    }
}

/// How much of a topic the ring holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Held {
    pub topic: Arc<str>,
    pub messages: usize,
    pub bytes: usize,
    /// The age of its oldest message.
    pub span: Span,
    /// Messages that had to make room for others, since the start.
    pub dropped: u64,
    /// The age of the newest of them: nothing older is held whole.
    pub dropped_age: Option<Span>,
    /// Only the times and sizes of its messages are held now.
    pub is_sizes_only: bool,
}

impl Held {
    /// Whether less is held than this much of the past, for want of room.
    pub fn is_short_of(&self, wanted: Span) -> bool {
        self.dropped_age.is_some_and(|age| age < wanted)
    }

    /// Bytes a second, on average over the messages it holds; `None` while they span less than a second.
    pub fn bytes_per_s(&self) -> Option<u64> {
        let ms = self.span.as_millis();
        (ms >= 1000).then(|| self.bytes as u64 * 1000 / ms)
    }
}

impl Ring {
    /// An empty ring of at most `bytes_max` bytes of messages and inputs.
    pub fn new(bytes_max: usize) -> Ring {
        Ring {
            entries: VecDeque::new(),
            first: 0,
            bytes: 0,
            bytes_max,
            keyframe_bytes: 0,
            keyframes: VecDeque::new(),
            topics: BTreeMap::new(),
            forgot_topic_at: None,
            latched: Latched::default(),
        }
    }

    /// Another bound; it counts from the next entry on.
    pub fn set_bytes_max(&mut self, bytes_max: usize) {
        self.bytes_max = bytes_max;
    }

    /// Takes the next input of the engine.
    pub fn push_input(&mut self, Stamped { input, received, message }: Stamped) {
        let taken = match (input, &message) {
            // The message alone does not say how late it was.
            (Input::Diagnostics(array), Some(_)) if array.late().is_zero() => Taken::Statuses,
            (input, _) => Taken::Input(Arc::new(input)),
        };
        self.push(Entry { at: received, taken, message });
    }

    /// Takes a change of what is shown.
    pub fn push_record(&mut self, record: Record) {
        let at = record.at;
        self.push(Entry { at, taken: Taken::Transition(Arc::new(record)), message: None });
    }

    /// Takes the next entry. The oldest ones make room for it.
    pub fn push(&mut self, entry: Entry) {
        if let Some(message) = &entry.message {
            // Inputs that were made from one message share its bytes.
            let shared = self.entries.back().and_then(|last| last.message.as_ref());
            let is_shared = shared.is_some_and(|shared| Arc::ptr_eq(shared, message));
            // One without bytes has its place too.
            let bytes = if is_shared { 0 } else { message.len().max(1) };
            let place = self.next();
            if self.topics.len() >= TOPICS_MAX && !self.topics.contains_key(&message.topic) {
                self.forget_topic(entry.at);
            }
            let topic = self.topics.entry(message.topic.clone()).or_default();
            topic.held.push_back((place, entry.at, bytes));
            topic.bytes += bytes;
            topic.is_sizes_only = message.left_out > 0;
            self.bytes += memory_of(bytes);
        }
        self.bytes += entry.memory();
        let (now, of) = (entry.at, entry.message.as_ref().map(|message| message.topic.clone()));
        self.entries.push_back(entry);
        self.make_room(now, of.as_deref());
    }

    /// Takes the engine's present state.
    pub fn push_keyframe(&mut self, engine: Arc<Engine>) {
        let now = engine.now();
        self.keyframe_bytes += engine.memory();
        self.keyframes.push_back((self.next(), now));
        self.push(Entry { at: now, taken: Taken::Keyframe(Some(engine)), message: None });
        // Of older ones, one a minute is enough: states of a large vehicle are large.
        let at = |index: usize| self.keyframes.get(index).map(|&(_, at)| at);
        let is_spare = |index: &usize| {
            let (Some(before), Some(it), Some(after)) = (at(index - 1), at(*index), at(index + 1)) else {
                return false;
            };
            now.since(it) > THINNED_AFTER && after.since(before) <= THINNED_AFTER
        };
        if let Some(spare) = (1..self.keyframes.len()).find(is_spare) {
            self.forget_keyframe(spare);
        }
        // Those of a vehicle that is larger still leave half of the memory to what was received.
        while self.keyframe_bytes > self.bytes_max / 2 && self.keyframes.len() > 1 {
            let at = |index: usize| self.keyframes.get(index).map_or(Timestamp::ZERO, |&(_, at)| at);
            let last = self.keyframes.len() - 1;
            let closest = (1..last).min_by_key(|&index| at(index + 1).since(at(index - 1)));
            self.forget_keyframe(closest.unwrap_or(0));
        }
    }

    fn forget_keyframe(&mut self, index: usize) {
        if let Some((place, _)) = self.keyframes.remove(index)
            && let Some(entry) = self.entry(place)
            && let Taken::Keyframe(Some(engine)) = std::mem::replace(&mut entry.taken, Taken::Keyframe(None))
        {
            self.keyframe_bytes -= engine.memory();
        }
    }

    /// The place of the oldest entry.
    pub fn first(&self) -> Position {
        self.first
    }

    /// The place of the next entry.
    pub fn next(&self) -> Position {
        self.first + self.entries.len() as u64
    }

    /// The place and the time of the newest state of the engine that is not younger than `at`, or else of the
    /// oldest one.
    pub fn keyframe_before(&self, at: Timestamp) -> Option<(Position, Timestamp)> {
        let is_older = |&&(_, taken): &&(Position, Timestamp)| taken <= at;
        self.keyframes.iter().rev().find(is_older).or(self.keyframes.front()).copied()
    }

    fn entry(&mut self, place: Position) -> Option<&mut Entry> {
        let index = usize::try_from(place.checked_sub(self.first)?).ok()?;
        self.entries.get_mut(index)
    }

    /// Entries from `place` on, at most as many as fit into `bytes_max`, but at least one; and the number of
    /// entries from there on that the ring no longer holds.
    pub fn read(&self, place: Position, bytes_max: usize) -> (Vec<Entry>, u64) {
        let gone = self.first.saturating_sub(place);
        let skip = usize::try_from(place.saturating_sub(self.first)).unwrap_or(usize::MAX);
        let mut bytes = 0;
        let fits = |entry: &&Entry| {
            let before = bytes;
            bytes += entry.memory() + entry.message.as_ref().map_or(0, |message| message.len());
            before == 0 || bytes <= bytes_max
        };
        (self.entries.iter().skip(skip).take_while(fits).cloned().collect(), gone)
    }

    /// The last messages of latched topics before this place, the oldest first.
    pub fn latched_before(&self, place: Position) -> Vec<Kept> {
        let mut latched = self.latched.clone();
        let count = usize::try_from(place.saturating_sub(self.first)).unwrap_or(usize::MAX);
        for entry in self.entries.iter().take(count) {
            if let Some(message) = entry.message.as_ref().filter(|message| message.kept) {
                latched.take(entry.at, message.clone(), self.bytes_max);
            }
        }
        latched.in_order()
    }

    /// The share of each topic, by name.
    pub fn meter(&self, now: Timestamp) -> Vec<Held> {
        let held = |(name, topic): (&Arc<str>, &Topic)| Held {
            topic: name.clone(),
            messages: topic.held.len(),
            bytes: topic.bytes,
            span: topic.held.front().map_or(Span::ZERO, |&(_, at, _)| now.since(at)),
            dropped: topic.dropped,
            dropped_age: topic.dropped_at.map(|at| now.since(at)),
            is_sizes_only: topic.is_sizes_only,
        };
        self.topics.iter().map(held).collect()
    }

    /// How long ago messages of a topic made place for another topic, if they ever did.
    pub fn forgot_topic(&self, now: Timestamp) -> Option<Span> {
        self.forgot_topic_at.map(|at| now.since(at))
    }

    pub fn bytes_max(&self) -> usize {
        self.bytes_max
    }

    /// The time of its newest entry.
    pub fn newest(&self) -> Option<Timestamp> {
        self.entries.back().map(|entry| entry.at)
    }

    /// The age of its oldest entry.
    pub fn span(&self, now: Timestamp) -> Span {
        self.entries.front().map_or(Span::ZERO, |entry| now.since(entry.at))
    }

    /// The memory that it takes. One state of the engine has its place even where it takes more than half of it.
    pub fn bytes(&self) -> usize {
        self.bytes + self.latched.bytes() + self.keyframe_bytes.min(self.bytes_max / 2)
    }

    fn make_room(&mut self, now: Timestamp, of: Option<&str>) {
        // One large topic takes its own past, not that of the others.
        while let Some(topic) = of.and_then(|of| self.topics.get_mut(of))
            && topic.bytes > self.bytes_max / 2
            && topic.held.len() > 1
        {
            let Some((place, received, bytes)) = topic.held.pop_front() else { break };
            topic.bytes -= bytes;
            topic.drop_for_room(received);
            self.bytes -= memory_of(bytes);
            self.forget_message(place);
            // The other inputs of the same message.
            while let Some(topic) = of.and_then(|of| self.topics.get_mut(of))
                && let Some((place, _, _)) = topic.held.pop_front_if(|&mut (_, _, bytes)| bytes == 0)
            {
                self.forget_message(place);
            }
        }
        while let Some(oldest) = self.entries.front() {
            let is_full = self.bytes() > self.bytes_max;
            if !is_full && now.since(oldest.at) <= KEPT_FOR {
                break;
            }
            self.drop_oldest(is_full);
        }
    }

    /// Forgets the topic that has been silent for longest: topics come and go.
    fn forget_topic(&mut self, now: Timestamp) {
        let newest = |topic: &Topic| topic.held.back().map(|&(place, ..)| place);
        let silent = self.topics.iter().min_by_key(|(_, topic)| newest(topic));
        let Some(name) = silent.map(|(name, _)| name.clone()) else { return };
        let Some(topic) = self.topics.remove(&name) else { return };
        if !topic.held.is_empty() {
            self.forgot_topic_at = Some(now);
        }
        for (place, _, bytes) in topic.held {
            self.bytes -= memory_of(bytes);
            self.forget_message(place);
        }
    }

    fn forget_message(&mut self, place: Position) {
        let bytes_max = self.bytes_max;
        let Some(entry) = self.entry(place) else { return };
        let at = entry.at;
        if let Some(message) = entry.message.take().filter(|message| message.kept) {
            self.latched.take(at, message, bytes_max);
        }
    }

    fn drop_oldest(&mut self, for_room: bool) {
        let Some(oldest) = self.entries.pop_front() else { return };
        self.bytes -= oldest.memory();
        if let Taken::Keyframe(Some(engine)) = &oldest.taken {
            self.keyframe_bytes -= engine.memory();
        }
        if let Some(message) = oldest.message.as_ref().filter(|message| message.kept) {
            self.latched.take(oldest.at, message.clone(), self.bytes_max);
        }
        if let Some(topic) = oldest.message.and_then(|message| self.topics.get_mut(&message.topic))
            && topic.held.front().is_some_and(|&(place, _, _)| place == self.first)
            && let Some((_, received, bytes)) = topic.held.pop_front()
        {
            topic.bytes -= bytes;
            if for_room {
                topic.drop_for_room(received);
            }
            self.bytes -= memory_of(bytes);
        }
        self.first += 1;
        while self.keyframes.front().is_some_and(|&(place, _)| place < self.first) {
            self.keyframes.pop_front();
        }
    }
}

#[cfg(test)]
mod tests;
