//! Hands on what the engine took to the recorder's thread, in the engine's order, and never waits for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::time::Duration;

use super::noticed::{Noticed, Watch};
use super::ring::{ConfigurationText, KEYFRAME_EVERY};
use telltale_clock::Clock;
use telltale_engine::Engine;
use telltale_engine::event::Event;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::time::{Span, Timestamp};
use telltale_engine::view::record::Record;
use telltale_msg::received::Stamped;

/// Turns of the engine that may wait for the recorder. A full queue loses the newest turn, which is counted.
const TURNS_MAX: usize = 4096;

/// Bytes of their messages that may wait.
const WAITING_BYTES_MAX: usize = 32 << 20;

/// A new state follows a loss after this time: a copy of the engine costs time too.
const KEYFRAME_AFTER_LOSS: Span = Span::from_secs(1);

/// A copy of the engine is followed by this many times its own duration without one: of all changes of a state, at
/// most one in so many waits for a copy.
const KEYFRAME_REST: u64 = 250;

/// However long a copy takes, the next one follows within this time: a recording begins with one.
const KEYFRAME_EVERY_MAX: Span = Span::from_secs(60);

/// One turn of the engine: what it took, and what came of it.
#[derive(Debug, Default)]
pub struct Turn {
    /// Inputs before this turn that the recorder did not get.
    pub lost: u64,
    pub taken: Vec<Stamped>,
    /// Of its messages.
    bytes: usize,
    /// The configuration that counts after what was taken.
    pub reload: Option<(Timestamp, Arc<[ConfigurationText]>)>,
    pub records: Vec<Record>,
    pub noticed: Vec<Noticed>,
    pub snapshot: Option<Arc<Snapshot>>,
    /// The engine's whole state at the end of the turn.
    pub keyframe: Option<Arc<Engine>>,
}

/// The engine's end of the queue.
#[derive(Debug)]
pub struct Feed {
    queue: SyncSender<Turn>,
    turn: Turn,
    watch: Watch,
    clock: Clock,
    /// The time of the next keyframe.
    keyframe_at: Timestamp,
    recording: Arc<AtomicBool>,
    waiting_bytes: Arc<AtomicUsize>,
}

/// The recorder's end of the queue.
#[derive(Debug)]
pub struct Turns {
    queue: Receiver<Turn>,
    /// An incident is being recorded.
    pub(super) recording: Arc<AtomicBool>,
    waiting_bytes: Arc<AtomicUsize>,
}

impl Turns {
    /// The next turn, if it comes within this time.
    ///
    /// # Errors
    /// It does not, or the engine has ended.
    pub fn next(&self, within: Duration) -> Result<Turn, RecvTimeoutError> {
        let turn = self.queue.recv_timeout(within)?;
        self.waiting_bytes.fetch_sub(turn.bytes, Ordering::Relaxed);
        Ok(turn)
    }
}

impl Feed {
    /// A queue, and its other end for the recorder.
    pub fn new(clock: Clock) -> (Feed, Turns) {
        let (queue, turns) = sync_channel(TURNS_MAX);
        let recording = Arc::new(AtomicBool::new(false));
        let waiting_bytes = Arc::new(AtomicUsize::new(0));
        let feed = Feed {
            queue,
            turn: Turn::default(),
            watch: Watch::default(),
            clock,
            keyframe_at: Timestamp::ZERO,
            recording: recording.clone(),
            waiting_bytes: waiting_bytes.clone(),
        };
        (feed, Turns { queue: turns, recording, waiting_bytes })
    }

    /// An incident is being recorded.
    pub fn is_recording(&self) -> bool {
        self.recording.load(Ordering::Relaxed)
    }

    /// The engine took this.
    pub fn took(&mut self, stamped: Stamped) {
        let last = self.turn.taken.last().and_then(|last| last.message.as_ref());
        if let Some(message) = &stamped.message
            && !last.is_some_and(|last| Arc::ptr_eq(last, message))
        {
            self.turn.bytes += message.len();
        }
        self.turn.taken.push(stamped);
    }

    /// The engine runs by another configuration.
    pub fn reloaded(&mut self, at: Timestamp, texts: Arc<[ConfigurationText]>) {
        self.turn.reload = Some((at, texts));
        // The states before it belong to another configuration.
        self.keyframe_at = Timestamp::ZERO;
    }

    /// The changes, with the names of the present snapshot.
    pub fn happened(&mut self, events: &[Event], snapshot: &Snapshot) {
        for event in events {
            self.turn.noticed.extend(self.watch.take(event, snapshot));
        }
        self.turn.records.extend(events.iter().filter_map(|event| Record::of(event.clone(), snapshot)));
    }

    /// This is shown from now on.
    pub fn published(&mut self, snapshot: Arc<Snapshot>) {
        self.turn.snapshot = Some(snapshot);
    }

    /// Ends a turn. Events that the engine keeps must have been taken.
    pub fn end_turn(&mut self, engine: &Engine) {
        let now = engine.now();
        if now >= self.keyframe_at {
            let began = self.clock.now();
            self.turn.keyframe = Some(Arc::new(engine.clone()));
            self.keyframe_at = now + rest(self.clock.now().since(began));
        }
        let turn = std::mem::take(&mut self.turn);
        let bytes = turn.bytes;
        let waiting = self.waiting_bytes.fetch_add(bytes, Ordering::Relaxed);
        // One turn always finds its place, however large it is.
        let sent = match waiting > 0 && waiting + bytes > WAITING_BYTES_MAX {
            true => Err(TrySendError::Full(turn)),
            false => self.queue.try_send(turn),
        };
        match sent {
            Ok(()) => {}
            Err(TrySendError::Full(turn)) => {
                self.waiting_bytes.fetch_sub(bytes, Ordering::Relaxed);
                self.turn.lost = turn.lost + turn.taken.len() as u64;
                self.turn.reload = turn.reload;
                // With the next state, what was lost no longer matters.
                self.keyframe_at = now + KEYFRAME_AFTER_LOSS;
            }
            // The program ends.
            Err(TrySendError::Disconnected(_)) => {}
        }
    }
}

/// The time from a copy of the engine that took `cost` to the next one.
fn rest(cost: Span) -> Span {
    let rest = Span::from_nanos(cost.as_nanos().saturating_mul(KEYFRAME_REST));
    rest.clamp(KEYFRAME_EVERY, KEYFRAME_EVERY_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_engine::input::Input;
    use telltale_engine::model::{Model, Parts, StageModel};
    use telltale_msg::cdr::Endian;
    use telltale_msg::received::Message;

    #[test]
    fn copies_that_take_long_are_rare() {
        for (cost_ms, rest_ms) in [(0, 10_000), (3, 10_000), (40, 10_000), (100, 25_000), (5_000, 60_000)] {
            assert_eq!(rest(Span::from_millis(cost_ms)), Span::from_millis(rest_ms), "{cost_ms} ms");
        }
        assert_eq!(rest(Span::from_nanos(u64::MAX)), KEYFRAME_EVERY_MAX);
    }

    #[test]
    fn messages_that_wait_for_the_recorder_are_bounded_in_bytes() {
        let clock = Clock::start();
        let model = Arc::new(Model::new(Parts::empty("v", StageModel::None)).unwrap());
        let engine = Engine::begin(model, clock.now());
        let (mut feed, turns) = Feed::new(clock);
        let bytes = 1 << 20;
        for _ in 0..100 {
            let message = Message {
                topic: "/a".into(),
                type_name: "a/msg/A".into(),
                writer: [1; 16],
                sequence: 1,
                source: None,
                received: clock.wall(),
                body: Ok((vec![0; bytes].into(), Endian::Little)),
                left_out: 0,
                kept: false,
            };
            let message = Some(Arc::new(message));
            feed.took(Stamped { input: Input::Tick, received: clock.now(), message });
            feed.end_turn(&engine);
        }
        let waiting: Vec<Turn> = std::iter::from_fn(|| turns.next(Duration::ZERO).ok()).collect();
        assert_eq!(waiting.len(), WAITING_BYTES_MAX / bytes);
        feed.end_turn(&engine);
        assert_eq!(turns.next(Duration::ZERO).unwrap().lost, 100 - waiting.len() as u64, "they are counted");
    }
}
