//! Sends records of events to a history, and never waits for it.

use std::sync::mpsc::{SyncSender, TrySendError};

use telltale_engine::Engine;
use telltale_engine::event::Event;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::time::{Span, Timestamp};
use telltale_engine::view::record::{Record, Recorded};

/// Records wait this long for others, so that they are written together.
const EVERY: Span = Span::from_millis(100);
/// A full batch does not wait.
const BATCH: usize = 512;

/// The events that were not handed on yet. A full queue loses a whole batch; the number of its records
/// stands in the next batch that the queue takes.
pub struct Recorder {
    /// `None` if there is no history, or its reader is gone.
    queue: Option<SyncSender<Vec<Record>>>,
    waiting: Vec<Record>,
    handed_on: Timestamp,
    lost: u64,
}

impl Recorder {
    pub fn start(engine: &mut Engine, queue: Option<SyncSender<Vec<Record>>>, now: Timestamp) -> Recorder {
        let mut recorder = Recorder { queue, waiting: Vec::new(), handed_on: now, lost: 0 };
        if recorder.queue.is_some() {
            recorder.begin(engine, false);
        }
        recorder
    }

    /// Records the whole state: the engine started, or runs with another configuration.
    pub fn begin(&mut self, engine: &mut Engine, anew: bool) {
        if self.queue.is_some() {
            self.waiting.extend(Record::present(&engine.snapshot(), anew));
        }
    }

    /// Records events, with the names of this snapshot.
    pub fn take(&mut self, events: Vec<Event>, snapshot: &Snapshot) {
        if self.queue.is_some() {
            self.waiting.extend(events.into_iter().filter_map(|event| Record::of(event, snapshot)));
        }
    }

    /// Sends a batch if one is due.
    pub fn hand_on_if_due(&mut self, now: Timestamp) {
        let is_due = self.waiting.len() >= BATCH || now.since(self.handed_on) >= EVERY;
        if is_due && !self.waiting.is_empty() {
            self.handed_on = now;
            self.hand_on(now);
        }
    }

    /// Sends what still waits: nothing follows.
    pub fn hand_on_rest(&mut self, now: Timestamp) {
        if !self.waiting.is_empty() {
            self.hand_on(now);
        }
    }

    fn hand_on(&mut self, now: Timestamp) {
        let Some(queue) = &self.queue else { return self.waiting.clear() };
        let mut batch = std::mem::take(&mut self.waiting);
        if self.lost > 0 {
            batch.insert(0, Record { at: now, what: Recorded::Lost(self.lost) });
        }
        let dropped = batch.len() as u64 - u64::from(self.lost > 0);
        match queue.try_send(batch) {
            Ok(()) => self.lost = 0,
            Err(TrySendError::Full(_)) => self.lost += dropped,
            Err(TrySendError::Disconnected(_)) => self.queue = None,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::mpsc::sync_channel;

    use super::*;
    use telltale_engine::input::{Input, OperatorAction};
    use telltale_engine::model::{Model, Parts, Stage, StageModel};

    fn engine() -> Engine {
        let parts = Parts::empty("v", StageModel::Shuttle);
        Engine::new(Arc::new(Model::new(parts).unwrap()), Timestamp::ZERO)
    }

    #[test]
    fn a_full_queue_loses_records_counts_them_and_holds_nobody_up() {
        let (queue, records) = sync_channel(1);
        let mut engine = engine();
        engine.keep_events();
        let mut recorder = Recorder::start(&mut engine, Some(queue), Timestamp::ZERO);
        let at = Timestamp::from_millis;
        let mut follow = |engine: &mut Engine, at| {
            let (events, snapshot) = (engine.take_events(), engine.snapshot());
            recorder.take(events, &snapshot);
            recorder.hand_on_if_due(at);
        };
        follow(&mut engine, at(50));
        assert!(records.try_recv().is_err(), "it waits for others");
        follow(&mut engine, at(100));
        for ms in [200, 300] {
            let action =
                if ms == 200 { OperatorAction::Login { name: "a".into() } } else { OperatorAction::Logout };
            engine.handle(&Input::Operator(action), at(ms));
            follow(&mut engine, at(ms));
        }
        let first = records.try_recv().unwrap();
        assert_eq!(first[0].what, Recorded::Started { anew: false });
        assert_eq!(first[1].what, Recorded::Stage(Stage::Locked));
        assert!(
            first.iter().any(|it| matches!(&it.what, Recorded::Shown { node, .. } if &**node == "telltale"))
        );
        assert!(records.try_recv().is_err(), "the queue was full");
        engine.handle(&Input::Operator(OperatorAction::Login { name: "a".into() }), at(400));
        follow(&mut engine, at(400));
        let next = records.try_recv().unwrap();
        assert!(matches!(next[0].what, Recorded::Lost(lost) if lost >= 2), "{next:?}");
        drop(records);
        engine.handle(&Input::Operator(OperatorAction::Logout), at(500));
        follow(&mut engine, at(500));
    }
}
