//! The flow of data inside the shuttle, from the sensors to the actuators. Each part knows the age of its
//! input.

use super::Fault;
use super::localizer::{Fed, Localizer};
use crate::machine::drive::Drive;
use crate::machine::feed::{Feed, Noise};

const SCAN_PERIOD_MS: u64 = 100;
const FRAME_PERIOD_MS: u64 = 20;
const PLAN_PERIOD_MS: u64 = 100;
/// A scan later than this is missed by the nodes that wait for it.
const SCAN_AGE_MS_MAX: u64 = 150;
const FRAME_AGE_MS_MAX: u64 = 200;
const COSTMAP_DELAY_MS: f64 = 62.0;
/// A map that falls behind does so as fast as time passes, up to here.
const COSTMAP_DELAY_MS_FAULTY: f64 = 2_000.0;
/// It catches up so many times as fast.
const COSTMAP_CATCHES_UP: f64 = 4.0;
/// Diagnosis complains earlier; a planner gives up on a map that misses scans or positions for longer than this.
const COSTMAP_MISSES_MS_MAX: f64 = 440.0;
/// A map without new data is not published for ever.
const COSTMAP_MISSED_MS_MAX: u64 = 2000;
/// Without a scan for so long, nothing is seen.
const BLIND_AFTER_MS: u64 = 400;
const POSE_GAP_MS_MAX: u64 = 250;
const PLAN_AGE_MS_MAX: u64 = 300;
const CHARGE: f64 = 0.78;
const CHARGE_FAULTY: f64 = 0.17;

#[derive(Debug, Clone)]
pub(super) struct World {
    now_ms: u64,
    noise: Noise,
    faults: [bool; Fault::ALL.len()],
    pub drive: Drive,
    pub localizer: Localizer,
    scans: Feed,
    frames: Feed,
    plans: Feed,
    /// The inputs that arrived in this step.
    pub arrived: Arrived,
    /// When the position was last good enough to drive.
    pose_good_at_ms: u64,
    costmap_delay_ms: f64,
    /// Without what it misses.
    costmap_own_ms: f64,
    charge: f64,
}

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Arrived {
    pub scan: bool,
    pub frame: bool,
    pub plan: bool,
}

impl World {
    pub fn new(seed: u64, drive: Drive, located: bool) -> World {
        World {
            now_ms: 0,
            noise: Noise::new(seed),
            faults: [false; Fault::ALL.len()],
            localizer: Localizer::new(drive.place(), located),
            drive,
            scans: Feed::new(SCAN_PERIOD_MS),
            frames: Feed::new(FRAME_PERIOD_MS),
            plans: Feed::new(PLAN_PERIOD_MS),
            arrived: Arrived::default(),
            pose_good_at_ms: 0,
            costmap_delay_ms: COSTMAP_DELAY_MS,
            costmap_own_ms: COSTMAP_DELAY_MS,
            charge: CHARGE,
        }
    }

    pub fn now_ms(&self) -> u64 {
        self.now_ms
    }

    pub fn set_fault(&mut self, fault: Fault, on: bool) {
        self.faults[fault as usize] = on;
    }

    pub fn has(&self, fault: Fault) -> bool {
        self.faults[fault as usize]
    }

    /// One round through the vehicle, in the direction of the data.
    pub fn step(&mut self, step_ms: u64) {
        self.now_ms += step_ms;
        let now = self.now_ms;
        let before = self.drive.place();
        self.drive.step(step_ms, self.localizer.publishes(now), self.plan_age_ms() <= PLAN_AGE_MS_MAX);
        let place = self.drive.place();

        let jitter_ms = self.noise.up_to(8);
        self.arrived.scan = self.scans.run(now, jitter_ms, !self.has(Fault::SensorOutage));
        self.arrived.frame = self.frames.run(now, 0, !self.has(Fault::CanLoss));
        let fed = Fed {
            scans: self.scan_age_ms() <= SCAN_AGE_MS_MAX,
            wheels: self.frame_age_ms() <= FRAME_AGE_MS_MAX,
        };
        let jumps = self.has(Fault::LocalizationJump);
        self.localizer.step(now, place, fed, jumps, &mut self.noise);
        // The wheels go on counting while nobody receives them.
        let step_s = step_ms as f64 / 1000.0;
        let turn = before.turn_to(place);
        self.localizer.count(self.drive.speed_mps * step_s, turn, step_s, &mut self.noise);
        if self.pose_is_good() {
            self.pose_good_at_ms = now;
        }
        self.map_obstacles(step_ms as f64);
        let plannable = self.drive.planner_runs()
            && !self.has(Fault::PlannerStall)
            && self.pose_is_good()
            && self.costmap_delay_ms - self.costmap_own_ms <= COSTMAP_MISSES_MS_MAX;
        self.arrived.plan = self.plans.run(now, jitter_ms / 2, plannable);
        let used = 2e-8 * self.drive.speed_mps * step_ms as f64 / 10.0;
        self.charge = (self.charge - used).max(0.25);
    }

    /// The map is made of scans at known positions, so it is as late as both.
    fn map_obstacles(&mut self, step_ms: f64) {
        let changed_ms = if self.has(Fault::CostmapDelay) { step_ms } else { -COSTMAP_CATCHES_UP * step_ms };
        let own_ms = (self.costmap_own_ms + changed_ms).clamp(COSTMAP_DELAY_MS, COSTMAP_DELAY_MS_FAULTY);
        self.costmap_own_ms = own_ms;
        let pose_age_ms = self.localizer.pose_age_ms(self.now_ms);
        let missed_ms = self.scan_age_ms().saturating_sub(SCAN_PERIOD_MS).max(pose_age_ms);
        self.costmap_delay_ms = own_ms + missed_ms.min(COSTMAP_MISSED_MS_MAX) as f64;
    }

    pub fn scan_age_ms(&self) -> u64 {
        self.scans.age_ms(self.now_ms)
    }

    pub fn frame_age_ms(&self) -> u64 {
        self.frames.age_ms(self.now_ms)
    }

    pub fn plan_age_ms(&self) -> u64 {
        self.plans.age_ms(self.now_ms)
    }

    fn pose_is_good(&self) -> bool {
        self.localizer.pose_age_ms(self.now_ms) <= SCAN_AGE_MS_MAX && !self.has(Fault::LocalizationJump)
    }

    /// Users of the position bridge a short gap before they give up.
    pub fn pose_is_missed(&self) -> bool {
        self.now_ms - self.pose_good_at_ms > POSE_GAP_MS_MAX
    }

    /// None of the surroundings is seen.
    pub fn blind(&self) -> bool {
        self.scan_age_ms() > BLIND_AFTER_MS
    }

    pub fn costmap_delay_ms(&mut self) -> f64 {
        self.measured(self.costmap_delay_ms, 8.0)
    }

    /// The charge of the battery, from 0 to 1.
    pub fn charge(&self) -> f64 {
        if self.has(Fault::LowBattery) { CHARGE_FAULTY } else { self.charge }
    }

    /// A measured value: `mean`, give or take `spread`.
    pub fn measured(&mut self, mean: f64, spread: f64) -> f64 {
        mean + self.noise.around(spread)
    }
}
