//! The picture of one configuration over a recording: every node, the stage, the alarms and the requests, and how much
//! of each.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Serialize;

use super::{ReplayError, Run, Taken};
use telltale_engine::event::EventKind;
use telltale_engine::model::NodeId;
use telltale_engine::model::countermeasure::RequestKind;
use telltale_engine::model::wording::Urgency;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::state::State;
use telltale_engine::time::Timestamp;
use telltale_engine::view::record::{Record, Recorded};

/// Changes that are kept of one side. What comes after them is counted, and not compared.
const CHANGES_MAX: usize = 200_000;

/// Alarms whose nodes are kept.
const ALARMS_MAX: usize = 10_000;

/// The state of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shown {
    pub state: State,
    /// Its state as if nothing were masked.
    pub own: State,
    /// The root cause that masks it.
    pub cause: Option<Arc<str>>,
}

impl Shown {
    /// It looks as if it were not there.
    pub fn is_quiet(&self) -> bool {
        self.state == State::Ok || (self.state == State::Ignore && self.cause.is_none())
    }
}

/// The state of the vehicle as a whole.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Whole {
    pub stage: &'static str,
    /// With their figures, strongest first.
    pub requests: Vec<String>,
    /// The nodes with an active alarm.
    pub alarms: Vec<Arc<str>>,
    /// The urgency of the instruction, if faults have any.
    pub asked: Option<Urgency>,
}

/// How much one side shows, from the first instant that is shown on.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Totals {
    /// Alarms that were raised. One that moves to its cause counts once.
    pub alarms: u64,
    /// Nodes that were ignored because of a root cause, each once.
    pub masked: u64,
    /// Requests to the vehicle that were made.
    pub countermeasures: u64,
    /// Changes of what a node shows.
    pub transitions: u64,
    /// Seconds from the first symptom of both sides to the root cause of the first alarm.
    pub to_root_s: Option<f64>,
}

/// The instants of the counted alarms, masked nodes, requests and transitions.
#[derive(Debug, Default)]
pub(super) struct Counts {
    alarms: Vec<Timestamp>,
    /// The last instant of each node that was ignored because of a root cause.
    masked: Vec<Timestamp>,
    requests: Vec<Timestamp>,
    transitions: Vec<Timestamp>,
}

impl Counts {
    /// How much was shown from an instant on, without the time to the root cause.
    pub fn since(&self, since: Timestamp) -> Totals {
        let count = |all: &[Timestamp]| all.iter().filter(|at| **at >= since).count() as u64;
        Totals {
            alarms: count(&self.alarms),
            masked: count(&self.masked),
            countermeasures: count(&self.requests),
            transitions: count(&self.transitions),
            to_root_s: None,
        }
    }
}

/// Values with the instants from which they hold, in order, each unlike the one before.
pub(super) type Changes<T> = Vec<(Timestamp, T)>;

#[derive(Debug, Default)]
pub(super) struct Trace {
    /// By name; `None` while a node is not there.
    pub nodes: BTreeMap<Arc<str>, Changes<Option<Shown>>>,
    pub whole: Changes<Whole>,
    /// The first change of a module for the worse.
    pub symptom: Option<Timestamp>,
    /// When the first alarm belonged to its root cause.
    pub root: Option<Timestamp>,
    pub to: Timestamp,
    /// Later changes were not kept.
    pub cut: Option<Timestamp>,
    from: Timestamp,
    /// The alarms that were raised: their numbers and nodes.
    alarms: Vec<(u64, Arc<str>)>,
    requests: Vec<RequestKind>,
    counts: Counts,
    kept: usize,
}

impl Trace {
    /// Runs a recording to its end, as long as `go_on` says so.
    ///
    /// # Errors
    /// It holds nothing, has a configuration that this version cannot read, or was stopped.
    pub fn of(run: &mut Run, go_on: &dyn Fn() -> bool) -> Result<Trace, ReplayError> {
        let from = run.facts().from;
        let mut trace = Trace { from, ..Trace::default() };
        let mut is_begun = false;
        while let Some(taken) = run.step()? {
            if !go_on() {
                return Err(ReplayError::Stopped);
            }
            let is_reloaded = taken.events.iter().any(|event| event.what == EventKind::Reloaded);
            // Without a reload, the events tell everything; behind a gap, a recorded state takes over without any.
            let lacks = !run.gaps().is_empty();
            trace.take(&taken);
            if (!is_begun || is_reloaded || lacks)
                && let Some(engine) = run.engine()
            {
                trace.present(taken.at, &engine.snapshot());
                is_begun = true;
            }
        }
        if !is_begun {
            return Err(ReplayError::Empty);
        }
        trace.to = trace.to.max(from);
        trace.count_changes();
        Ok(trace)
    }

    fn count_changes(&mut self) {
        let is_masked = |shown: &Option<Shown>| shown.as_ref().is_some_and(|shown| shown.cause.is_some());
        // A reload tells every node anew, so its events are not counted.
        let state = |(_, shown): &(Timestamp, Option<Shown>)| shown.as_ref().map(|shown| shown.state);
        for changes in self.nodes.values() {
            self.counts.masked.extend(changes.iter().rev().find(|(_, it)| is_masked(it)).map(|(at, _)| *at));
            let others = changes.windows(2).filter(|pair| match (state(&pair[0]), state(&pair[1])) {
                (Some(before), Some(after)) => before != after,
                _ => false,
            });
            self.counts.transitions.extend(others.map(|pair| pair[1].0));
        }
    }

    /// The instants of all that is counted.
    pub fn take_counts(&mut self) -> Counts {
        std::mem::take(&mut self.counts)
    }

    /// The nodes of the alarms that were raised and that the other side lacks, each as often.
    pub fn alarms_beyond(&self, other: &Trace) -> Vec<Arc<str>> {
        let mut others: Vec<&Arc<str>> = other.alarms.iter().map(|(_, node)| node).collect();
        let mut beyond: Vec<Arc<str>> = Vec::new();
        for (_, node) in &self.alarms {
            match others.iter().position(|it| *it == node) {
                Some(index) => drop(others.swap_remove(index)),
                None => beyond.push(node.clone()),
            }
        }
        beyond.sort_unstable();
        beyond
    }

    fn take(&mut self, taken: &Taken) {
        self.to = taken.at;
        for snapshot in &taken.snapshots {
            self.whole(snapshot);
        }
        for event in &taken.events {
            let is_shown = event.at >= self.from;
            if is_shown && matches!(event.what, EventKind::AlarmRaised { .. }) {
                note(&mut self.counts.alarms, event.at, 1);
            }
            let Some(snapshot) = taken.snapshot_of(event) else { continue };
            match Record::of(event.clone(), snapshot).map(|record| record.what) {
                Some(Recorded::Shown { node, state, own, cause, .. }) => {
                    let is_module = matches!(event.what, EventKind::Shown { node: NodeId::Module(_), .. });
                    if self.symptom.is_none() && is_shown && is_module && self.fails(&node, own) {
                        self.symptom = Some(event.at);
                    }
                    self.node(event.at, node, Some(Shown { state, own, cause }));
                }
                Some(Recorded::AlarmRaised { id, node }) if is_shown && self.alarms.len() < ALARMS_MAX => {
                    self.root = self.root.or(Some(event.at));
                    self.alarms.push((id, node));
                }
                Some(Recorded::AlarmMoved { id, cause, .. }) => {
                    if let Some(index) = self.alarms.iter().position(|(of, _)| *of == id) {
                        self.root = self.root.filter(|_| index > 0).or(Some(event.at));
                        self.alarms[index].1 = cause;
                    }
                }
                Some(Recorded::Left { node }) => self.node(event.at, node, None),
                _ => {}
            }
        }
    }

    /// Whether the own state of a node becomes one that is not OK.
    fn fails(&self, node: &str, own: State) -> bool {
        let before = self.nodes.get(node).and_then(|changes| changes.last()?.1.as_ref()).map(|it| it.own);
        matches!(own, State::Warning | State::Error | State::Unknown) && before != Some(own)
    }

    /// Takes everything as it is now.
    fn present(&mut self, at: Timestamp, snapshot: &Arc<Snapshot>) {
        self.whole(snapshot);
        let mut there: BTreeMap<Arc<str>, Shown> = BTreeMap::new();
        for record in Record::present(snapshot, true) {
            if let Recorded::Shown { node, state, own, cause, .. } = record.what {
                there.insert(node, Shown { state, own, cause });
            }
        }
        let gone: Vec<Arc<str>> =
            self.nodes.keys().filter(|name| !there.contains_key(*name)).cloned().collect();
        gone.into_iter().for_each(|name| self.node(at, name, None));
        there.into_iter().for_each(|(name, shown)| self.node(at, name, Some(shown)));
    }

    fn node(&mut self, at: Timestamp, name: Arc<str>, shown: Option<Shown>) {
        if self.cut.is_none() {
            let changes = self.nodes.entry(name).or_default();
            if changes.is_empty() && shown.is_none() {
                return;
            }
            self.kept += usize::from(push(changes, at.max(self.from), shown));
            self.cut = (self.kept > CHANGES_MAX).then_some(at);
        }
    }

    fn whole(&mut self, snapshot: &Snapshot) {
        let kinds: Vec<RequestKind> = snapshot.countermeasures.iter().map(|it| it.request.kind()).collect();
        let new = kinds.iter().filter(|kind| !self.requests.contains(kind)).count();
        if snapshot.now >= self.from && !self.whole.is_empty() {
            note(&mut self.counts.requests, snapshot.now, new);
        }
        self.requests = kinds;
        if self.cut.is_none() {
            let request = |it: &telltale_engine::snapshot::Countermeasure| match it.request.mps2() {
                Some(mps2) => format!("{} {mps2} m/s\u{b2}", it.request.as_str()),
                None => it.request.as_str().to_owned(),
            };
            let active = snapshot.alarms.iter().filter(|alarm| alarm.active);
            let mut alarms: Vec<Arc<str>> =
                active.map(|alarm| snapshot.node_name(alarm.node).clone()).collect();
            alarms.sort_unstable();
            let requests = snapshot.countermeasures.iter().map(request).collect();
            let asked = snapshot.asked.map(|it| it.urgency);
            let whole = Whole { stage: snapshot.stage.as_str(), requests, alarms, asked };
            self.kept += usize::from(push(&mut self.whole, snapshot.now.max(self.from), whole));
        }
    }
}

/// Adds so many events of one instant.
fn note(all: &mut Vec<Timestamp>, at: Timestamp, count: usize) {
    let room = CHANGES_MAX.saturating_sub(all.len());
    all.extend(std::iter::repeat_n(at, count.min(room)));
}

/// Adds a value that holds from this instant on. Of several at one instant the last one counts. Returns whether one
/// more is kept.
fn push<T: PartialEq>(changes: &mut Changes<T>, at: Timestamp, value: T) -> bool {
    let before = changes.len();
    if changes.last().is_some_and(|(last, _)| *last == at) {
        changes.pop();
    }
    if changes.last().is_none_or(|(_, last)| *last != value) {
        changes.push((at, value));
    }
    changes.len() > before
}
