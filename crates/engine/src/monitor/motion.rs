//! Poses: the distance between two, and the motion between two instants; and the distance of two lists of positions.

use crate::files::floats;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

use crate::model::sample::{Pose, Position};
use crate::time::{Span, Timestamp};

/// Poses that are kept for one motion; of those closer together in time only the latest is kept.
const KEPT: u64 = 128;

type Vector = [f64; 3];
/// x, y, z, w; of length one.
type Rotation = [f64; 4];

/// A pose in the frame of another one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Motion {
    #[serde(with = "floats")]
    translation: Vector,
    #[serde(with = "floats")]
    rotation: Rotation,
}

impl Motion {
    /// A readable pose: its rotation is not of length zero.
    pub(super) fn to(pose: &Pose) -> Motion {
        Motion {
            translation: [pose.x_m, pose.y_m, pose.z_m],
            rotation: normalized([pose.qx, pose.qy, pose.qz, pose.qw]),
        }
    }

    /// The second pose as seen from the first.
    pub(super) fn between(from: &Motion, to: &Motion) -> Motion {
        let back = conjugate(from.rotation);
        let way = std::array::from_fn(|axis| to.translation[axis] - from.translation[axis]);
        Motion { translation: rotate(back, way), rotation: normalized(product(back, to.rotation)) }
    }

    pub(super) fn distance_m(&self, other: &Motion) -> f64 {
        let [x, y, z] = std::array::from_fn(|axis| self.translation[axis] - other.translation[axis]);
        x.hypot(y).hypot(z)
    }

    /// The smallest angle, 0 to 180.
    pub(super) fn angle_deg(&self, other: &Motion) -> f64 {
        let [x, y, z, w] = product(conjugate(self.rotation), other.rotation);
        (2.0 * x.hypot(y).hypot(z).atan2(w.abs())).to_degrees()
    }

    fn interpolate(&self, other: &Motion, part: f64) -> Motion {
        let translation = std::array::from_fn(|axis| {
            self.translation[axis] + part * (other.translation[axis] - self.translation[axis])
        });
        // A quaternion and its negative are the same rotation: take the smaller angle.
        let dot: f64 = (0..4).map(|index| self.rotation[index] * other.rotation[index]).sum();
        let sign = if dot < 0.0 { -1.0 } else { 1.0 };
        let mixed = std::array::from_fn(|index| {
            (1.0 - part) * self.rotation[index] + part * sign * other.rotation[index]
        });
        Motion { translation, rotation: normalized(mixed) }
    }
}

/// Past poses, as far back as the motion is judged.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct History {
    kept: VecDeque<(Timestamp, Motion)>,
    latest: Option<(Timestamp, Motion)>,
}

impl History {
    pub(super) fn push(&mut self, at: Timestamp, pose: &Pose, over: Span) {
        if let Some(before) = self.latest {
            let apart = Span::from_nanos(over.as_nanos() / KEPT);
            if self.kept.back().is_none_or(|(last, _)| before.0 >= *last + apart) {
                self.kept.push_back(before);
            }
        }
        self.latest = Some((at, Motion::to(pose)));
        // Among the poses that are old enough, the last one suffices.
        while self.kept.get(1).is_some_and(|(second, _)| *second + over <= at) {
            self.kept.pop_front();
        }
    }

    /// Forgets all poses: after an unreadable pose, the motion is unknown.
    pub(super) fn clear(&mut self) {
        self.kept.clear();
        self.latest = None;
    }

    /// The motion during the last `over`. It is interpolated between the two poses around its beginning, if
    /// they are at most `gap_max` apart. It ends with the latest pose of its own source: at a common instant the
    /// newer source would wait for the older one.
    pub(super) fn motion(&self, over: Span, gap_max: Span) -> Result<Motion, TooShort> {
        let (until, end) = self.latest.ok_or(TooShort::Young)?;
        let begins = until.as_nanos().checked_sub(over.as_nanos()).ok_or(TooShort::Young)?;
        let begins = Timestamp::from_nanos(begins);
        let after = self.kept.partition_point(|(at, _)| *at <= begins);
        let (from, before) =
            *self.kept.get(after.checked_sub(1).ok_or(TooShort::Young)?).ok_or(TooShort::Young)?;
        let (to, next) = self.kept.get(after).copied().unwrap_or((until, end));
        if from == begins {
            return Ok(Motion::between(&before, &end));
        }
        if to.since(from) > gap_max {
            return Err(TooShort::Gap);
        }
        let part = begins.since(from).as_nanos() as f64 / to.since(from).as_nanos() as f64;
        Ok(Motion::between(&before.interpolate(&next, part), &end))
    }
}

/// The reason why the motion is unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TooShort {
    /// The source has not been followed for long enough.
    Young,
    /// There is a gap at the beginning.
    Gap,
}

fn normalized(rotation: Rotation) -> Rotation {
    let length = rotation.iter().map(|part| part * part).sum::<f64>().sqrt();
    rotation.map(|part| part / length)
}

fn conjugate([x, y, z, w]: Rotation) -> Rotation {
    [-x, -y, -z, w]
}

fn product([ax, ay, az, aw]: Rotation, [bx, by, bz, bw]: Rotation) -> Rotation {
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

fn rotate(rotation: Rotation, [x, y, z]: Vector) -> Vector {
    let [x, y, z, _] = product(product(rotation, [x, y, z, 0.0]), conjugate(rotation));
    [x, y, z]
}

/// The largest distance of any position of one list to the nearest of the other, in metres (the
/// Hausdorff distance): 0 for two empty lists, infinite where one of them is empty.
pub(super) fn apart_m(a: &[Position], b: &[Position]) -> f64 {
    farthest(a, b).max(farthest(b, a))
}

fn farthest(from: &[Position], to: &[Position]) -> f64 {
    let nearest = |one: &Position| {
        let distances = to.iter().map(|other| (one.x_m - other.x_m).hypot(one.y_m - other.y_m));
        distances.fold(f64::INFINITY, f64::min)
    };
    from.iter().map(nearest).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x_m: f64, y_m: f64, yaw_deg: f64) -> Pose {
        let half = yaw_deg.to_radians() / 2.0;
        // Of length three: a rotation need not be normalized.
        Pose { x_m, y_m, z_m: 0.0, qx: 0.0, qy: 0.0, qz: 3.0 * half.sin(), qw: 3.0 * half.cos() }
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    #[test]
    fn distance_and_the_shortest_angle() {
        for (a, b, metres, degrees) in [
            (pose(0.0, 0.0, 0.0), pose(3.0, 4.0, 90.0), 5.0, 90.0),
            (pose(1.0, 1.0, 170.0), pose(1.0, 1.0, -170.0), 0.0, 20.0),
            (pose(0.0, 0.0, 0.0), pose(0.0, 0.0, 360.0), 0.0, 0.0),
            (pose(0.0, 0.0, 10.0), pose(0.0, 0.0, 190.0), 0.0, 180.0),
        ] {
            let (a, b) = (Motion::to(&a), Motion::to(&b));
            assert!(near(a.distance_m(&b), metres), "{}", a.distance_m(&b));
            assert!(near(a.angle_deg(&b), degrees), "{}", a.angle_deg(&b));
        }
    }

    #[test]
    fn the_same_motion_in_two_frames_is_the_same() {
        let here = Motion::between(&Motion::to(&pose(0.0, 0.0, 0.0)), &Motion::to(&pose(2.0, 0.5, 30.0)));
        // The same path, in a map that is turned by 90 degrees and far away.
        let there =
            Motion::between(&Motion::to(&pose(100.0, 50.0, 90.0)), &Motion::to(&pose(99.5, 52.0, 120.0)));
        assert!(near(here.distance_m(&there), 0.0) && here.angle_deg(&there) < 1e-6, "{here:?} {there:?}");
    }

    #[test]
    fn a_motion_is_interpolated_at_its_beginning_and_the_history_stays_small() {
        let (over, gap) = (Span::from_secs(1), Span::from_millis(200));
        let mut history = History::default();
        for number in 0..60_000_u64 {
            let at = Timestamp::from_nanos(number * 50_000);
            history.push(at, &pose(at.as_nanos() as f64 / 1e9 * 5.0, 0.0, 0.0), over);
            assert!(history.kept.len() <= KEPT as usize + 2);
        }
        let motion = history.motion(over, gap).expect("it was followed for three seconds");
        assert!((motion.translation[0] - 5.0).abs() < 1e-3, "{motion:?}");
        assert_eq!(History::default().motion(over, gap), Err(TooShort::Young));
    }

    #[test]
    fn a_hole_at_the_beginning_is_not_bridged() {
        let (over, gap) = (Span::from_secs(1), Span::from_millis(200));
        let mut history = History::default();
        for millis in [0, 900, 1000, 1500] {
            history.push(Timestamp::from_millis(millis), &pose(0.0, 0.0, 0.0), over);
        }
        assert_eq!(history.motion(over, gap), Err(TooShort::Gap));
        history.push(Timestamp::from_millis(1900), &pose(0.0, 0.0, 0.0), over);
        assert!(history.motion(over, gap).is_ok());
    }

    #[test]
    fn every_position_of_both_lists_counts() {
        let at = |places: &[(f64, f64)]| -> Vec<Position> {
            places.iter().map(|&(x_m, y_m)| Position { x_m, y_m }).collect()
        };
        for (a, b, apart) in [
            (at(&[]), at(&[]), 0.0),
            (at(&[(1.0, 2.0)]), at(&[]), f64::INFINITY),
            (at(&[(0.0, 0.0), (10.0, 0.0)]), at(&[(10.0, 0.5), (0.3, 0.4)]), 0.5),
            // Two that one source sees as one are near; one that only one source sees is not.
            (at(&[(0.0, 0.0), (0.6, 0.0)]), at(&[(0.3, 0.0)]), 0.3),
            (at(&[(0.0, 0.0), (3.0, 4.0)]), at(&[(0.0, 0.0)]), 5.0),
            (at(&[(1e200, 0.0)]), at(&[(-1e200, 0.0)]), 2e200),
        ] {
            assert_eq!([apart_m(&a, &b), apart_m(&b, &a)], [apart, apart], "{a:?} {b:?}");
        }
    }
}
