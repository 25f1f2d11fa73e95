//! The journey of a machine: stand at a stop, drive to the next one, and again.

use super::Order;
use super::obedience::Obedience;
use super::route::{Pose2d, Route};

/// The planner starts before the shuttle, so that its checks have settled when they begin to matter.
const PLANNER_LEAD_MS: u64 = 2_500;
/// The planner runs a little beyond the arrival, so that its last messages do not race the end of the
/// drive.
const PLANNER_TRAIL_MS: u64 = 500;
/// Without a trajectory it rolls to a halt.
const ROLL_OUT_MPS2: f64 = 0.5;
/// The speed on the last centimetres; the braking curve alone would never end.
const CREEP_MPS: f64 = 0.2;

/// The party that decides when the shuttle may leave a stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Departure {
    /// Nobody: it leaves by itself.
    Alone,
    /// The operator, by a clearance for each journey.
    Cleared,
}

/// How fast a machine is, and how long it stands.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pace {
    pub speed_mps_max: f64,
    pub acceleration_mps2: f64,
    /// From the arrival until the mission names the next goal.
    pub stands_ms: u64,
    /// The same before the first drive.
    pub first_stands_ms: u64,
}

#[derive(Debug, Clone)]
pub(crate) struct Drive {
    route: Route,
    departure: Departure,
    pace: Pace,
    /// The stop where it stands, or which it left last.
    stop: usize,
    phase: Phase,
    cleared: bool,
    /// A clearance that is not used up.
    fresh: bool,
    pub obedience: Obedience,
    pub speed_mps: f64,
    pub odometer_m: f64,
}

#[derive(Debug, Clone, Copy)]
enum Phase {
    /// No goal yet.
    Boarding {
        elapsed_ms: u64,
        total_ms: u64,
    },
    /// There is a goal, and the shuttle may not leave yet.
    Waiting,
    /// It may leave; the planner begins.
    Departing {
        elapsed_ms: u64,
    },
    Driving {
        left_m: f64,
        since_ms: u64,
    },
}

impl Drive {
    pub fn new(route: Route, departure: Departure, pace: Pace) -> Drive {
        let total_ms = pace.first_stands_ms;
        Drive {
            route,
            departure,
            pace,
            stop: 0,
            phase: Phase::Boarding { elapsed_ms: PLANNER_TRAIL_MS, total_ms },
            cleared: false,
            fresh: false,
            obedience: Obedience::default(),
            speed_mps: 0.0,
            odometer_m: 0.0,
        }
    }

    /// Takes an order. One clearance is good for one journey: only a new one counts.
    pub fn obey(&mut self, order: Order) {
        match order {
            Order::Clear(cleared) => {
                self.fresh = cleared && (self.fresh || !self.cleared);
                self.cleared = cleared;
            }
            Order::Decelerate(mps2) => self.obedience.decelerate(mps2),
            Order::Stop(asked) => self.obedience.maneuver_stop(asked),
            Order::Hold(held) => self.obedience.hold(held),
            Order::Localize(_) => {}
        }
    }

    /// `located`: the shuttle knows its position; otherwise the mission names no goal. `has_plan`: there is
    /// a fresh trajectory; without one the shuttle brakes and waits.
    pub fn step(&mut self, step_ms: u64, located: bool, has_plan: bool) {
        let braking_mps2 = self.obedience.step(step_ms);
        let may_leave = !self.obedience.holds() && (self.departure == Departure::Alone || self.fresh);
        match self.phase {
            Phase::Boarding { elapsed_ms, total_ms } if elapsed_ms < total_ms => {
                let elapsed_ms = elapsed_ms + if located { step_ms } else { 0 };
                self.phase = Phase::Boarding { elapsed_ms, total_ms };
            }
            Phase::Boarding { .. } => self.phase = Phase::Waiting,
            Phase::Waiting if may_leave => {
                self.phase = Phase::Departing { elapsed_ms: 0 };
            }
            Phase::Waiting => {}
            Phase::Departing { .. } if !may_leave => self.phase = Phase::Waiting,
            Phase::Departing { elapsed_ms } if elapsed_ms < PLANNER_LEAD_MS => {
                self.phase = Phase::Departing { elapsed_ms: elapsed_ms + step_ms };
            }
            Phase::Departing { .. } => {
                self.phase = Phase::Driving { left_m: self.route.length_m(self.stop), since_ms: 0 };
            }
            Phase::Driving { left_m, since_ms } => {
                let step_s = step_ms as f64 / 1000.0;
                self.speed_mps = self.next_speed(step_s, left_m, has_plan, braking_mps2);
                self.odometer_m += self.speed_mps * step_s;
                let left_m = left_m - self.speed_mps * step_s;
                self.phase = Phase::Driving { left_m, since_ms: since_ms + step_ms };
                if left_m <= 0.0 {
                    self.arrive();
                }
            }
        }
    }

    fn next_speed(&self, step_s: f64, left_m: f64, has_plan: bool, braking_mps2: Option<f64>) -> f64 {
        let Pace { speed_mps_max, acceleration_mps2, .. } = self.pace;
        let (wanted, brake_mps2) = if has_plan {
            let curve = (2.0 * acceleration_mps2 * left_m).sqrt().clamp(CREEP_MPS, speed_mps_max);
            (curve, acceleration_mps2)
        } else {
            (0.0, ROLL_OUT_MPS2)
        };
        let change = (wanted - self.speed_mps).clamp(-brake_mps2 * step_s, acceleration_mps2 * step_s);
        let limit = braking_mps2.map_or(f64::INFINITY, |mps2| self.speed_mps - mps2 * step_s);
        (self.speed_mps + change).min(limit).max(0.0)
    }

    fn arrive(&mut self) {
        self.speed_mps = 0.0;
        self.fresh = false;
        self.stop = self.route.next(self.stop);
        self.phase = Phase::Boarding { elapsed_ms: 0, total_ms: self.pace.stands_ms };
    }

    /// It drives by itself: true until the arrival, also while it waits on the way.
    pub fn active(&self) -> bool {
        matches!(self.phase, Phase::Driving { .. })
    }

    pub fn planner_runs(&self) -> bool {
        match self.phase {
            Phase::Driving { .. } | Phase::Departing { .. } => true,
            Phase::Boarding { elapsed_ms, .. } => elapsed_ms < PLANNER_TRAIL_MS,
            Phase::Waiting => false,
        }
    }

    /// The next stop of the mission, while it waits to leave.
    pub fn goal(&self) -> Option<Pose2d> {
        let waits = matches!(self.phase, Phase::Waiting | Phase::Departing { .. });
        waits.then(|| self.route.place(self.route.next(self.stop), 0.0))
    }

    /// The true pose of the shuttle.
    pub fn place(&self) -> Pose2d {
        let left_m = self.left_m().unwrap_or(f64::INFINITY);
        self.route.place(self.stop, self.route.length_m(self.stop) - left_m)
    }

    /// Its pose after so many more metres, at the next stop at most.
    pub fn ahead(&self, way_m: f64) -> Pose2d {
        let along_m = self.left_m().map_or(0.0, |left_m| self.route.length_m(self.stop) - left_m);
        self.route.place(self.stop, along_m + way_m)
    }

    /// The remaining way to the next stop; `None` while standing at one.
    pub fn left_m(&self) -> Option<f64> {
        match self.phase {
            Phase::Driving { left_m, .. } => Some(left_m),
            _ => None,
        }
    }

    /// For how long it has been driving.
    pub fn driving_ms(&self) -> u64 {
        match self.phase {
            Phase::Driving { since_ms, .. } => since_ms,
            _ => 0,
        }
    }

    /// The mission's status text.
    pub fn state(&self) -> &'static str {
        match self.phase {
            Phase::Boarding { .. } => "boarding",
            Phase::Waiting => "waiting",
            Phase::Departing { .. } => "departing",
            Phase::Driving { .. } => "driving",
        }
    }

    /// The number of the stop where it stands.
    pub fn stands_at(&self) -> Option<usize> {
        (!self.active()).then_some(self.stop)
    }

    pub fn here(&self) -> &str {
        self.route.name(self.stop)
    }

    pub fn next(&self) -> &str {
        self.route.name(self.route.next(self.stop))
    }
}
