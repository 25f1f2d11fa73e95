//! The thread that keeps the ring and decides when an incident begins and ends. Another thread writes the
//! incidents; the ring is all that lies between them.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::RecvTimeoutError;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

use super::feed::{Turn, Turns};
use super::freeze;
use super::incident::{Change, Margins, Open, Tracker, roots};
use super::job::Job;
use super::noticed::Noticed;
use super::ring::{ConfigurationText, Entry, Held, Position, Ring, Taken};
use super::transition::Change as Told;
use telltale_clock::Clock;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::time::{Span, Timestamp};

/// Incidents that may wait for the disk. Further ones are not written, which the log says.
const WAITING_MAX: usize = 4;

/// Without a turn of the engine, the recorder looks this often whether an incident is over.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// A wall clock that is suddenly so much ahead or behind was set.
const STEP_MIN: Span = Span::from_millis(500);

/// The configuration of recordings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    pub margins: Margins,
    /// Bytes of the ring.
    pub memory: usize,
    /// The longest window, timeout or delay of the configuration: a recording begins so much earlier, so that
    /// another configuration has a past to judge by.
    pub longest_memory: Span,
    /// The files of the configuration. The engine tells of later ones.
    pub configuration: Arc<[ConfigurationText]>,
}

impl Settings {
    /// How much of the past a recording needs.
    fn past(&self) -> Span {
        let (before, longest) = (self.margins.before.as_nanos(), self.longest_memory.as_nanos());
        Span::from_nanos(before.saturating_add(longest))
    }
}

/// The length of the ring, and its aim.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Meter {
    /// How much of the past a recording needs.
    pub wanted: Span,
    /// The bound of bytes of all topics together.
    pub memory: usize,
    /// By name.
    pub topics: Vec<Held>,
    /// Messages that a recording needs made place for those of further topics.
    pub has_too_many_topics: bool,
}

impl Meter {
    /// The topics that hold less than a recording needs.
    pub fn short(&self) -> impl Iterator<Item = &Held> {
        self.topics.iter().filter(|held| held.is_short_of(self.wanted))
    }
}

/// The state that the recorder shares with the writer and with pages.
#[derive(Debug)]
pub struct Shared {
    state: Mutex<State>,
    /// Notified when there is something to write.
    news: Condvar,
    /// Since when the writer waits for the disk, in nanoseconds of the clock; zero while it does not.
    disk_since: AtomicU64,
    clock: Clock,
}

#[derive(Debug)]
pub(super) struct State {
    pub ring: Ring,
    tracker: Tracker,
    settings: Settings,
    snapshot: Arc<Snapshot>,
    /// The events since that snapshot.
    noticed: Vec<Noticed>,
    /// The configurations by which the engine judged what the ring holds, each with the place from which on.
    configurations: VecDeque<(Position, Arc<[ConfigurationText]>)>,
    /// Incidents to write, the oldest first.
    pub jobs: VecDeque<Job>,
    next_number: u64,
    /// The incident that is open has no recording: it had to wait for others, or for the engine's first state.
    is_unrecorded: bool,
    pub ended: bool,
}

/// A mark: the incident that it is in, and how many triggers that has with it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mark {
    pub incident: u64,
    pub triggers: u64,
}

/// Why a moment is not marked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unmarked {
    /// No incident can be recorded yet; one that is open then has the mark.
    Off,
    /// The present incident has as many marks as it may: it lasts longer with this one.
    Full,
}

/// A handle to a running recorder. Clones lead to the same one.
#[derive(Debug, Clone)]
pub struct Recorder(pub(super) Arc<Shared>);

impl Recorder {
    /// Starts a recorder of an engine whose first snapshot is given. It ends when the feed is dropped.
    pub fn start(
        turns: Turns,
        first: Arc<Snapshot>,
        settings: Settings,
        next_number: u64,
        clock: Clock,
    ) -> std::io::Result<Recorder> {
        let state = State {
            ring: Ring::new(settings.memory),
            tracker: Tracker::new(settings.margins, &first),
            configurations: VecDeque::from([(0, settings.configuration.clone())]),
            settings,
            snapshot: first,
            noticed: Vec::new(),
            jobs: VecDeque::new(),
            next_number,
            is_unrecorded: false,
            ended: false,
        };
        let shared = Arc::new(Shared {
            state: Mutex::new(state),
            news: Condvar::new(),
            disk_since: AtomicU64::new(0),
            clock,
        });
        let recorder = Recorder(shared.clone());
        std::thread::Builder::new().name("recorder".into()).spawn(move || shared.run(&turns))?;
        Ok(recorder)
    }

    /// How long the writer has waited for the disk by now. One that hangs reports no error.
    pub fn waits_for_disk(&self) -> Option<Span> {
        match self.0.disk_since.load(Ordering::Relaxed) {
            0 => None,
            since => Some(self.0.clock.now().since(Timestamp::from_nanos(since))),
        }
    }

    /// Marks this moment: an incident begins or goes on. The writer tells when it is on the disk.
    ///
    /// # Errors
    /// No incident can be recorded yet, or there are too many marks.
    pub fn mark(&self, by: &str, note: &str) -> Result<Mark, Unmarked> {
        let mut state = self.0.lock();
        let now = self.0.clock.now();
        let is_recorded = state.present().is_some();
        let (changes, has_place) = state.tracker.mark(now, by, note, is_recorded);
        state.apply(changes);
        self.0.news.notify_all();
        if !has_place {
            return Err(Unmarked::Full);
        }
        let job = state.present().ok_or(Unmarked::Off)?;
        Ok(Mark { incident: job.number, triggers: job.open.count() })
    }

    /// Records an event that the engine does not know, among the changes.
    pub fn tell(&self, what: Told<'static>) {
        self.0.lock().tell(what);
    }

    /// Another configuration counts from now on.
    pub fn follow_settings(&self, settings: Settings) {
        let mut state = self.0.lock();
        state.tracker.set_margins(settings.margins);
        state.ring.set_bytes_max(settings.memory);
        state.settings = settings;
    }

    /// The share of each topic in the ring.
    pub fn meter(&self) -> Meter {
        let state = self.0.lock();
        let (now, wanted) = (self.0.clock.now(), state.settings.past());
        Meter {
            wanted,
            memory: state.ring.bytes_max(),
            topics: state.ring.meter(now),
            has_too_many_topics: state.ring.forgot_topic(now).is_some_and(|age| age < wanted),
        }
    }

    /// Since when it holds everything; `None` before the first state of the engine.
    pub fn holds_since(&self) -> Option<Timestamp> {
        self.0.lock().ring.keyframe_before(Timestamp::ZERO).map(|(_, at)| at)
    }

    /// The recording of this incident waits to be written, or for its end.
    pub fn writes(&self, id: u64) -> bool {
        self.0.lock().jobs.iter().any(|job| job.number == id)
    }

    /// The number of the incident that is being recorded.
    pub fn present(&self) -> Option<u64> {
        self.0.lock().present().map(|job| job.number)
    }
}

impl Shared {
    pub(super) fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until there may be something to write, at most for this time.
    pub(super) fn wait<'a>(
        &self,
        state: MutexGuard<'a, State>,
        for_at_most: Duration,
    ) -> MutexGuard<'a, State> {
        self.news.wait_timeout(state, for_at_most).unwrap_or_else(PoisonError::into_inner).0
    }

    /// Does something that the disk may hold up.
    pub(super) fn on_disk<T>(&self, work: impl FnOnce() -> T) -> T {
        self.disk_since.store(self.clock.now().as_nanos(), Ordering::Relaxed);
        let done = work();
        self.disk_since.store(0, Ordering::Relaxed);
        done
    }

    pub(super) fn clock(&self) -> Clock {
        self.clock
    }

    /// The wall time at the start of the monotonic clock; `None` while the program was held up in between.
    fn zero(&self) -> Option<SystemTime> {
        let before = self.clock.now();
        let wall = self.clock.wall();
        let is_quick = self.clock.now().since(before) < STEP_MIN;
        is_quick.then(|| wall - Duration::from_nanos(before.as_nanos()))
    }

    fn run(&self, turns: &Turns) {
        let mut zero = self.zero();
        loop {
            let turn = turns.next(LOOK_EVERY);
            let before = zero;
            zero = self.zero().or(zero);
            let mut state = self.lock();
            if let (Some(before), Some(after)) = (before, zero)
                && let Some(by_ms) = step(before, after)
            {
                state.tell(Told::ClockSet { by_ms });
            }
            // While turns wait, an incident ends by their times: it lacks nothing of what they bring.
            let now = match turn {
                Ok(turn) => state.take(turn),
                Err(RecvTimeoutError::Timeout) => self.clock.now(),
                Err(RecvTimeoutError::Disconnected) => {
                    let now = self.clock.now();
                    state.close(now);
                    state.ended = true;
                    self.news.notify_all();
                    return;
                }
            };
            let changes = state.tracker.due(now);
            state.apply(changes);
            if state.is_unrecorded {
                state.take_up();
            }
            turns.recording.store(state.present().is_some(), Ordering::Relaxed);
            if !state.jobs.is_empty() {
                self.news.notify_all();
            }
        }
    }
}

/// By how much the wall clock was set between two looks; a slow correction is no step.
fn step(before: SystemTime, after: SystemTime) -> Option<i64> {
    let ms = |apart: Duration| i64::try_from(apart.as_millis()).unwrap_or(i64::MAX);
    let by_ms = after.duration_since(before).map_or_else(|error| -ms(error.duration()), ms);
    (by_ms.unsigned_abs() >= STEP_MIN.as_millis()).then_some(by_ms)
}

impl State {
    /// The incident that is open.
    fn present(&self) -> Option<&Job> {
        self.jobs.back().filter(|job| job.end.is_none())
    }

    /// Takes what the engine knows nothing of, at the time of what it took last: the order stays.
    fn tell(&mut self, what: Told<'static>) {
        let at = self.ring.newest().unwrap_or(self.snapshot.now);
        self.ring.push(Entry { at, taken: Taken::Told(Arc::new(what)), message: None });
    }

    /// Takes a turn of the engine. Returns its time.
    fn take(&mut self, turn: Turn) -> Timestamp {
        let Turn { lost, taken, reload, records, noticed, snapshot, keyframe, .. } = turn;
        let shown = snapshot.as_ref().unwrap_or(&self.snapshot).now;
        let now = taken.iter().map(|stamped| stamped.received).fold(shown, Timestamp::max);
        if lost > 0 {
            let at = taken.first().map_or(now, |first| first.received);
            self.ring.push(Entry { at, taken: Taken::Lost(lost), message: None });
        }
        let mut records = records.into_iter().peekable();
        for stamped in taken {
            // A change by time alone before it stands before it.
            while let Some(record) = records.next_if(|record| record.at < stamped.received) {
                self.ring.push_record(record);
            }
            self.ring.push_input(stamped);
        }
        let begins = self.ring.next();
        if let Some((at, texts)) = reload {
            self.ring.push(Entry { at, taken: Taken::Reload(texts.clone()), message: None });
            self.configurations.push_back((begins + 1, texts));
        }
        records.for_each(|record| self.ring.push_record(record));
        if let Some(keyframe) = keyframe {
            self.ring.push_keyframe(keyframe);
        }
        // The oldest one that counts began before what the ring holds, or with it.
        while self.configurations.get(1).is_some_and(|&(from, _)| from <= self.ring.first()) {
            self.configurations.pop_front();
        }
        self.noticed.extend(noticed);
        if let Some(snapshot) = snapshot {
            let changes = self.tracker.follow(&snapshot, &std::mem::take(&mut self.noticed));
            self.snapshot = snapshot;
            self.apply(changes);
        }
        now
    }

    fn apply(&mut self, changes: Vec<Change>) {
        for change in changes {
            match change {
                Change::Opened(open) => self.open(open),
                Change::Extended(open) => {
                    if let Some(job) = self.jobs.back_mut().filter(|job| job.end.is_none()) {
                        job.extend(open, &self.snapshot);
                    }
                }
                Change::Closed(open) => self.end(open),
            }
        }
    }

    fn open(&mut self, open: Open) {
        let before = |span: Span| open.since - span;
        let margins = self.settings.margins;
        let found = self.ring.keyframe_before(before(self.settings.past()));
        let Some((begin, at)) = found.filter(|_| self.jobs.len() < WAITING_MAX) else {
            if !std::mem::replace(&mut self.is_unrecorded, true) {
                tracing::error!(
                    "an incident is not recorded yet: {} others wait for the disk",
                    self.jobs.len()
                );
            }
            return;
        };
        self.is_unrecorded = false;
        let number = self.next_number;
        self.next_number += 1;
        self.jobs.push_back(Job {
            number,
            begin,
            shown_from: before(margins.before).max(at),
            end: None,
            configuration: self.configuration_at(begin),
            roots: Vec::new(),
            stage: self.snapshot.has_stages().then_some(self.snapshot.stage),
            freeze: freeze::first(&self.snapshot, &open).into_iter().map(|it| (open.since, it)).collect(),
            latched: self.ring.latched_before(begin),
            open,
        });
    }

    /// The configuration by which the engine judged at a place of the ring.
    fn configuration_at(&self, place: Position) -> Arc<[ConfigurationText]> {
        let counts = self.configurations.iter().rev().find(|(from, _)| *from <= place);
        counts.or(self.configurations.front()).map(|(_, texts)| texts.clone()).unwrap_or_default()
    }

    /// All that the ring holds from the first state of the engine on, as an incident without a trigger.
    pub fn everything(&self) -> Option<Job> {
        let (begin, since) = self.ring.keyframe_before(Timestamp::ZERO)?;
        let until = self.snapshot.now;
        Some(Job {
            number: 0,
            begin,
            shown_from: since,
            end: Some(self.ring.next()),
            configuration: self.configuration_at(begin),
            roots: Vec::new(),
            stage: self.snapshot.has_stages().then_some(self.snapshot.stage),
            freeze: Vec::new(),
            latched: self.ring.latched_before(begin),
            open: Open { since, until, triggers: Vec::new(), more: 0, storm: false },
        })
    }

    /// Writes an incident that is open after all, if the disk refused it before: the ring still has its beginning.
    pub fn take_up(&mut self) {
        if self.present().is_none()
            && let Some(open) = self.tracker.open().cloned()
        {
            self.open(open);
        }
    }

    fn end(&mut self, open: Open) {
        self.is_unrecorded = false;
        let (end, roots) = (self.ring.next(), roots(&self.snapshot, open.since));
        if let Some(job) = self.jobs.back_mut().filter(|job| job.end.is_none()) {
            (job.open, job.end, job.roots) = (open, Some(end), roots);
        }
    }

    /// The engine ended: the present incident ends with it.
    fn close(&mut self, now: Timestamp) {
        if let Some(mut open) = self.tracker.end() {
            open.until = now;
            self.end(open);
        }
    }
}
