//! Transitions of the stage that follow from the vehicle's state, and their effect on requests.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

use super::machine::StageEvent;
use crate::Engine;
use crate::event::EventKind;
use crate::input::{OutputReport, Refusal};
use crate::model::output::Output;
use crate::model::wording::Urgency;
use crate::model::{GroupId, LOCALIZATION_GROUP, Model, NodeId, Stage, StageModel};
use crate::module::system::{self, SystemCheck};
use crate::signals::driving_word::ARRIVAL;
use crate::snapshot::{Asked, Countermeasure, KnownPlace, Localization, Shelved, Unreached};
use crate::state::State;
use crate::text::Text;
use crate::text::say;
use crate::time::{Span, Timestamp};
use crate::timers::TimerKey;

/// A localization that takes longer does not find the vehicle where it is said to be.
const LOCALIZES_WITHIN: Span = Span::from_secs(10);

/// The last reports of Telltale's own modules about the vehicle.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct VehicleFaults {
    /// `None` while a component reports whether the vehicle drives, or need not.
    active_unknown: Option<State>,
    contradicts_itself: bool,
    countermeasures: Option<Text>,
    outputs: Option<Text>,
    unheard: Option<Text>,
    other_voices: Option<Text>,
}

/// The part of the snapshot about stages, requests and outputs.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct VehicleView {
    pub(crate) last_alarm: u64,
    pub(crate) asking: Arc<[(NodeId, Urgency)]>,
    pub(crate) asked: Option<Asked>,
    pub(crate) accepted: Arc<BTreeMap<NodeId, Option<Timestamp>>>,
    pub(crate) shelved: Arc<[Shelved]>,
    pub(crate) countermeasures: Arc<[Countermeasure]>,
    pub(crate) localization: Localization,
    pub(crate) clearance: bool,
    pub(crate) hold: Option<bool>,
    pub(crate) last_stop: u64,
    pub(crate) may_set_off: bool,
    pub(crate) clearance_refusals: Arc<[Refusal]>,
    pub(crate) release_refusals: Arc<[Refusal]>,
    pub(crate) unreached: Arc<[(Output, Unreached)]>,
    pub(crate) listened: Arc<[Output]>,
}

impl Engine {
    /// Raises an event; the stage changes if the table has a row for it.
    pub(crate) fn step(&mut self, event: StageEvent) -> bool {
        let from = self.vehicle.stage;
        if !self.vehicle.raise(event) {
            return false;
        }
        let to = self.vehicle.stage;
        self.events.push(self.now, EventKind::Stage { from, to });
        if matches!(from, Stage::Active | Stage::Cleared) {
            // A vehicle that was cleared may have set off already.
            self.countermeasures.arrives = Some(self.now + ARRIVAL);
        }
        if to == Stage::Active {
            self.motion.set_off();
        }
        let is_at_a_stop = match from {
            Stage::Active => !self.is_between_stops(),
            // The operator chose a stop; the vehicle may be far from it.
            _ => event == StageEvent::Localized && self.is_seen_at_a_stop() != Some(false),
        };
        if is_at_a_stop {
            self.motion.park(self.now);
        }
        if from == Stage::Active {
            self.arrived();
        }
        self.countermeasures.knows_all |= event == StageEvent::Clearance;
        self.stage_changed();
        true
    }

    /// Marks everything that depends on the stage.
    pub(crate) fn stage_changed(&mut self) {
        self.vehicle_changed = true;
        self.countermeasures.mark_all();
        self.signals.posed = self.vehicle.posed();
        self.net.mark_conditions(self.vehicle.stage);
    }

    /// The operator gave a pose.
    pub(crate) fn set_posed(&mut self) {
        self.vehicle_changed = true;
        self.signals.posed = self.vehicle.posed();
        self.net.mark_conditions(self.vehicle.stage);
    }

    /// The goal is used up: the next drive needs its own.
    fn arrived(&mut self) {
        // A drive that was asked to slow down or to stop may have ended anywhere.
        let is_asked = self.countermeasures.moving().next().is_some();
        let stop = self.motion.shown().destination.map(|index| &self.model.driving.stops[index]);
        if let Some(stop) = stop.filter(|_| !is_asked) {
            self.vehicle.localization.last_known = Some(KnownPlace { pose: stop.into(), driven: true });
        }
        self.forget_destination();
        let Some(goal) = self.goal_signal else { return };
        if self.signals.forget(goal) {
            self.events.push(self.now, EventKind::Signal { index: goal, value: self.signals.value(goal) });
            self.views.set_signals(&self.signals);
        }
    }

    /// Takes the signal that the vehicle drives. An unknown value changes no stage.
    pub(crate) fn take_active(&mut self, value: Option<bool>) {
        match value {
            Some(true) => self.step(StageEvent::ActiveTrue),
            Some(false) => self.step(StageEvent::ActiveFalse),
            None => false,
        };
        self.vehicle_changed = true;
    }

    /// Takes the other programs that speak to the vehicle; `None`: there are none.
    pub(crate) fn take_voices(&mut self, other: Option<&str>) {
        self.countermeasures.other_voices = other.map(Box::from);
        self.vehicle_changed = true;
    }

    /// Takes whether an output could be sent.
    pub(crate) fn take_output(&mut self, news: &OutputReport) {
        self.countermeasures.take_news(news);
        self.vehicle_changed = true;
    }

    /// Advances localization, countermeasures and stage to the present states. Returns whether that changes
    /// states in turn.
    pub(crate) fn follow_vehicle(&mut self) -> bool {
        self.follow_localization();
        if !self.countermeasures.is_idle() {
            self.vehicle_changed = true;
            self.follow_measures();
        }
        if self.vehicle.stage == Stage::Cleared {
            if !self.has_goal() {
                self.step(StageEvent::GoalGone);
            } else if self.countermeasures.moving().next().is_some() {
                self.step(StageEvent::Countermeasure);
            }
        }
        if self.vehicle_changed {
            let (net, names, signals) = (&self.net, &self.names, &self.signals);
            if let Some(due) = self.countermeasures.confirm(&self.model, net, names, signals, self.now) {
                self.timers.arm(TimerKey::Countermeasures, due);
            }
            self.report_on_vehicle();
        }
        !self.net.is_settled()
    }

    /// The vehicle's own report whether it drives.
    pub(crate) fn says_it_drives(&self) -> Option<bool> {
        self.active_signal.and_then(|index| self.signals.value(index))
    }

    /// Whether the vehicle is known to stand at a stop: the signal `active` is false, it has no clearance, and it
    /// does not roll. Without such a signal nothing tells a stop from a halt on the way.
    pub(crate) fn stands_at_a_stop(&self) -> bool {
        self.vehicle.model == StageModel::Shuttle
            && !matches!(self.vehicle.stage, Stage::Cleared | Stage::Active)
            && self.says_it_drives() == Some(false)
            && !self.motion.shown().may_move()
    }

    /// Whether a vehicle with stages may set off though nothing says that it drives: there is no word on `active` and no source
    /// of its speed, or it is somewhere between stops.
    pub(crate) fn may_set_off(&self) -> bool {
        let is_silent = self.says_it_drives().is_none() && self.model.driving.speed.is_none();
        self.vehicle.model == StageModel::Shuttle && (is_silent || self.motion.is_astray())
    }

    fn follow_localization(&mut self) {
        let Localization { given: Some(given), ok_since, done: false, .. } = self.vehicle.localization else {
            return;
        };
        let since = match self.localization_group {
            None => Some(given),
            Some(id) if self.net.groups[id.0 as usize].node.facts.shown == State::Ok => {
                Some(ok_since.unwrap_or(self.now))
            }
            Some(_) => None,
        };
        let late_at = given + LOCALIZES_WITHIN;
        let late = since.is_none() && late_at <= self.now;
        self.vehicle_changed |= (since, late) != (ok_since, self.vehicle.localization.late);
        self.vehicle.localization.ok_since = since;
        self.vehicle.localization.late = late;
        let Some(since) = since else {
            if !late {
                self.timers.arm(TimerKey::Localization, late_at);
            }
            return;
        };
        let due = since + self.model.driving.localized_after;
        if due > self.now {
            self.timers.arm(TimerKey::Localization, due);
            return;
        }
        self.vehicle.localization.done = true;
        let chosen = self.vehicle.localization.pose.map(|pose| KnownPlace { pose, driven: false });
        self.vehicle.localization.last_known = chosen;
        self.vehicle.localization.skipped = false;
        self.vehicle_changed = true;
        self.step(StageEvent::Localized);
    }

    /// Reports faults of the vehicle's side in the group `telltale`.
    fn report_on_vehicle(&mut self) {
        let shuttle = self.vehicle.model == StageModel::Shuttle;
        let known = self.says_it_drives();
        let vehicle_faults = VehicleFaults {
            active_unknown: (shuttle && self.vehicle.stage == Stage::Active && known.is_none())
                .then_some(if self.now < self.active_by { State::Unknown } else { State::Error }),
            contradicts_itself: self.signals.drive.is_doubted(self.now),
            countermeasures: self.countermeasures.trouble(&self.model),
            outputs: unsent(&self.countermeasures.unsent()).map(Text::from),
            unheard: self.unheard(),
            other_voices: self.countermeasures.other_voices.as_deref().map(system::other_voices),
        };
        if vehicle_faults == self.vehicle_faults {
            return;
        }
        let (state, words) = match vehicle_faults.active_unknown {
            _ if vehicle_faults.contradicts_itself => (
                State::Error,
                say!(
                    "says in turn that the vehicle drives and that it does not",
                    "meldet abwechselnd, dass das Fahrzeug fährt und nicht fährt"
                ),
            ),
            Some(state) => (
                state,
                say!("nothing says whether the vehicle drives", "niemand meldet, ob das Fahrzeug fährt"),
            ),
            None => (State::Ok, Text::default()),
        };
        self.report_on_self(SystemCheck::Active, state, words);
        let worse = |words: &Option<Text>, state| if words.is_some() { state } else { State::Ok };
        let words = |words: &Option<Text>| words.clone().unwrap_or_default();
        let measures =
            (worse(&vehicle_faults.countermeasures, State::Error), words(&vehicle_faults.countermeasures));
        self.report_on_self(SystemCheck::Countermeasure, measures.0, measures.1);
        let outputs = match (&vehicle_faults.other_voices, &vehicle_faults.unheard) {
            (Some(fault), _) | (None, Some(fault)) => (State::Error, fault.clone()),
            (None, None) => (worse(&vehicle_faults.outputs, State::Warning), words(&vehicle_faults.outputs)),
        };
        self.report_on_self(SystemCheck::Outputs, outputs.0, outputs.1);
        self.vehicle_faults = vehicle_faults;
    }

    /// Updates the part of the snapshot about stages and requests, if it may have changed.
    pub(crate) fn show_vehicle(&mut self) {
        if !std::mem::take(&mut self.vehicle_changed) && !self.views.is_changed() {
            return;
        }
        self.views.set_vehicle(VehicleView {
            last_alarm: self.alarms.last_id(),
            asking: self.asks.asking.clone(),
            asked: self.asks.asked,
            accepted: Arc::new(self.warnings.accepted().map(|(id, at)| (NodeId::Module(id), at)).collect()),
            shelved: self.shelves.list().into(),
            countermeasures: self.countermeasures.list(self.net.nobody()),
            localization: self.vehicle.localization,
            clearance: self.vehicle.stage == Stage::Cleared,
            hold: self.countermeasures.hold(),
            last_stop: self.countermeasures.last_stop,
            may_set_off: self.may_set_off(),
            clearance_refusals: self.clearance_refusals().into(),
            release_refusals: self.release_refusals().into(),
            unreached: self.unreached().into(),
            listened: self.countermeasures.listened.iter().copied().collect(),
        });
    }
}

fn unsent(all: &[&OutputReport]) -> Option<String> {
    let about = |output| match output {
        Output::Stage => "the stage",
        Output::Clearance => "the clearance",
        Output::Pose => "the operator's pose",
        Output::Deceleration => "decelerations",
        Output::ManeuverStop => "stops",
        Output::Hold => "whether the vehicle is held",
    };
    let words = |news: &&OutputReport| {
        let error = news.error.as_deref().unwrap_or_default();
        format!("{} cannot be sent on {}: {error}", about(news.output), news.topic)
    };
    (!all.is_empty()).then(|| all.iter().map(words).collect::<Vec<_>>().join("; "))
}

/// The group that tells whether the vehicle is localized.
pub(crate) fn localization_group(model: &Model) -> Option<GroupId> {
    let position = model.groups.iter().position(|group| &*group.path == LOCALIZATION_GROUP)?;
    Some(GroupId(position as u32))
}
