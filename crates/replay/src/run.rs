//! An engine that takes a recording step by step.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::bridge::Bridge;
use super::flows::Flows;
use super::gaps::Gaps;
use super::recording::{Facts, Recording, ReplayError};
use super::steps::{self, Loss, Notes, Step, Steps};
use super::{catch_up, unheard};
use telltale_engine::Engine;
use telltale_engine::event::Event;
use telltale_engine::input::Input;
use telltale_engine::keyframe::Keyframe;
use telltale_engine::model::{Model, Stage};
use telltale_engine::snapshot::Snapshot;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::fields::Definitions;
use telltale_record::ring::ConfigurationText;

/// Makes a model of a recorded configuration.
pub type Load = dyn Fn(&[ConfigurationText]) -> Result<Arc<Model>, ReplayError> + Send;

/// The longest time between two steps. A recorder takes one at least every second.
const STEP_MAX: Span = Span::from_secs(24 * 3600);

/// A recording with the engine that judges it.
pub struct Run {
    steps: Steps,
    model: Arc<Model>,
    /// For reloads; `None`: the recorded ones are left out.
    load: Option<Box<Load>>,
    /// A step that was read and is not taken yet.
    next: Option<Step>,
    /// The engine takes `model` before the next step.
    reload_at: Option<Timestamp>,
    /// `None` before the first step.
    engine: Option<Engine>,
    /// The stage in which an engine without a recorded state begins.
    stage: Option<Stage>,
    /// The configuration under which it was recorded, if it runs by another one.
    recorded: Option<Arc<Model>>,
    /// The topics that one reads.
    reads: BTreeSet<String>,
    /// The gaps so far.
    gaps: Gaps,
    /// Something is missing since the last recorded state.
    lacks: bool,
    /// Recorded states count at the beginning alone.
    has_own_states: bool,
}

/// A place in a run, to which one can go back.
#[derive(Clone)]
pub struct Mark {
    steps: steps::Mark,
    next: Option<Step>,
    model: Arc<Model>,
    reload_at: Option<Timestamp>,
    engine: Option<Engine>,
    gaps: Gaps,
    lacks: bool,
}

/// The effect of one step.
#[derive(Debug)]
pub struct Taken {
    pub at: Timestamp,
    /// The changes, in order.
    pub events: Vec<Event>,
    /// The picture after each instant at which something changed, the last one at `at`. Empty without events.
    pub snapshots: Vec<Arc<Snapshot>>,
}

impl Taken {
    /// The picture after an event of this step, with the node that it names.
    pub fn snapshot_of(&self, event: &Event) -> Option<&Arc<Snapshot>> {
        let first = self.snapshots.iter().find(|it| it.now >= event.at).or(self.snapshots.last())?;
        // Of several at one instant, only the last one surely has the nodes that came to be then.
        self.snapshots.iter().rfind(|it| it.now == first.now)
    }
}

impl Run {
    /// As it was judged when it was recorded.
    ///
    /// # Errors
    /// The recording has no configuration, or this version cannot read it.
    pub fn recorded(recording: Recording) -> Result<Run, ReplayError> {
        let facts = recording.facts();
        if !facts.has_journal {
            return Err(ReplayError::NoConfiguration);
        }
        let model = facts.recorded()?.model;
        let facts = facts.clone();
        let load = move |texts: &[ConfigurationText]| Ok(facts.load(texts)?.model);
        Ok(Run::recorded_by(recording, model, Box::new(load)))
    }

    /// As it was judged by this model, and after reloads by the models that `load` makes of their texts.
    pub fn recorded_by(recording: Recording, model: Arc<Model>, load: Box<Load>) -> Run {
        Run { load: Some(load), ..Run::new(Steps::recorded(recording), model) }
    }

    /// Judged by another configuration. An engine without a recorded state begins in `stage`, if one is given.
    ///
    /// # Errors
    /// The configuration reads fields that these definitions do not have.
    pub fn judged_by(
        recording: Recording,
        model: Arc<Model>,
        definitions: &Definitions,
        stage: Option<Stage>,
    ) -> Result<Run, ReplayError> {
        let recorded = recording.facts().recorded().ok().map(|loaded| loaded.model);
        Run::judged_anew(recording, model, recorded, definitions, stage)
    }

    /// The same for a recording by a known configuration.
    pub fn judged_anew(
        recording: Recording,
        model: Arc<Model>,
        recorded: Option<Arc<Model>>,
        definitions: &Definitions,
        stage: Option<Stage>,
    ) -> Result<Run, ReplayError> {
        let facts = recording.facts();
        let mut bridge = Bridge::new(&model, definitions, facts.has_journal)?;
        bridge.set_recorded(recorded.clone().filter(|_| facts.has_journal));
        let reads = recorded.as_ref().and_then(|model| Bridge::new(model, definitions, true).ok());
        let reads = reads.map(|bridge| bridge.unheard().into_iter().map(|it| it.topic).collect());
        let reads = reads.unwrap_or_default();
        let steps = Steps::judged_anew(recording, bridge);
        Ok(Run { recorded, reads, stage, has_own_states: true, ..Run::new(steps, model) })
    }

    fn new(steps: Steps, model: Arc<Model>) -> Run {
        Run {
            steps,
            model,
            load: None,
            next: None,
            reload_at: None,
            engine: None,
            stage: None,
            recorded: None,
            reads: BTreeSet::new(),
            gaps: Gaps::default(),
            lacks: false,
            has_own_states: false,
        }
    }

    /// Behind a gap it goes on with what is left, as a run by another configuration does.
    pub(super) fn leave_recorded_states(&mut self) {
        self.has_own_states = true;
    }

    /// Counts the messages from here on, until the counts are taken.
    pub(super) fn count_messages(&mut self) {
        self.steps.flows = Some(Flows::default());
    }

    pub(super) fn take_flows(&mut self) -> Flows {
        self.steps.flows.take().unwrap_or_default()
    }

    /// The present place.
    pub fn mark(&self) -> Mark {
        Mark {
            steps: self.steps.mark(),
            next: self.next.clone(),
            model: self.model.clone(),
            reload_at: self.reload_at,
            engine: self.engine.clone(),
            gaps: self.gaps.clone(),
            lacks: self.lacks,
        }
    }

    /// Goes back or forwards to a place.
    pub fn go_to(&mut self, mark: &Mark) {
        let Mark { steps, next, model, reload_at, engine, gaps, lacks } = mark.clone();
        self.steps.go_to(&steps);
        (self.next, self.model, self.reload_at, self.engine) = (next, model, reload_at, engine);
        (self.gaps, self.lacks) = (gaps, lacks);
    }

    pub fn facts(&self) -> &Facts {
        &self.steps.facts
    }

    /// The unusable parts so far.
    pub fn notes(&self) -> &Notes {
        &self.steps.notes
    }

    /// The gaps so far.
    pub fn gaps(&self) -> &Gaps {
        &self.gaps
    }

    /// The unusable parts of the files so far, in sentences; and the number of further ones.
    pub fn omissions(&self) -> (Vec<String>, u64) {
        self.steps.reader().omissions()
    }

    /// Topics of the configuration without any message in the recording so far, in sentences.
    pub fn unheard(&self) -> Vec<String> {
        let unheard: Vec<_> = self.steps.unheard().into_iter().collect();
        unheard::sentences(&unheard, &self.steps.unread())
    }

    /// The same, without those that the recorded configuration reads too: they were silent.
    pub fn unheard_anew(&self) -> Vec<String> {
        let unheard = self.steps.unheard().into_iter().filter(|it| !self.reads.contains(&it.topic));
        unheard::sentences(&unheard.collect::<Vec<_>>(), &self.steps.unread())
    }

    /// These topics by their names.
    pub fn unheard_topics(&self) -> Vec<String> {
        let unheard = self.steps.unheard().into_iter().map(|it| it.topic);
        unheard.filter(|topic| !self.reads.contains(topic)).collect()
    }

    /// The engine, which has taken all steps so far.
    pub fn engine(&mut self) -> Option<&mut Engine> {
        self.engine.as_mut()
    }

    /// Takes the next step; `None` at the end.
    ///
    /// # Errors
    /// The vehicle took a configuration that this version cannot read.
    pub fn step(&mut self) -> Result<Option<Taken>, ReplayError> {
        self.step_until(Timestamp::from_nanos(u64::MAX))
    }

    /// The same; `None` too if the next step is later than `until`.
    pub fn step_until(&mut self, until: Timestamp) -> Result<Option<Taken>, ReplayError> {
        if let Some(at) = self.reload_at.take() {
            return Ok(Some(self.reload(at)));
        }
        while let Some(step) = self.next.take().or_else(|| self.steps.next(&self.model)) {
            match step {
                Step::Input { at, .. } | Step::Reload { at, .. } if self.is_far_ahead(at) => {
                    self.steps
                        .notes
                        .say("a step more than a day after the one before is left out".to_owned());
                }
                Step::Input { at, .. } | Step::Reload { at, .. } if at > until => {
                    self.next = Some(step);
                    return Ok(None);
                }
                Step::Input { at, input } => return Ok(Some(self.take(at, &input))),
                Step::Reload { at, texts } => {
                    let Some(load) = &self.load else { continue };
                    let model = load(&texts)?;
                    // Deadlines up to then act under the old configuration: their events name its nodes.
                    let before = self.take(at, &Input::Tick);
                    self.model = model;
                    if before.events.is_empty() {
                        return Ok(Some(self.reload(at)));
                    }
                    self.reload_at = Some(at);
                    return Ok(Some(before));
                }
                Step::State(state) if self.engine.is_some() && self.lacks && state.at() > until => {
                    self.next = Some(Step::State(state));
                    return Ok(None);
                }
                Step::State(state) => {
                    if let Some(taken) = self.state(&state) {
                        return Ok(Some(taken));
                    }
                }
                Step::Lost(Loss { from, to, is_damage }) => {
                    let last = self.engine.as_ref().map_or(Timestamp::ZERO, Engine::now);
                    self.gaps.lose(from.unwrap_or(last), to, is_damage);
                    self.lacks = true;
                }
            }
        }
        Ok(None)
    }

    /// An engine acts on every deadline up to a step: a damaged time would keep it busy without end.
    fn is_far_ahead(&self, at: Timestamp) -> bool {
        self.engine.as_ref().is_some_and(|engine| at.since(engine.now()) > STEP_MAX)
    }

    /// Takes a recorded state at the beginning, and where something is missing before it. Returns what it changed.
    fn state(&mut self, state: &Keyframe) -> Option<Taken> {
        if self.engine.is_some() && !self.lacks {
            return None;
        }
        let by = self.recorded.as_ref().unwrap_or(&self.model);
        let mut engine = match Engine::from_keyframe(by.clone(), state) {
            Ok(engine) => engine,
            Err(error) => {
                self.steps.notes.say(format!("a recorded state of the engine is left out: {error}"));
                return None;
            }
        };
        if self.recorded.as_ref().is_some_and(|recorded| **recorded != *self.model) {
            engine.reload(self.model.clone(), state.at());
        }
        engine.keep_events();
        // Earlier events were told before.
        engine.take_events();
        self.lacks = false;
        if self.engine.is_some() && self.has_own_states {
            return None;
        }
        self.gaps.catch_up(state.at());
        let after = engine.snapshot();
        let before = self.engine.replace(engine)?.snapshot();
        let events = catch_up::changes(&before, &after);
        let snapshots = if events.is_empty() { Vec::new() } else { vec![after] };
        Some(Taken { at: state.at(), events, snapshots })
    }

    fn begun(&mut self, at: Timestamp) -> &mut Engine {
        let (model, stage, has_journal) = (&self.model, self.stage, self.steps.facts.has_journal);
        self.engine.get_or_insert_with(|| {
            let mut engine = Engine::begin(model.clone(), at);
            if !has_journal {
                engine.leave_self_out();
            }
            if let Some(stage) = stage {
                engine.start_in(stage);
            }
            engine.keep_events();
            engine
        })
    }

    fn take(&mut self, at: Timestamp, input: &Input) -> Taken {
        self.gaps.go_on(at);
        let engine = self.begun(at);
        let (mut seq, mut snapshots) = (engine.seq(), Vec::new());
        let mut look = |engine: &mut Engine| {
            if engine.seq() != seq {
                seq = engine.seq();
                snapshots.push(engine.snapshot());
            }
        };
        // The engine does the same by itself. This shows each instant.
        while let Some(due) = engine.next_deadline().filter(|due| *due < at) {
            engine.handle(&Input::Tick, due);
            look(engine);
        }
        engine.handle(input, at);
        look(engine);
        taken(engine, at, snapshots)
    }

    fn reload(&mut self, at: Timestamp) -> Taken {
        let model = self.model.clone();
        let engine = self.begun(at);
        engine.reload(model, at);
        taken(engine, at, Vec::new())
    }
}

fn taken(engine: &mut Engine, at: Timestamp, mut snapshots: Vec<Arc<Snapshot>>) -> Taken {
    let events = engine.take_events();
    if !events.is_empty() && snapshots.last().is_none_or(|last| last.seq != engine.seq()) {
        snapshots.push(engine.snapshot());
    }
    Taken { at, events, snapshots }
}
