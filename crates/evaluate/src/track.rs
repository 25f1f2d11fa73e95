//! What an engine showed during a trial.

use std::sync::Arc;

use telltale_engine::Engine;
use telltale_engine::input::Input;
use telltale_engine::model::Model;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::time::Timestamp;

use super::machine::History;

/// Snapshots in order of time, each until the next one.
#[derive(Debug, Clone)]
pub struct Track(pub Vec<(u64, Arc<Snapshot>)>);

impl Track {
    pub fn at(&self, ms: u64) -> &Arc<Snapshot> {
        let after = self.0.partition_point(|(at, _)| *at <= ms);
        &self.0[after.max(1) - 1].1
    }
}

/// An engine after the beginning of a trial.
pub fn begun(model: Arc<Model>, beginning: &History) -> Engine {
    let mut engine = Engine::new(model, Timestamp::ZERO);
    for step in beginning {
        pass(&mut engine, &step.inputs, step.at);
    }
    engine
}

/// Milliseconds are those after the beginning.
pub fn track(begun: &Engine, history: &History) -> Track {
    let mut engine = begun.clone();
    let zero = engine.now();
    let mut seq = None;
    let mut track = Vec::new();
    for step in history {
        pass(&mut engine, &step.inputs, step.at);
        if seq != Some(engine.seq()) {
            seq = Some(engine.seq());
            track.push((step.at.since(zero).as_millis(), engine.snapshot()));
        }
    }
    Track(track)
}

fn pass(engine: &mut Engine, inputs: &[Input], now: Timestamp) {
    for input in inputs {
        engine.handle(input, now);
    }
    if engine.next_deadline().is_some_and(|deadline| deadline <= now) {
        engine.handle(&Input::Tick, now);
    }
}
