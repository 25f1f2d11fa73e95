//! What the vehicle is to be told, and when: levels that follow from snapshots. Pure.

use crate::engine::input::Output;
use crate::engine::model::Stage;
use crate::engine::snapshot::{MapPose, Snapshot};
use crate::engine::time::{Span, Timestamp};

/// One message for the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Say {
    /// In m/s².
    Deceleration(f64),
    ManeuverStop(bool),
    Clearance(bool),
    Stage(Stage),
    /// The operator's pose of this number.
    Pose(u64, MapPose),
}

impl Say {
    pub fn output(self) -> Output {
        match self {
            Say::Deceleration(_) => Output::Deceleration,
            Say::ManeuverStop(_) => Output::ManeuverStop,
            Say::Clearance(_) => Output::Clearance,
            Say::Stage(_) => Output::Stage,
            Say::Pose(..) => Output::Pose,
        }
    }
}

/// What was said last. What could not be said is due again.
#[derive(Debug)]
pub struct Levels {
    /// A request that is in force is repeated.
    pub every: Span,
    deceleration: Option<(f64, Timestamp)>,
    maneuver_stop: Option<bool>,
    clearance: Option<bool>,
    stage: Option<Stage>,
    pose: u64,
}

impl Levels {
    /// A pose that was given before is not given again: the vehicle has moved since.
    pub fn new(every: Span, before: &Snapshot) -> Levels {
        Levels {
            every,
            deceleration: None,
            maneuver_stop: None,
            clearance: None,
            stage: None,
            pose: before.localization.number,
        }
    }

    /// Nobody heard what was said: there is another participant. The pose is no level.
    pub fn forget(&mut self) {
        *self = Levels {
            every: self.every,
            pose: self.pose,
            deceleration: None,
            maneuver_stop: None,
            clearance: None,
            stage: None,
        };
    }

    /// What is to be said now, most urgent first.
    pub fn due(&self, snapshot: &Snapshot, now: Timestamp) -> Vec<Say> {
        let mut due = Vec::new();
        if let Some(mps2) = snapshot.deceleration()
            && self.deceleration.is_none_or(|(said, at)| said != mps2 || now >= at + self.every)
        {
            due.push(Say::Deceleration(mps2));
        }
        let maneuver_stop = snapshot.maneuver_stop();
        if self.maneuver_stop != Some(maneuver_stop) {
            due.push(Say::ManeuverStop(maneuver_stop));
        }
        if self.clearance != Some(snapshot.clearance) {
            due.push(Say::Clearance(snapshot.clearance));
        }
        if self.stage != Some(snapshot.stage) {
            due.push(Say::Stage(snapshot.stage));
        }
        let localization = &snapshot.localization;
        if let Some(pose) = localization.pose.filter(|_| localization.number > self.pose) {
            due.push(Say::Pose(localization.number, pose));
        }
        due
    }

    pub fn said(&mut self, say: Say, now: Timestamp) {
        match say {
            Say::Deceleration(mps2) => self.deceleration = Some((mps2, now)),
            Say::ManeuverStop(on) => self.maneuver_stop = Some(on),
            Say::Clearance(on) => self.clearance = Some(on),
            Say::Stage(stage) => self.stage = Some(stage),
            Say::Pose(number, _) => self.pose = number,
        }
    }

    /// When a request is to be repeated. What is over is forgotten, so that the next one starts at once.
    pub fn repeat_at(&mut self, snapshot: &Snapshot) -> Option<Timestamp> {
        if snapshot.deceleration().is_none() {
            self.deceleration = None;
        }
        self.deceleration.map(|(_, at)| at + self.every)
    }

    /// The vehicle was told that it may start.
    pub fn cleared(&self) -> bool {
        self.clearance == Some(true)
    }
}
