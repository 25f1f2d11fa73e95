//! Hands on what the engine took to the recorder's thread, in the engine's order, and never waits for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use super::noticed::{Noticed, Watch};
use super::ring::{ConfigurationText, KEYFRAME_EVERY};
use crate::clock::Clock;
use crate::engine::Engine;
use crate::engine::event::Event;
use crate::engine::snapshot::Snapshot;
use crate::engine::time::{Span, Timestamp};
use crate::engine::view::record::Record;
use crate::msg::received::Stamped;

/// Turns of the engine that may wait for the recorder. A full queue loses the newest turn, which is counted.
const TURNS_MAX: usize = 4096;

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
}

/// The recorder's end of the queue.
#[derive(Debug)]
pub struct Turns {
    pub(super) queue: Receiver<Turn>,
    /// An incident is being recorded.
    pub(super) recording: Arc<AtomicBool>,
}

impl Feed {
    /// A queue, and its other end for the recorder.
    pub fn new(clock: Clock) -> (Feed, Turns) {
        let (queue, turns) = sync_channel(TURNS_MAX);
        let recording = Arc::new(AtomicBool::new(false));
        let (turn, keyframe_at) = (Turn::default(), Timestamp::ZERO);
        let feed =
            Feed { queue, turn, watch: Watch::default(), clock, keyframe_at, recording: recording.clone() };
        (feed, Turns { queue: turns, recording })
    }

    /// An incident is being recorded.
    pub fn is_recording(&self) -> bool {
        self.recording.load(Ordering::Relaxed)
    }

    /// The engine took this.
    pub fn took(&mut self, stamped: Stamped) {
        self.turn.taken.push(stamped);
    }

    /// The engine runs by another configuration.
    pub fn reloaded(&mut self, at: Timestamp, texts: Arc<[ConfigurationText]>) {
        self.turn.reload = Some((at, texts));
        // The states before it belong to another configuration.
        self.keyframe_at = Timestamp::ZERO;
    }

    /// What changed, with the names of the present snapshot.
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
        match self.queue.try_send(turn) {
            Ok(()) => {}
            Err(TrySendError::Full(turn)) => {
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

    #[test]
    fn copies_that_take_long_are_rare() {
        for (cost_ms, rest_ms) in [(0, 10_000), (3, 10_000), (40, 10_000), (100, 25_000), (5_000, 60_000)] {
            assert_eq!(rest(Span::from_millis(cost_ms)), Span::from_millis(rest_ms), "{cost_ms} ms");
        }
        assert_eq!(rest(Span::from_nanos(u64::MAX)), KEYFRAME_EVERY_MAX);
    }
}
