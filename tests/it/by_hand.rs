//! A vehicle that a test drives by hand: an engine, and a time that passes with each input.

use std::sync::Arc;

use telltale::config;
use telltale::engine::Engine;
use telltale::engine::input::{Input, OperatorAction, Response, StatusArray};
use telltale::engine::model::{Model, Stage};
use telltale::engine::snapshot::{Alarm, Snapshot};
use telltale::engine::time::{Span, Timestamp};

/// The model of a configuration without mistakes.
pub fn model(text: &str) -> Arc<Model> {
    config::parse("c", text).unwrap_or_else(|problems| panic!("{problems}")).model
}

/// What `telltale check` warns of in it.
pub fn warnings(text: &str) -> Vec<String> {
    let loaded = config::parse("c", text).unwrap_or_else(|problems| panic!("{problems}"));
    loaded.soundness().1.map_or_else(Vec::new, |problems| problems.lines())
}

/// One array of statuses with these names and levels.
pub fn said(levels: &[(&str, u8)]) -> Input {
    let mut array = StatusArray::default();
    levels.iter().for_each(|(name, level)| array.push_status(*level, name, "said", ""));
    Input::Diagnostics(array)
}

/// Numbers and nodes of all alarms that are kept, with whether each is active.
pub fn alarms(snapshot: &Snapshot) -> Vec<(u64, String, bool)> {
    let alarm = |it: &Alarm| (it.id, snapshot.node_name(it.node).to_string(), it.active);
    snapshot.alarms.iter().map(alarm).collect()
}

pub struct Vehicle {
    pub model: Arc<Model>,
    pub engine: Engine,
    pub now: Timestamp,
}

impl Vehicle {
    pub fn of(text: &str, stage: Stage) -> Vehicle {
        let model = model(text);
        let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
        engine.start_in(stage);
        Vehicle { model, engine, now: Timestamp::ZERO }
    }

    pub fn input(&mut self, input: &Input) -> Response {
        self.now = self.now + Span::from_millis(1);
        self.engine.handle(input, self.now)
    }

    pub fn report(&mut self, levels: &[(&str, u8)]) {
        self.input(&said(levels));
    }

    pub fn signal(&mut self, name: &str, value: bool) {
        self.input(&Input::Signal { name: name.into(), value });
    }

    pub fn does(&mut self, action: OperatorAction) -> Response {
        self.input(&Input::Operator(action))
    }

    /// Both steps, which get the same answer.
    pub fn release(&mut self) -> Response {
        let (display_live, storage_ok) = (true, true);
        let asked = self.does(OperatorAction::AskRelease { display_live, storage_ok });
        let done = self.does(OperatorAction::Release { display_live, storage_ok });
        assert_eq!(asked, done);
        done
    }

    /// Nothing is said for so long.
    pub fn pass(&mut self, time: Span) {
        self.now = self.now + time;
        self.engine.handle(&Input::Tick, self.now);
    }

    /// The program ends and starts again with its stored state.
    pub fn restart(&mut self, text: &str) {
        self.model = model(text);
        self.engine = Engine::resume(self.model.clone(), &self.look().to_restore(), self.now);
    }

    pub fn reload(&mut self, text: &str) {
        self.model = model(text);
        self.engine.reload(self.model.clone(), self.now);
    }

    pub fn look(&mut self) -> Arc<Snapshot> {
        self.engine.snapshot()
    }
}
