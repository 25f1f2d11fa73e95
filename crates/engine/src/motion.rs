//! Whether the vehicle moves, how fast, where to and how far: from the configured speed and position and the pose of
//! the goal.
//!
//! The page shows what people can see: a speed in whole km/h that does not flicker, and "stands" only once the
//! vehicle has been slow for a moment. A speed that is too old, or is no number, says nothing.

use super::Engine;
use super::model::monitors::TopicId;
use super::model::motion::{PositionSource, SpeedSource};
use super::model::sample::{FieldValue, Sample};
use super::model::{Model, Stage, StageModel, Stop};
use super::module::onset::is_well;
use super::snapshot::{Motion, Moving};
use super::time::{Span, Timestamp};
use super::timers::TimerKey;
use crate::signals::driving_word::ARRIVAL;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// A vehicle stands once it has been slow for this long. It moves at once.
const STANDS_AFTER: Span = Span::from_millis(500);

/// The shown speed changes when the measured one is further away than this: half a km/h would be rounding.
const FLICKER_KMH: f64 = 0.75;

/// A vehicle that rolls out at a stop is slower than this.
const ROLLS_OUT_MPS: f64 = 1.5;

/// And stands within this time.
const ROLLS_OUT_WITHIN: Span = Span::from_secs(60);

/// A vehicle that stood moves once no message has said for this long that it is slow.
const MOVES_AFTER: Span = Span::from_millis(500);

/// A higher speed is shown as this one.
const SHOWN_KMH_MAX: f64 = 999.0;

/// A stop that is further from the goal is not the destination, and one that is further from the vehicle is not where it
/// stands.
const AT_STOP_M: f64 = 10.0;

/// A goal that is further away is not in the same frame as the position.
const GOAL_MAX_M: f64 = 100_000.0;

/// The time to the goal comes from how much nearer it came over this time, looked at this often.
const NEARED_OVER: Span = Span::from_secs(60);
const NEARED_EVERY: Span = Span::from_secs(1);
/// A vehicle that comes nearer more slowly than this, or would take longer, has no time.
const NEARING_MIN_MPS: f64 = 0.5;
const GOAL_MAX_MIN: f64 = 60.0;

/// Whether the vehicle is at a stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
enum Parking {
    /// Between stops, or nothing is known of it.
    #[default]
    No,
    /// Since it said that it drives no more.
    RollsOut(Timestamp),
    Yes,
}

/// The known motion.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct MotionState {
    /// The last speed in m/s, without its sign.
    speed: Option<(f64, Timestamp)>,
    /// Since when each message has said that the vehicle is slow.
    slow_since: Option<Timestamp>,
    /// Since when it has stood. A tick of a wheel is no movement.
    stood_since: Option<Timestamp>,
    /// Since when no message has said that it is slow.
    moved_since: Option<Timestamp>,
    parking: Parking,
    /// It came to standby and is, as far as its position shows, at no stop.
    astray: bool,
    /// The place of the last goal, in metres.
    goal: Option<(f64, f64)>,
    /// The last place of the vehicle, in metres.
    position: Option<((f64, f64), Timestamp)>,
    /// The distances to the goal in the last minute of a drive, oldest first.
    nearing: VecDeque<(Timestamp, f64)>,
    shown: Motion,
    /// The speed summed up over the time for which it was known, in metres.
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
                    self.driven_m += f64::midpoint(before, mps) * now.since(at).as_secs_f64();
                }
                self.speed = Some((mps, now));
                let is_slow = mps < source.standing_below_mps;
                self.slow_since = is_slow.then(|| self.slow_since.unwrap_or(now));
                self.moved_since = (!is_slow).then(|| self.moved_since.unwrap_or(now));
                let moves =
                    mps > ROLLS_OUT_MPS || self.moved_since.is_some_and(|since| now >= since + MOVES_AFTER);
                self.stood_since = self.stood_since.filter(|_| !moves).or(self.slow_since);
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
        (self.speed, self.slow_since, self.stood_since, self.moved_since) = (None, None, None, None);
    }

    /// It has arrived, or was localized at a stop.
    pub(super) fn park(&mut self, now: Timestamp) {
        self.parking = Parking::RollsOut(now);
    }

    pub(super) fn set_off(&mut self) {
        self.parking = Parking::No;
    }

    /// Whether it is known to stand at a stop, or rolls out there. Without a speed nothing shows that it was moved.
    pub(super) fn is_parked(&self) -> bool {
        self.parking != Parking::No
    }

    pub(super) fn is_astray(&self) -> bool {
        self.astray
    }

    /// A vehicle that is not to drive and moves all the same is at its stop no more. With a clearance it may set off while its
    /// speed is unknown, or has set off already if it was not known to stand.
    fn follow_parking(&mut self, cleared: bool, now: Timestamp) {
        self.parking = match (self.parking, self.speed) {
            (Parking::Yes, None) | (Parking::RollsOut(_), _) if cleared => Parking::No,
            (Parking::RollsOut(_), Some(_)) if self.stood_since.is_some() => Parking::Yes,
            (Parking::RollsOut(since), Some((mps, _)))
                if mps > ROLLS_OUT_MPS || now >= since + ROLLS_OUT_WITHIN =>
            {
                Parking::No
            }
            (Parking::Yes, Some(_)) if self.stood_since.is_none() => Parking::No,
            (same, _) => same,
        };
    }

    fn take_goal(&mut self, value: &FieldValue) {
        // A message that is no pose neither sets a goal nor ends the one before.
        let Some(goal) = place(value) else { return };
        if self.goal != Some(goal) {
            self.nearing.clear();
        }
        self.goal = Some(goal);
    }

    fn take_position(&mut self, value: &FieldValue, now: Timestamp) {
        if *value != FieldValue::Absent {
            self.position = place(value).map(|place| (place, now));
        }
    }

    /// The next time at which time alone changes the motion.
    fn due(&self, source: &SpeedSource, now: Timestamp) -> Option<Timestamp> {
        let old = self.speed.map(|(_, at)| at + source.timeout);
        let stands = self.slow_since.map(|since| since + STANDS_AFTER);
        [old, stands].into_iter().flatten().filter(|&due| due > now).min()
    }

    /// Judges how far the goal is in a straight line, and how long a drive there takes if it comes nearer as it did in
    /// the last minute. `trusted` says whether the position is.
    fn judge_goal(&mut self, source: Option<&PositionSource>, trusted: bool, drives: bool, now: Timestamp) {
        (self.shown.goal_min, self.position) =
            (None, self.position.filter(|(_, at)| source.is_some_and(|source| now < *at + source.timeout)));
        let ways = self.position.filter(|_| trusted).zip(self.goal);
        let far = ways.map(|(((x_m, y_m), at), goal)| ((goal.0 - x_m).hypot(goal.1 - y_m), at));
        let Some((goal_m, at)) = far.filter(|(m, _)| *m <= GOAL_MAX_M) else {
            self.nearing.clear();
            self.shown.goal_m = None;
            return;
        };
        self.shown.goal_m = Some(shown_m(goal_m, self.shown.goal_m));
        if !drives {
            self.nearing.clear();
            return;
        }
        if self.nearing.back().is_none_or(|(last, _)| at >= *last + NEARED_EVERY) {
            self.nearing.push_back((at, goal_m));
            while self.nearing.get(1).is_some_and(|(second, _)| at >= *second + NEARED_OVER) {
                self.nearing.pop_front();
            }
        }
        let Some(((first, before_m), (last, last_m))) = self.nearing.front().zip(self.nearing.back()) else {
            return;
        };
        if *last >= *first + NEARED_OVER {
            let mps = (before_m - last_m) / last.since(*first).as_secs_f64();
            let min = (goal_m / mps / 60.0).ceil().max(1.0);
            self.shown.goal_min = (mps >= NEARING_MIN_MPS && min <= GOAL_MAX_MIN).then_some(min as u32);
        }
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

/// The place of a pose.
fn place(value: &FieldValue) -> Option<(f64, f64)> {
    match value {
        FieldValue::Pose(pose) if pose.x_m.is_finite() && pose.y_m.is_finite() => Some((pose.x_m, pose.y_m)),
        _ => None,
    }
}

/// A distance in steps of 10 m, from a kilometre on of 100 m, which stays as it is while the measured one is close to it.
fn shown_m(m: f64, shown: Option<u32>) -> u32 {
    let step = if m < 995.0 { 10.0 } else { 100.0 };
    let stays =
        shown.filter(|&shown| f64::from(shown) % step == 0.0 && (m - f64::from(shown)).abs() <= 0.75 * step);
    stays.unwrap_or(((m / step).round() * step) as u32)
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
    /// Takes the speed, the position and the goal from a message. Returns whether that changed the motion.
    pub(super) fn take_motion(&mut self, topic: TopicId, sample: &Sample) -> bool {
        let driving = &self.model.driving;
        // The age of a late speed is not known, and one from before a loss says nothing of now.
        let is_timed = !sample.late && sample.delay.is_zero();
        if let Some(source) = driving.speed.as_ref().filter(|it| it.value.topic == topic && is_timed) {
            self.motion.take_speed(source, &sample.values[source.value.field as usize], self.now);
        }
        if let Some(source) = driving.position.filter(|it| it.value.topic == topic && is_timed) {
            self.motion.take_position(&sample.values[source.value.field as usize], self.now);
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
        if driving.speed.is_some() && self.vehicle.stage != Stage::Active {
            self.motion.follow_parking(self.vehicle.stage == Stage::Cleared, self.now);
        }
        let is_astray = match self.vehicle.stage {
            _ if self.motion.is_parked() => false,
            // Before it is localized its position shows nothing.
            Stage::Locked | Stage::Localizing => self.motion.astray,
            Stage::Standby | Stage::Cleared | Stage::Active => self.is_seen_at_a_stop() == Some(false),
        };
        self.vehicle_changed |= std::mem::replace(&mut self.motion.astray, is_astray) != is_astray;
        let trusted = self.is_localized();
        let drives = self.vehicle.stage == Stage::Active;
        self.motion.judge_goal(driving.position.as_ref(), trusted, drives, self.now);
        let of_speed = driving.speed.as_ref().and_then(|source| self.motion.due(source, self.now));
        let of_position =
            driving.position.zip(self.motion.position).map(|(source, (_, at))| at + source.timeout);
        if let Some(due) = of_speed.into_iter().chain(of_position).min() {
            self.timers.arm(TimerKey::Motion, due);
        }
        self.views.set_motion(self.motion.shown)
    }

    fn has_set_goal(&self) -> bool {
        self.goal_signal.is_some_and(|index| self.signals.value(index) == Some(true))
    }

    /// Whether a vehicle that just said that it drives no more is between stops, because its mission component has
    /// started again: it is faster than one that arrives, or stood before for as long as an arrival takes, or nothing
    /// is known of that, or it contradicted itself a moment ago, or its position shows no stop. Without a
    /// speed nothing else tells a restart from an arrival.
    pub(super) fn is_between_stops(&self) -> bool {
        if self.signals.drive.is_no_arrival() || self.is_seen_at_a_stop() == Some(false) {
            return true;
        }
        self.model.driving.speed.is_some() && (self.has_stood() || self.may_roll_fast())
    }

    /// Whether its position is near a stop. One that is old, or that Localization does not stand for, shows none. `None`:
    /// the configuration has no position, or no stops.
    pub(super) fn is_seen_at_a_stop(&self) -> Option<bool> {
        let driving = &self.model.driving;
        let source = driving.position.filter(|_| !driving.stops.is_empty())?;
        let place =
            self.motion.position.filter(|(_, at)| self.now < *at + source.timeout && self.is_localized());
        Some(place.is_some_and(|(place, _)| nearest_stop(&driving.stops, place).is_some()))
    }

    /// A vehicle that is not sure where it is knows no place and no distance.
    fn is_localized(&self) -> bool {
        let shown = self.localization_group.map(|id| self.net.groups[id.0 as usize].node.facts.shown);
        shown.is_none_or(is_well)
    }

    /// Whether it has stood for longer than at an arrival.
    pub(super) fn has_stood(&self) -> bool {
        self.motion.stood_since.is_some_and(|since| self.now >= since + ARRIVAL)
    }

    /// Whether it is faster than a vehicle that rolls out at a stop, or its speed is not known although one is configured.
    pub(super) fn may_roll_fast(&self) -> bool {
        let Some(source) = &self.model.driving.speed else { return false };
        let slow = |(mps, at): (f64, Timestamp)| self.now < at + source.timeout && mps <= ROLLS_OUT_MPS;
        !self.motion.speed.is_some_and(slow)
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
        let position = now
            .driving
            .position
            .zip(before.driving.position)
            .filter(|(it, other)| it.value.means_the_same(&now.watched, other.value, &before.watched));
        self.motion.driven_m = old.motion.driven_m;
        // Without stages it may have driven since.
        if before.stages == StageModel::Shuttle {
            (self.motion.parking, self.motion.astray) = (old.motion.parking, old.motion.astray);
        }
        if let Some((source, _)) = speed {
            (self.motion.speed, self.motion.shown) = (old.motion.speed, old.motion.shown);
            let is_slow = |(mps, _): &(f64, Timestamp)| *mps < source.standing_below_mps;
            let slow = self.motion.speed.filter(is_slow);
            self.motion.slow_since = slow.map(|(_, at)| old.motion.slow_since.unwrap_or(at));
            self.motion.stood_since = old.motion.stood_since.or(self.motion.slow_since);
            self.motion.moved_since = old.motion.moved_since;
        }
        if goal.is_some() {
            self.motion.goal = old.motion.goal;
        }
        if position.is_some() {
            self.motion.position = old.motion.position;
        }
    }
}
