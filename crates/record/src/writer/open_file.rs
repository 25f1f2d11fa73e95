//! The file of the incident that is being written, and what is known of it so far.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::io::Read as _;
use std::path::Path;
use std::sync::{Arc, Weak};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::left_out::LeftOut;
use super::{Place, VEHICLE};
use crate::file::{
    BEGUN, FileError, IncidentFile, JOURNAL, JsonChannel, KEYFRAMES, LEFT_OUT, MessageStamps, TRANSITIONS,
};
use crate::folder::file_name;
use crate::job::Job;
use crate::journal::Line;
use crate::ring::{ConfigurationText, Entry, Position, Taken};
use crate::summary::{FrozenNode, Recording, Summary, TriggerLine};
use crate::transition::{Change, Transition};
use telltale_clock::Clock;
use telltale_engine::Engine;
use telltale_engine::model::Stage;
use telltale_engine::time::{Span, Timestamp};
use telltale_engine::view::record::Record;
use telltale_msg::received::Message;

/// A chunk of the file ends at least this often, and is brought to the disk.
const CHUNK_EVERY: Span = Span::from_secs(1);

/// A file that is being written.
pub(super) struct OpenFile {
    file: IncidentFile,
    pub(super) summary: Summary,
    /// The entry that is written next.
    pub(super) next: Position,
    /// The wall time at the start of the monotonic clock, as it was when the recording began.
    zero: SystemTime,
    /// Triggers that are not in the file yet: it is not at their times.
    untold: VecDeque<(Timestamp, TriggerLine)>,
    /// The time of the last entry.
    written: Timestamp,
    /// The last message of each topic, whose bytes need not stay for that, and whether it is in the file: several entries
    /// may share one.
    last: HashMap<Arc<str>, (Weak<Message>, bool)>,
    /// The transitions begin with the states of all nodes, which are written.
    knows_states: bool,
    /// When the last chunk ended; `None`: nothing is on the disk yet.
    chunk_ended: Option<Timestamp>,
    left_out: LeftOut,
    /// Entries that are missing here, which the journal does not say yet.
    unsaid: u64,
}

impl OpenFile {
    /// Begins the file. What is known of the incident is on the disk then. If the disk refuses that, no file is left.
    /// It grows no further than to `most`.
    pub(super) fn begin(place: &Place, job: &Job, most: u64, clock: Clock) -> Result<OpenFile, FileError> {
        let now = clock.now();
        let zero = clock.wall() - Duration::from_nanos(now.as_nanos());
        let since = zero + Duration::from_nanos(job.open.since.as_nanos());
        let name = file_name(job.number);
        let configuration = digest(&job.configuration);
        let mut about = place.about.clone();
        let facts = [
            ("incident", job.number.to_string()),
            ("configuration_sha256", configuration.clone()),
            ("start_of_clock_ns", unix_ns(zero).to_string()),
            ("shown_from_ns", job.shown_from.as_nanos().to_string()),
        ];
        about.extend(facts.map(|(key, value)| (key.to_owned(), value)));
        let file = IncidentFile::create(&place.folder.join(&name), about)?;
        let pre_roll = job.open.since.since(job.shown_from);
        let summary = Summary {
            id: job.number,
            since_ms: unix_ms(since),
            until_ms: None,
            stage: job.stage.map_or("", Stage::as_str).to_owned(),
            triggers: Vec::new(),
            more_triggers: 0,
            roots: Vec::new(),
            storm: job.open.storm,
            vehicle: place.about.get(VEHICLE).cloned().unwrap_or_default(),
            configuration,
            version: crate::VERSION.to_owned(),
            freeze: Vec::new(),
            recording: Recording {
                file: name,
                bytes: file.len(),
                pre_roll_s: pre_roll.as_millis() as f64 / 1000.0,
                finished: false,
                sha256: None,
                messages: 0,
                missing: 0,
                interrupted: false,
                gone: false,
                left_out: 0,
                left_out_bytes: 0,
            },
        };
        let mut open = OpenFile {
            file,
            summary,
            next: job.begin,
            zero,
            untold: VecDeque::new(),
            written: Timestamp::ZERO,
            last: HashMap::new(),
            knows_states: false,
            chunk_ended: None,
            left_out: LeftOut::default(),
            unsaid: 0,
        };
        open.follow(job);
        match open.introduce(place, job, unix_ns(since)) {
            Ok(()) => {
                open.file.grow_to(most);
                Ok(open)
            }
            Err(error) => {
                open.file.remove();
                Err(error)
            }
        }
    }

    /// Writes what stands before the recording itself.
    fn introduce(&mut self, place: &Place, job: &Job, since_ns: u64) -> Result<(), FileError> {
        for ConfigurationText { name, text } in job.configuration.iter() {
            let name = format!("configuration/{name}");
            self.file.attach(&name, "application/yaml", since_ns, text.as_bytes())?;
        }
        // For a store that loses it. A recording that was killed at once has its trigger too.
        let known = serde_json::to_string(&self.summary)
            .map_err(|error| FileError::format(self.file.path(), error.to_string()))?;
        self.file.metadata(BEGUN, BTreeMap::from([("summary".to_owned(), known)]))?;
        self.file.sync()?;
        // With their own times, which may be long ago: no line of the journal names them.
        for (at, message) in &job.latched {
            self.take_message(message, unix_ns(self.wall(*at)), place)?;
        }
        self.summary.recording.bytes = self.file.len();
        Ok(())
    }

    /// Takes over what is known of the incident. Returns whether that is more than before.
    pub(super) fn follow(&mut self, job: &Job) -> bool {
        let known = self.summary.trigger_count();
        for (at, trigger) in &job.open.triggers[self.summary.triggers.len()..] {
            let line = TriggerLine::of(unix_ms(self.wall(*at)), trigger);
            self.untold.push_back((*at, line.clone()));
            self.summary.triggers.push(line);
        }
        for (at, frozen) in &job.freeze[self.summary.freeze.len()..] {
            let at_ms = (*at > job.open.since).then(|| unix_ms(self.wall(*at)));
            self.summary.freeze.push(FrozenNode { at_ms, ..frozen.clone() });
        }
        self.summary.more_triggers = job.open.more;
        self.summary.roots = job.roots.iter().map(ToString::to_string).collect();
        if job.end.is_some() {
            self.summary.until_ms = Some(unix_ms(self.wall(job.open.until)));
        }
        self.summary.recording.bytes = self.file.len();
        self.summary.trigger_count() > known
    }

    pub(super) fn take(&mut self, entries: &[Entry], gone: u64, place: &Place) -> Result<(), FileError> {
        if gone > 0 {
            self.next += gone;
            self.summary.recording.missing += gone;
            let at = entries.first().map_or(Timestamp::ZERO, |entry| entry.at);
            self.lost(at, gone)?;
        }
        for entry in entries {
            self.take_entry(entry, place)?;
            self.next += 1;
        }
        Ok(())
    }

    fn take_entry(&mut self, entry: &Entry, place: &Place) -> Result<(), FileError> {
        self.tell_triggers(entry.at)?;
        self.written = entry.at;
        let at = unix_ns(self.wall(entry.at));
        let is_there = match &entry.message {
            Some(message) => self.take_message(message, at, place)?,
            None => false,
        };
        match &entry.taken {
            Taken::Keyframe(Some(engine)) => self.keyframe(at, engine),
            Taken::Keyframe(None) => Ok(()),
            Taken::Transition(record) => {
                let transition = Transition::of(record, unix_ms(self.wall(record.at)));
                self.document(&TRANSITIONS, at, &transition).map(drop)
            }
            Taken::Told(change) => {
                let transition =
                    Transition { at_ms: unix_ms(self.wall(entry.at)), change: (**change).clone() };
                self.document(&TRANSITIONS, at, &transition).map(drop)
            }
            Taken::Statuses if !is_there => {
                self.summary.recording.missing += 1;
                self.lost(entry.at, 1)
            }
            Taken::Lost(count) => {
                self.summary.recording.missing += count;
                self.lost(entry.at, *count)
            }
            Taken::Input(_) | Taken::Statuses | Taken::Reload(_) => {
                self.say_lost(entry.at)?;
                let line = if is_there { Line::of(entry) } else { Line::without_message(entry) };
                if self.unsaid == 0 && self.file.json(&JOURNAL, at, &line)? {
                    return Ok(());
                }
                self.summary.recording.missing += 1;
                self.lost(entry.at, 1)
            }
        }
    }

    /// The engine's whole state. The first one has to be there; later ones make a place for what is small.
    fn keyframe(&mut self, at: u64, engine: &Engine) -> Result<(), FileError> {
        if self.knows_states
            && !self.left_out.has_place(
                KEYFRAMES.topic,
                engine.memory() as u64,
                self.file.most(),
                self.file.left(),
            )
        {
            return Ok(());
        }
        self.document(&KEYFRAMES, at, &engine.keyframe())?;
        if self.knows_states { Ok(()) } else { self.states(engine) }
    }

    /// Writes the triggers up to an instant. One that was noticed late stands behind what is there already.
    fn tell_triggers(&mut self, until: Timestamp) -> Result<(), FileError> {
        while let Some((at, line)) = self.untold.pop_front_if(|(at, _)| *at <= until) {
            let at = at.max(self.written);
            let change = Change::Trigger {
                of: line.kind.into(),
                what: line.what.into(),
                alarm: line.alarm,
                note: line.note.into(),
            };
            self.document(&TRANSITIONS, unix_ns(self.wall(at)), &Transition { at_ms: line.at_ms, change })?;
        }
        Ok(())
    }

    /// A document, unless it is too large for the readers of the file: then it is missing.
    fn document(
        &mut self,
        channel: &JsonChannel,
        at: u64,
        document: &impl Serialize,
    ) -> Result<bool, FileError> {
        let is_written = self.file.json(channel, at, document)?;
        self.summary.recording.missing += u64::from(!is_written);
        Ok(is_written)
    }

    /// Entries are missing, which the journal says as soon as it has a place for that.
    fn lost(&mut self, at: Timestamp, count: u64) -> Result<(), FileError> {
        self.unsaid += count;
        self.say_lost(at)
    }

    fn say_lost(&mut self, at: Timestamp) -> Result<(), FileError> {
        if self.unsaid > 0 {
            let lost = Entry { at, taken: Taken::Lost(self.unsaid), message: None };
            if self.file.json(&JOURNAL, unix_ns(self.wall(at)), &Line::of(&lost))? {
                self.unsaid = 0;
            }
        }
        Ok(())
    }

    /// The state of everything at the beginning, so that the transitions can be read by themselves.
    fn states(&mut self, engine: &Engine) -> Result<(), FileError> {
        self.knows_states = true;
        let present = Record::present(&engine.clone().snapshot(), false);
        // The first one says that the program started, which it did not now.
        present.iter().skip(1).try_for_each(|record| {
            let at = self.wall(record.at);
            self.document(&TRANSITIONS, unix_ns(at), &Transition::of(record, unix_ms(at))).map(drop)
        })
    }

    /// Writes a message, if it is whole and has a place. Returns whether it is in the file.
    fn take_message(&mut self, message: &Arc<Message>, at: u64, place: &Place) -> Result<bool, FileError> {
        if let Some((last, is_there)) = self.last.get(&message.topic)
            && std::ptr::eq(last.as_ptr(), Arc::as_ptr(message))
        {
            return Ok(*is_there);
        }
        // A body without a readable frame has no bytes.
        let Ok((body, endian)) = &message.body else { return Ok(true) };
        let bytes = body.len() as u64;
        let has_place = self.left_out.has_place(&message.topic, bytes, self.file.most(), self.file.left());
        let is_there = message.left_out == 0 && has_place;
        self.last.insert(message.topic.clone(), (Arc::downgrade(message), is_there));
        if message.left_out > 0 {
            self.left_out.size_only(&message.topic, message.left_out as u64);
        } else if !has_place {
            self.left_out.lack(&message.topic, bytes);
            let lack = self.left_out.all();
            let recording = &mut self.summary.recording;
            (recording.left_out, recording.left_out_bytes) = (lack.messages, lack.bytes);
        }
        if !is_there {
            return Ok(false);
        }
        self.left_out.write(&message.topic, bytes);
        let define = || place.definitions.text(&message.type_name);
        let topic = self.file.topic(&message.topic, &message.type_name, define)?;
        let stamps = MessageStamps {
            log_time_ns: at,
            publish_time_ns: message.source.map_or(at, unix_ns),
            // The sequence numbers of MCAP have 32 bits.
            sequence: (message.sequence & 0xffff_ffff) as u32,
        };
        self.summary.recording.messages += 1;
        self.file.message(topic, stamps, (body, *endian))?;
        Ok(true)
    }

    /// The length of the file so far.
    pub(super) fn length(&self) -> u64 {
        self.file.len()
    }

    /// It grows no further than to this length.
    pub(super) fn grow_to(&mut self, most: u64) {
        self.file.grow_to(most);
    }

    /// Writes the triggers that are known, and all before them.
    pub(super) fn save_triggers(&mut self, clock: Clock) -> Result<(), FileError> {
        self.tell_triggers(Timestamp::MAX)?;
        self.chunk_ended = Some(clock.now());
        self.file.end_chunk()?;
        self.file.sync()
    }

    pub(super) fn end_chunk_if_due(&mut self, clock: Clock) -> Result<(), FileError> {
        let now = clock.now();
        if self.chunk_ended.is_some_and(|ended| now.since(ended) < CHUNK_EVERY) {
            return Ok(());
        }
        self.chunk_ended = Some(now);
        self.file.end_chunk()?;
        self.file.sync()
    }

    /// Completes the file; its hash is made afterwards. If the disk refuses that, what is there can be read.
    pub(super) fn finish(mut self, clock: Clock) -> (Summary, Result<(), FileError>) {
        let until_ms = unix_ms(self.wall(clock.now()));
        self.summary.until_ms.get_or_insert(until_ms);
        let told = self.tell_end();
        let OpenFile { file, mut summary, .. } = self;
        let finished =
            told.and_then(|()| file.finish()).map(|written| summary.recording.bytes = written.bytes);
        if finished.is_ok() {
            summary.recording.finished = true;
        } else {
            summary.recording.interrupted = true;
        }
        (summary, finished)
    }

    /// The last document of the file, for which there is always room.
    fn tell_end(&mut self) -> Result<(), FileError> {
        self.file.grow_to(u64::MAX);
        self.tell_triggers(Timestamp::MAX)?;
        self.say_lost(self.written)?;
        let left_out = self.left_out.told();
        if left_out.is_empty() { Ok(()) } else { self.file.metadata(LEFT_OUT, left_out) }
    }

    pub(super) fn abandon(mut self, clock: Clock) -> Summary {
        let until_ms = unix_ms(self.wall(clock.now()));
        self.summary.until_ms.get_or_insert(until_ms);
        self.summary.recording.bytes = self.file.len();
        self.summary.recording.interrupted = true;
        self.summary
    }

    fn wall(&self, at: Timestamp) -> SystemTime {
        self.zero + Duration::from_nanos(at.as_nanos())
    }
}

/// The SHA-256 of a configuration: of the names and texts of its files.
pub fn digest(configuration: &[ConfigurationText]) -> String {
    let mut digest = Sha256::new();
    for ConfigurationText { name, text } in configuration {
        for part in [name, text] {
            digest.update((part.len() as u64).to_le_bytes());
            digest.update(part);
        }
    }
    hex(&digest.finalize())
}

/// The SHA-256 of a file, in hexadecimal digits.
pub fn hash_file(path: &Path) -> std::io::Result<String> {
    let (mut digest, mut file) = (Sha256::new(), std::fs::File::open(path)?);
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok(hex(&digest.finalize())),
            Ok(read) => digest.update(&buffer[..read]),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn unix_ns(at: SystemTime) -> u64 {
    u64::try_from(at.duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos()).unwrap_or(u64::MAX)
}

/// Milliseconds since 1970.
pub fn unix_ms(at: SystemTime) -> i64 {
    i64::try_from(unix_ns(at) / 1_000_000).unwrap_or(i64::MAX)
}
