//! The journey: standing at a stop, driving to the next one, and again.

const STOPS: [&str; 3] = ["Depot", "Main Station", "Campus"];
/// Length of the way from each stop to the next.
const LEGS_M: [f64; 3] = [200.0, 210.0, 195.0];
const BOARDING_MS: u64 = 10_000;
/// The first stop is longer, so that somebody who has just started the demo can log in.
const FIRST_BOARDING_MS: u64 = 20_000;
/// The planner starts before the shuttle does: its checks are settled when they begin to matter.
const PLANNER_LEAD_MS: u64 = 2_500;
/// The planner outlives the arrival a little: its last words must not race the end of the drive.
const PLANNER_TRAIL_MS: u64 = 500;
const SPEED_MPS_MAX: f64 = 5.0;
const ACCELERATION_MPS2: f64 = 1.0;
/// The last centimetres are crept, or the braking curve would never end.
const CREEP_MPS: f64 = 0.2;

#[derive(Debug, Clone)]
pub(super) struct Drive {
    /// The stop where it stands or which it left last.
    stop: usize,
    phase: Phase,
    pub speed_mps: f64,
    pub odometer_m: f64,
}

#[derive(Debug, Clone, Copy)]
enum Phase {
    Boarding { elapsed_ms: u64, total_ms: u64 },
    Driving { left_m: f64 },
}

impl Drive {
    pub fn new() -> Drive {
        let phase = Phase::Boarding { elapsed_ms: PLANNER_TRAIL_MS, total_ms: FIRST_BOARDING_MS };
        Drive { stop: 0, phase, speed_mps: 0.0, odometer_m: 0.0 }
    }

    /// `has_plan`: a fresh trajectory is there. Without one the shuttle brakes and waits.
    pub fn step(&mut self, step_ms: u64, has_plan: bool) {
        match &mut self.phase {
            Phase::Boarding { elapsed_ms, total_ms } => {
                *elapsed_ms += step_ms;
                if *elapsed_ms >= *total_ms {
                    self.phase = Phase::Driving { left_m: LEGS_M[self.stop] };
                }
            }
            Phase::Driving { left_m } => {
                let step_s = step_ms as f64 / 1000.0;
                let wanted = if has_plan {
                    (2.0 * ACCELERATION_MPS2 * *left_m).sqrt().clamp(CREEP_MPS, SPEED_MPS_MAX)
                } else {
                    0.0
                };
                let change = ACCELERATION_MPS2 * step_s;
                self.speed_mps += (wanted - self.speed_mps).clamp(-change, change);
                self.odometer_m += self.speed_mps * step_s;
                *left_m -= self.speed_mps * step_s;
                if *left_m <= 0.0 {
                    self.speed_mps = 0.0;
                    self.stop = (self.stop + 1) % STOPS.len();
                    self.phase = Phase::Boarding { elapsed_ms: 0, total_ms: BOARDING_MS };
                }
            }
        }
    }

    /// It drives by itself. True until the arrival, also while it waits on the way.
    pub fn active(&self) -> bool {
        matches!(self.phase, Phase::Driving { .. })
    }

    pub fn planner_runs(&self) -> bool {
        match self.phase {
            Phase::Driving { .. } => true,
            Phase::Boarding { elapsed_ms, total_ms } => {
                elapsed_ms < PLANNER_TRAIL_MS || elapsed_ms + PLANNER_LEAD_MS >= total_ms
            }
        }
    }

    /// The way that is left to the next stop; none while standing at one.
    pub fn left_m(&self) -> Option<f64> {
        match self.phase {
            Phase::Driving { left_m } => Some(left_m),
            Phase::Boarding { .. } => None,
        }
    }

    pub fn departs_in_s(&self) -> Option<u64> {
        match self.phase {
            Phase::Driving { .. } => None,
            Phase::Boarding { elapsed_ms, total_ms } => Some((total_ms - elapsed_ms).div_ceil(1000)),
        }
    }

    pub fn here(&self) -> &'static str {
        STOPS[self.stop]
    }

    pub fn next(&self) -> &'static str {
        STOPS[(self.stop + 1) % STOPS.len()]
    }
}
