//! The route: smooth legs from stop to stop, in the frame of the map.

use telltale_engine::model::Stop;
use telltale_engine::model::sample::Pose;

/// Points of each leg, a few decimetres apart.
const POINTS: usize = 512;

/// Position and direction: metres, and radians counterclockwise from the x axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose2d {
    pub x_m: f64,
    pub y_m: f64,
    pub yaw: f64,
}

impl Pose2d {
    pub fn of_pose(pose: &Pose) -> Pose2d {
        let yaw = (2.0 * (pose.qw * pose.qz + pose.qx * pose.qy))
            .atan2(1.0 - 2.0 * (pose.qy * pose.qy + pose.qz * pose.qz));
        Pose2d { x_m: pose.x_m, y_m: pose.y_m, yaw }
    }

    pub fn pose(self) -> Pose {
        let (qz, qw) = (self.yaw / 2.0).sin_cos();
        Pose { x_m: self.x_m, y_m: self.y_m, qz, qw, ..Pose::default() }
    }

    /// The pose so far ahead and to the left, turned by so much.
    pub fn moved(self, ahead_m: f64, left_m: f64, turn: f64) -> Pose2d {
        let (sin, cos) = self.yaw.sin_cos();
        Pose2d {
            x_m: self.x_m + ahead_m * cos - left_m * sin,
            y_m: self.y_m + ahead_m * sin + left_m * cos,
            yaw: wrapped(self.yaw + turn),
        }
    }

    pub fn distance_m(self, other: Pose2d) -> f64 {
        (self.x_m - other.x_m).hypot(self.y_m - other.y_m)
    }

    /// The turn from this direction to that of `other`.
    pub fn turn_to(self, other: Pose2d) -> f64 {
        wrapped(other.yaw - self.yaw)
    }

    fn between(self, other: Pose2d, share: f64) -> Pose2d {
        Pose2d {
            x_m: self.x_m + (other.x_m - self.x_m) * share,
            y_m: self.y_m + (other.y_m - self.y_m) * share,
            yaw: wrapped(self.yaw + self.turn_to(other) * share),
        }
    }
}

/// The direction as a value between -pi and pi.
fn wrapped(angle: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle - turn * (angle / turn).round()
}

/// A closed loop of stops.
#[derive(Debug, Clone)]
pub(crate) struct Route {
    legs: Vec<Leg>,
}

#[derive(Debug, Clone)]
struct Leg {
    /// The stop at its beginning.
    name: Box<str>,
    /// Each point with its distance from the start of the leg.
    points: Vec<(f64, Pose2d)>,
}

impl Route {
    /// A route through these stops; fewer than two stops make no route, so then through three of its own.
    pub fn through(stops: &[Stop]) -> Route {
        let mut stops: Vec<(Box<str>, Pose2d)> = stops.iter().map(stop).collect();
        if stops.len() < 2 {
            let place = |x_m, y_m, yaw_deg: f64| Pose2d { x_m, y_m, yaw: yaw_deg.to_radians() };
            stops = vec![
                ("Depot".into(), place(12.0, 3.5, 90.0)),
                ("Main Station".into(), place(148.2, 61.0, 0.0)),
                ("Campus".into(), place(301.4, -22.8, -90.0)),
            ];
        }
        let next = stops.iter().cycle().skip(1);
        let legs = stops
            .iter()
            .zip(next)
            .map(|((name, from), (_, to))| Leg { name: name.clone(), points: points(*from, *to) });
        Route { legs: legs.collect() }
    }

    /// The stop after this one.
    pub fn next(&self, stop: usize) -> usize {
        (stop + 1) % self.legs.len()
    }

    pub fn name(&self, stop: usize) -> &str {
        &self.legs[stop].name
    }

    /// The way from a stop to the next one.
    pub fn length_m(&self, stop: usize) -> f64 {
        self.legs[stop].points[POINTS].0
    }

    /// The pose so far after a stop, at most at the next one.
    pub fn place(&self, stop: usize, along_m: f64) -> Pose2d {
        let points = &self.legs[stop].points;
        let after = points.partition_point(|(way_m, _)| *way_m <= along_m).clamp(1, POINTS);
        let ((from_m, from), (to_m, to)) = (points[after - 1], points[after]);
        let share = ((along_m - from_m) / (to_m - from_m).max(1e-9)).clamp(0.0, 1.0);
        from.between(to, share)
    }
}

fn stop(stop: &Stop) -> (Box<str>, Pose2d) {
    (stop.name.en.as_ref().into(), Pose2d { x_m: stop.x_m, y_m: stop.y_m, yaw: stop.yaw_deg.to_radians() })
}

/// A cubic curve with the directions of both ends.
fn points(from: Pose2d, to: Pose2d) -> Vec<(f64, Pose2d)> {
    let pull_m = from.distance_m(to).max(1.0);
    let tangent = |place: Pose2d| (pull_m * place.yaw.cos(), pull_m * place.yaw.sin());
    let ((from_tx, from_ty), (to_tx, to_ty)) = (tangent(from), tangent(to));
    let sum = |weights: [f64; 4], values: [f64; 4]| -> f64 {
        weights.iter().zip(values).map(|(weight, value)| weight * value).sum()
    };
    let (xs, ys) = ([from.x_m, from_tx, to.x_m, to_tx], [from.y_m, from_ty, to.y_m, to_ty]);
    let at = |t: f64| {
        let (t2, t3) = (t * t, t * t * t);
        let place = [2.0 * t3 - 3.0 * t2 + 1.0, t3 - 2.0 * t2 + t, -2.0 * t3 + 3.0 * t2, t3 - t2];
        let slope = [6.0 * t2 - 6.0 * t, 3.0 * t2 - 4.0 * t + 1.0, -6.0 * t2 + 6.0 * t, 3.0 * t2 - 2.0 * t];
        let yaw = sum(slope, ys).atan2(sum(slope, xs));
        Pose2d { x_m: sum(place, xs), y_m: sum(place, ys), yaw }
    };
    let mut points: Vec<(f64, Pose2d)> = vec![(0.0, from)];
    for index in 1..=POINTS {
        let (way_m, last) = points[index - 1];
        let place = at(index as f64 / POINTS as f64);
        points.push((way_m + last.distance_m(place), place));
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loop_is_smooth_and_leads_from_stop_to_stop() {
        let route = Route::through(&[]);
        for stop in 0..3 {
            let length_m = route.length_m(stop);
            assert!((150.0..400.0).contains(&length_m), "{length_m}");
            let (start, end) = (route.place(stop, 0.0), route.place(stop, length_m));
            let next = route.place(route.next(stop), 0.0);
            assert!(end.distance_m(next) < 1e-6 && end.turn_to(next).abs() < 1e-6, "{end:?} {next:?}");
            let mut last = start;
            for decimetre in 1..(length_m * 10.0) as usize {
                let place = route.place(stop, decimetre as f64 / 10.0);
                assert!((0.09..0.11).contains(&last.distance_m(place)), "{decimetre}");
                assert!(last.turn_to(place).abs() < 0.02, "{decimetre}: it would fall over");
                last = place;
            }
        }
        assert_eq!(route.place(0, -5.0), route.place(0, 0.0));
    }

    #[test]
    fn a_place_is_a_pose_and_back() {
        for yaw in [-3.1, -1.0, 0.0, 0.5, 3.1] {
            let place = Pose2d { x_m: 3.0, y_m: -2.0, yaw };
            assert!(Pose2d::of_pose(&place.pose()).turn_to(place).abs() < 1e-12);
        }
        let place = Pose2d { yaw: std::f64::consts::FRAC_PI_2, ..Pose2d::default() }.moved(2.0, 1.0, 3.0);
        assert!((place.x_m + 1.0).abs() < 1e-12 && (place.y_m - 2.0).abs() < 1e-12);
        assert!(place.yaw < 0.0);
    }
}
