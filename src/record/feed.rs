//! Hands on what the engine took to the recorder's thread, in the engine's order, and never waits for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use super::incident::warning;
use super::ring::{ConfigurationText, KEYFRAME_EVERY};
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

/// One turn of the engine: what it took, and what came of it.
#[derive(Debug, Default)]
pub struct Turn {
    /// Inputs before this turn that the recorder did not get.
    pub lost: u64,
    pub taken: Vec<Stamped>,
    /// The configuration that counts after what was taken.
    pub reload: Option<(Timestamp, Arc<[ConfigurationText]>)>,
    pub records: Vec<Record>,
    /// Modules that came to show a WARNING.
    pub warnings: Vec<Arc<str>>,
    pub snapshot: Option<Arc<Snapshot>>,
    /// The engine's whole state at the end of the turn.
    pub keyframe: Option<Arc<Engine>>,
}

/// The engine's end of the queue.
#[derive(Debug)]
pub struct Feed {
    queue: SyncSender<Turn>,
    turn: Turn,
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
    pub fn new() -> (Feed, Turns) {
        let (queue, turns) = sync_channel(TURNS_MAX);
        let recording = Arc::new(AtomicBool::new(false));
        let feed =
            Feed { queue, turn: Turn::default(), keyframe_at: Timestamp::ZERO, recording: recording.clone() };
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
        self.turn.warnings.extend(events.iter().filter_map(|event| warning(event, snapshot)));
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
            self.turn.keyframe = Some(Arc::new(engine.clone()));
            self.keyframe_at = now + KEYFRAME_EVERY;
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
