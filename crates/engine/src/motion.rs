//! Whether the vehicle moves, how fast, and where to: from the configured speed and the pose of the goal.
//!
//! The page shows what people can see: a speed in whole km/h that does not flicker, and "stands" only once the
//! vehicle has been slow for a moment. A speed that is too old, or is no number, says nothing.

use super::Engine;
use super::model::monitors::TopicId;
use super::model::motion::SpeedSource;
use super::model::sample::{FieldValue, Sample};
use super::model::{Model, Stage, StageModel, Stop};
use super::snapshot::{Motion, Moving};
use super::time::{Span, Timestamp};
use super::timers::TimerKey;
use crate::signals::driving_word::ARRIVAL;
use serde::{Deserialize, Serialize};

/// A vehicle stands once it has been slow for this long. It moves at once.
const STANDS_AFTER: Span = Span::from_millis(500);

/// The shown speed changes when the measured one is further away than this: half a km/h would be rounding.
const FLICKER_KMH: f64 = 0.75;

/// A higher speed is shown as this one.
const SHOWN_KMH_MAX: f64 = 999.0;

/// A stop that is further from the goal is not the destination.
const AT_STOP_M: f64 = 10.0;

/// The known motion.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct MotionState {
    /// The last speed in m/s, without its sign.
    speed: Option<(f64, Timestamp)>,
    /// Since when each message has said that the vehicle is slow.
    slow_since: Option<Timestamp>,
    /// The place of the last goal, in metres.
    goal: Option<(f64, f64)>,
    shown: Motion,
    /// The speed summed up over the time for which it was known, in metres.
    #[serde(default)]
    driven_m: f64,
}

impl MotionState {
    fn take_speed(&mut self, source: &SpeedSource, value: &FieldValue, now: Timestamp) {
        match value {
            FieldValue::Absent => {}
            FieldValue::Number(mps) if mps.is_finite() => {
                let mps = mps.abs();
                // Beyond its timeout nothing is known of the way.
                if let Some((before, at)) = self.speed.filter(|(_, at)| now < *at + source.timeout) {
                    self.driven_m += f64::midpoint(before, mps) * now.since(at).as_nanos() as f64 / 1e9;
                }
                self.speed = Some((mps, now));
                self.slow_since = (mps < source.standing_below_mps).then(|| self.slow_since.unwrap_or(now));
            }
            _ => self.lose_speed(),
        }
    }

    pub(super) fn shown(&self) -> Motion {
        self.shown
    }

    pub(super) fn driven_m(&self) -> f64 {
        self.driven_m
    }

    pub(super) fn lose_speed(&mut self) {
        (self.speed, self.slow_since) = (None, None);
    }

    fn take_goal(&mut self, value: &FieldValue) {
        // A message that is no pose neither sets a goal nor ends the one before.
        if let FieldValue::Pose(pose) = value
            && pose.x_m.is_finite()
            && pose.y_m.is_finite()
        {
            self.goal = Some((pose.x_m, pose.y_m));
        }
    }

    /// The next time at which time alone changes the motion.
    fn due(&self, source: &SpeedSource, now: Timestamp) -> Option<Timestamp> {
        let old = self.speed.map(|(_, at)| at + source.timeout);
        let stands = self.slow_since.map(|since| since + STANDS_AFTER);
        [old, stands].into_iter().flatten().filter(|&due| due > now).min()
    }

    /// Judges the speed at `now`.
    fn judge(&mut self, source: Option<&SpeedSource>, now: Timestamp) {
        let known = source.zip(self.speed).filter(|(source, (_, at))| now < *at + source.timeout);
        let Some((_, (mps, _))) = known else {
            self.lose_speed();
            (self.shown.moving, self.shown.speed_kmh) = (Moving::Unknown, None);
            return;
        };
        match self.slow_since {
            None => self.shown.moving = Moving::Yes,
            Some(since) if now >= since + STANDS_AFTER => self.shown.moving = Moving::No,
            // Until then a moving vehicle moves, and nothing is known of another.
            Some(_) => {}
        }
        self.shown.speed_kmh = match self.shown.moving {
            Moving::Yes => Some(whole_kmh(mps, self.shown.speed_kmh).max(1)),
            Moving::No => Some(0),
            Moving::Unknown => None,
        };
    }
}

/// A speed in whole km/h, which stays as it is while the speed is close to it.
fn whole_kmh(mps: f64, shown: Option<u32>) -> u32 {
    let kmh = (mps * 3.6).min(SHOWN_KMH_MAX);
    let stays = shown.filter(|&shown| (kmh - f64::from(shown)).abs() <= FLICKER_KMH);
    stays.unwrap_or(kmh.round() as u32)
}

/// The stop at a place, if one is near.
fn nearest_stop(stops: &[Stop], (x_m, y_m): (f64, f64)) -> Option<usize> {
    let distances = stops.iter().map(|stop| (stop.x_m - x_m).hypot(stop.y_m - y_m)).enumerate();
    let (index, _) = distances.filter(|(_, m)| *m <= AT_STOP_M).min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(index)
}

impl Engine {
    /// Takes the speed and the goal from a message. Returns whether that changed the motion.
    pub(super) fn take_motion(&mut self, topic: TopicId, sample: &Sample) -> bool {
        let driving = &self.model.driving;
        // The age of a late speed is not known.
        if let Some(source) = driving.speed.as_ref().filter(|it| it.value.topic == topic && !sample.late) {
            self.motion.take_speed(source, &sample.values[source.value.field as usize], self.now);
        }
        if let Some(goal) = driving.goal.filter(|it| it.topic == topic) {
            self.motion.take_goal(&sample.values[goal.field as usize]);
        }
        self.show_motion()
    }

    /// Judges the motion at the present instant. Returns whether it changed.
    pub(super) fn show_motion(&mut self) -> bool {
        let driving = &self.model.driving;
        self.motion.judge(driving.speed.as_ref(), self.now);
        // As a goal is one, until the drive to it is over. A machine without stages has no end of a drive.
        let is_driving = self.vehicle.model == StageModel::Shuttle && self.vehicle.stage == Stage::Active;
        let counts = self.has_set_goal() || is_driving;
        self.motion.goal = self.motion.goal.filter(|_| counts);
        self.motion.shown.destination = self.motion.goal.and_then(|goal| nearest_stop(&driving.stops, goal));
        self.motion.shown.has_source = driving.speed.is_some();
        if let Some(due) = driving.speed.as_ref().and_then(|source| self.motion.due(source, self.now)) {
            self.timers.arm(TimerKey::Motion, due);
        }
        self.views.set_motion(self.motion.shown)
    }

    fn has_set_goal(&self) -> bool {
        self.goal_signal.is_some_and(|index| self.signals.value(index) == Some(true))
    }

    /// Whether a vehicle that just said that it drives no more stood before for as long as an arrival takes, or whether
    /// that is not known: then it was stopped between stops, and its mission component has started again. Without a
    /// speed nothing tells the two apart.
    pub(super) fn stood_on_the_way(&self) -> bool {
        let Some(source) = &self.model.driving.speed else { return false };
        let known = self.motion.speed.is_some_and(|(_, at)| self.now < at + source.timeout);
        !known || self.motion.slow_since.is_some_and(|since| self.now >= since + ARRIVAL)
    }

    /// The drive to the goal is over.
    pub(super) fn forget_destination(&mut self) {
        self.motion.goal = None;
    }

    /// Keeps what is known of the motion over a reload, as far as its sources stay.
    pub(super) fn keep_motion(&mut self, old: &Engine) {
        let (now, before): (&Model, &Model) = (&self.model, &old.model);
        let speed = now
            .driving
            .speed
            .zip(before.driving.speed)
            .filter(|(it, other)| it.value.means_the_same(&now.watched, other.value, &before.watched));
        let goal = now
            .driving
            .goal
            .zip(before.driving.goal)
            .filter(|(it, other)| it.means_the_same(&now.watched, *other, &before.watched));
        self.motion.driven_m = old.motion.driven_m;
        if let Some((source, _)) = speed {
            (self.motion.speed, self.motion.shown) = (old.motion.speed, old.motion.shown);
            let is_slow = |(mps, _): &(f64, Timestamp)| *mps < source.standing_below_mps;
            let slow = self.motion.speed.filter(is_slow);
            self.motion.slow_since = slow.map(|(_, at)| old.motion.slow_since.unwrap_or(at));
        }
        if goal.is_some() {
            self.motion.goal = old.motion.goal;
        }
    }
}
