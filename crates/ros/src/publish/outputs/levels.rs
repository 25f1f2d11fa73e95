//! The messages to the vehicle and when they are due: levels that follow from snapshots. Pure.

use telltale_engine::model::Stage;
use telltale_engine::model::output::Output;
use telltale_engine::snapshot::{MapPose, Snapshot};
use telltale_engine::time::{Span, Timestamp};

/// A request to stop is repeated this often while it is in force.
const STOP_EVERY: Span = Span::from_secs(1);
/// Whether the vehicle is held is repeated this often.
const HOLD_EVERY: Span = Span::from_secs(1);

/// One message for the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum VehicleMessage {
    /// In m/s².
    Deceleration(f64),
    ManeuverStop(bool),
    Hold(bool),
    Clearance(bool),
    Stage(Stage),
    /// The operator's pose of this number.
    Pose(u64, MapPose),
}

impl VehicleMessage {
    pub fn output(self) -> Output {
        match self {
            VehicleMessage::Deceleration(_) => Output::Deceleration,
            VehicleMessage::ManeuverStop(_) => Output::ManeuverStop,
            VehicleMessage::Hold(_) => Output::Hold,
            VehicleMessage::Clearance(_) => Output::Clearance,
            VehicleMessage::Stage(_) => Output::Stage,
            VehicleMessage::Pose(..) => Output::Pose,
        }
    }
}

/// The messages that were sent last. A message that could not be sent is due again.
#[derive(Debug, Default)]
pub struct Levels {
    /// A request that is in force is repeated.
    pub every: Span,
    deceleration: Option<(f64, Timestamp)>,
    /// A late reader that asks for no last value hears a stop only when it is repeated.
    maneuver_stop: Option<(bool, Timestamp)>,
    hold: Option<(bool, Timestamp)>,
    clearance: Option<bool>,
    stage: Option<Stage>,
    pose: u64,
}

impl Levels {
    /// A pose that was given before is not sent again: the vehicle has moved since.
    pub fn new(every: Span, before: &Snapshot) -> Levels {
        Levels { every, pose: before.localization.number, ..Levels::default() }
    }

    /// There is a new participant, so nobody heard the earlier messages. The pose is no level and stays
    /// sent.
    pub fn forget(&mut self) {
        *self = Levels { every: self.every, pose: self.pose, ..Levels::default() };
    }

    /// The messages that are due now, most urgent first.
    pub fn due(&self, snapshot: &Snapshot, now: Timestamp) -> Vec<VehicleMessage> {
        let mut due = Vec::new();
        if let Some(mps2) = snapshot.deceleration()
            && self.deceleration.is_none_or(|(said, at)| said != mps2 || now >= at + self.every)
        {
            due.push(VehicleMessage::Deceleration(mps2));
        }
        let maneuver_stop = snapshot.maneuver_stop();
        let stops_again = |at: Timestamp| maneuver_stop && now >= at + STOP_EVERY;
        let is_stop_due =
            self.maneuver_stop.is_none_or(|(said, at)| said != maneuver_stop || stops_again(at));
        let hold = snapshot
            .hold
            .filter(|&hold| self.hold.is_none_or(|(said, at)| said != hold || now >= at + HOLD_EVERY));
        // A release comes last, behind the end of what it releases.
        due.extend(hold.filter(|&hold| hold).map(VehicleMessage::Hold));
        due.extend(is_stop_due.then_some(VehicleMessage::ManeuverStop(maneuver_stop)));
        due.extend(hold.filter(|&hold| !hold).map(VehicleMessage::Hold));
        if self.clearance != Some(snapshot.clearance) {
            due.push(VehicleMessage::Clearance(snapshot.clearance));
        }
        if self.stage != Some(snapshot.stage) {
            due.push(VehicleMessage::Stage(snapshot.stage));
        }
        let localization = &snapshot.localization;
        if let Some(pose) = localization.pose.filter(|_| localization.number > self.pose) {
            due.push(VehicleMessage::Pose(localization.number, pose));
        }
        due
    }

    pub fn said(&mut self, say: VehicleMessage, now: Timestamp) {
        match say {
            VehicleMessage::Deceleration(mps2) => self.deceleration = Some((mps2, now)),
            VehicleMessage::ManeuverStop(on) => self.maneuver_stop = Some((on, now)),
            VehicleMessage::Hold(on) => self.hold = Some((on, now)),
            VehicleMessage::Clearance(on) => self.clearance = Some(on),
            VehicleMessage::Stage(stage) => self.stage = Some(stage),
            VehicleMessage::Pose(number, _) => self.pose = number,
        }
    }

    /// When a level is to be repeated. An ended request is forgotten, so that the next one starts at
    /// once.
    pub fn repeat_at(&mut self, snapshot: &Snapshot) -> Option<Timestamp> {
        if snapshot.deceleration().is_none() {
            self.deceleration = None;
        }
        let stop = self.maneuver_stop.filter(|(on, _)| *on).map(|(_, at)| at + STOP_EVERY);
        let deceleration = self.deceleration.map(|(_, at)| at + self.every);
        let hold = self.hold.filter(|_| snapshot.hold.is_some()).map(|(_, at)| at + HOLD_EVERY);
        [stop, deceleration, hold].into_iter().flatten().min()
    }

    /// The vehicle was told that it may start.
    pub fn cleared(&self) -> bool {
        self.clearance == Some(true)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use telltale_engine::Engine;
    use telltale_engine::model::countermeasure::Request;
    use telltale_engine::model::{Model, Parts, StageModel};
    use telltale_engine::snapshot::{Countermeasure, CountermeasureState};
    use telltale_engine::time::Since;

    fn at(ms: u64) -> Timestamp {
        Timestamp::from_millis(ms)
    }

    /// Nothing is asked, and nobody says whether anything was before.
    fn calm() -> Snapshot {
        let parts = Parts::empty("v", StageModel::Shuttle);
        let model = Arc::new(Model::new(parts).expect("nothing depends on anything"));
        Snapshot { hold: None, ..(*Engine::new(model, Timestamp::ZERO).snapshot()).clone() }
    }

    fn asking(requests: &[Request]) -> Snapshot {
        let measure = |&request: &Request| Countermeasure {
            request,
            by_operator: None,
            causes: Arc::from([]),
            about: Arc::from([]),
            since: Since { at: Timestamp::ZERO, before: Span::ZERO },
            state: CountermeasureState::Requested,
            latched: false,
        };
        Snapshot { countermeasures: requests.iter().map(measure).collect(), hold: None, ..calm() }
    }

    /// Sends all that is due, and returns it.
    fn say(levels: &mut Levels, snapshot: &Snapshot, ms: u64) -> Vec<VehicleMessage> {
        let due = levels.due(snapshot, at(ms));
        due.iter().for_each(|&say| levels.said(say, at(ms)));
        due
    }

    #[test]
    fn a_level_is_said_once_when_it_changes_and_again_to_a_new_participant() {
        let mut levels = Levels::new(Span::from_millis(50), &calm());
        let all = [
            VehicleMessage::ManeuverStop(false),
            VehicleMessage::Clearance(false),
            VehicleMessage::Stage(Stage::Locked),
        ];
        assert_eq!(say(&mut levels, &calm(), 0), all);
        assert_eq!(say(&mut levels, &calm(), 10_000), []);
        let cleared = Snapshot { clearance: true, stage: Stage::Cleared, ..calm() };
        assert_eq!(
            say(&mut levels, &cleared, 0),
            [VehicleMessage::Clearance(true), VehicleMessage::Stage(Stage::Cleared)]
        );
        assert!(levels.cleared());
        levels.forget();
        assert_eq!(say(&mut levels, &cleared, 0).len(), 3);
    }

    #[test]
    fn what_was_not_said_stays_due() {
        let levels = Levels::new(Span::from_millis(50), &calm());
        assert_eq!(levels.due(&calm(), at(0)), levels.due(&calm(), at(5)));
    }

    #[test]
    fn a_deceleration_goes_first_is_repeated_and_ends_in_silence() {
        let mut levels = Levels::new(Span::from_millis(50), &calm());
        say(&mut levels, &calm(), 0);
        let asked = asking(&[Request::Decelerate { mps2: 1.0 }, Request::ManeuverStop]);
        assert_eq!(
            say(&mut levels, &asked, 10),
            [VehicleMessage::Deceleration(1.0), VehicleMessage::ManeuverStop(true)]
        );
        assert_eq!(levels.repeat_at(&asked), Some(at(60)));
        assert_eq!(say(&mut levels, &asked, 59), []);
        assert_eq!(say(&mut levels, &asked, 60), [VehicleMessage::Deceleration(1.0)]);
        let stronger = asking(&[Request::Decelerate { mps2: 2.0 }, Request::ManeuverStop]);
        assert_eq!(say(&mut levels, &stronger, 61), [VehicleMessage::Deceleration(2.0)], "at once");
        assert_eq!(say(&mut levels, &calm(), 70), [VehicleMessage::ManeuverStop(false)]);
        assert_eq!(levels.repeat_at(&calm()), None);
        assert_eq!(
            say(&mut levels, &stronger, 71).first(),
            Some(&VehicleMessage::Deceleration(2.0)),
            "a new one, at once"
        );
    }

    #[test]
    fn a_stop_is_said_again_for_readers_that_come_late() {
        let mut levels = Levels::new(Span::from_millis(50), &calm());
        say(&mut levels, &calm(), 0);
        let asked = asking(&[Request::ManeuverStop]);
        assert_eq!(say(&mut levels, &asked, 10), [VehicleMessage::ManeuverStop(true)]);
        assert_eq!(levels.repeat_at(&asked), Some(at(1010)));
        assert_eq!(say(&mut levels, &asked, 1009), []);
        assert_eq!(say(&mut levels, &asked, 1010), [VehicleMessage::ManeuverStop(true)]);
        assert_eq!(say(&mut levels, &calm(), 1500), [VehicleMessage::ManeuverStop(false)]);
        assert_eq!(levels.repeat_at(&calm()), None);
    }

    #[test]
    fn a_hold_is_repeated_and_its_end_comes_behind_what_it_ends() {
        let held = |hold: bool, requests: &[Request]| Snapshot { hold: Some(hold), ..asking(requests) };
        let (asked, released) = (held(true, &[Request::ManeuverStop]), held(false, &[]));
        let mut levels = Levels::new(Span::from_millis(50), &calm());
        say(&mut levels, &calm(), 0);
        let both = [VehicleMessage::Hold(true), VehicleMessage::ManeuverStop(true)];
        assert_eq!(say(&mut levels, &asked, 10), both);
        assert_eq!((say(&mut levels, &asked, 1009), say(&mut levels, &asked, 1010)), (vec![], both.to_vec()));
        let end = [VehicleMessage::ManeuverStop(false), VehicleMessage::Hold(false)];
        assert_eq!(say(&mut levels, &released, 1500), end);
        assert_eq!(levels.repeat_at(&released), Some(at(2500)));
        assert_eq!(say(&mut levels, &released, 2500), [VehicleMessage::Hold(false)]);
    }

    #[test]
    fn a_pose_is_given_once_and_none_from_before_the_start() {
        let posed = |number| {
            let pose = MapPose { x_m: 1.0, y_m: 2.0, yaw_deg: 90.0 };
            let mut snapshot = calm();
            (snapshot.localization.number, snapshot.localization.pose) = (number, Some(pose));
            snapshot
        };
        let mut levels = Levels::new(Span::from_millis(50), &posed(3));
        assert!(!say(&mut levels, &posed(3), 0).iter().any(|say| matches!(say, VehicleMessage::Pose(..))));
        assert!(matches!(say(&mut levels, &posed(4), 0)[..], [VehicleMessage::Pose(4, _)]));
        levels.forget();
        assert!(!say(&mut levels, &posed(4), 0).iter().any(|say| matches!(say, VehicleMessage::Pose(..))));
    }
}
