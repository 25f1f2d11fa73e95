//! What goes on inside the shuttle: data flows from the sensors to the actuators, and each part
//! knows how old its input is.

use std::collections::VecDeque;

use super::Fault;
use super::drive::Drive;

const SCAN_PERIOD_MS: u64 = 100;
const FRAME_PERIOD_MS: u64 = 20;
const IMAGE_PERIOD_MS: u64 = 33;
const PLAN_PERIOD_MS: u64 = 100;
/// A scan later than this is missed by those who wait for it.
pub(super) const SCAN_AGE_MS_MAX: u64 = 150;
pub(super) const FRAME_AGE_MS_MAX: u64 = 200;
/// Matching needs a few scans before its position is believed again.
const SETTLE_MS: u64 = 200;
const COSTMAP_DELAY_MS: f64 = 62.0;
const COSTMAP_DELAY_MS_FAULTY: f64 = 350.0;
/// Diagnosis complains earlier; a planner gives up on a map that is older than this.
const COSTMAP_DELAY_MS_MAX: f64 = 500.0;
/// After a slow spell the map works off its backlog for a while.
const COSTMAP_BACKLOG_MS: u64 = 600;
const POSE_GAP_MS_MAX: u64 = 250;
const PLAN_AGE_MS_MAX: u64 = 300;
pub(super) const PLAN_GAP_MS_MAX: u64 = 500;
/// A position that jumped must agree this long before it counts as good again.
const JUMP_MEMORY_MS: u64 = 1000;

#[derive(Debug, Clone)]
pub(super) struct World {
    now_ms: u64,
    noise: Noise,
    faults: [bool; Fault::ALL.len()],
    pub drive: Drive,
    scans: Feed,
    scans_enough: bool,
    frames: Feed,
    images: Feed,
    plans: Feed,
    /// Since when both inputs of the localization come without a gap.
    matching_since_ms: Option<u64>,
    pose_at_ms: u64,
    /// When the position was last good to drive by.
    pose_good_at_ms: u64,
    jumped_at_ms: Option<u64>,
    costmap_delay_ms: f64,
    costmap_slow_at_ms: Option<u64>,
    charge_percent: f64,
}

impl World {
    pub fn new(seed: u64) -> World {
        World {
            now_ms: 0,
            noise: Noise { state: seed },
            faults: [false; Fault::ALL.len()],
            drive: Drive::new(),
            scans: Feed::new(2000, SCAN_AGE_MS_MAX),
            scans_enough: true,
            frames: Feed::new(2000, FRAME_AGE_MS_MAX),
            images: Feed::new(1000, 1000),
            plans: Feed::new(1000, PLAN_GAP_MS_MAX),
            matching_since_ms: None,
            pose_at_ms: 0,
            pose_good_at_ms: 0,
            jumped_at_ms: None,
            costmap_delay_ms: COSTMAP_DELAY_MS,
            costmap_slow_at_ms: None,
            charge_percent: 78.0,
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
        let jitter = self.noise.up_to(8);
        self.scans.run(now, SCAN_PERIOD_MS, jitter, !self.has(Fault::SensorOutage));
        self.scans_enough = self.scan_rate_hz() >= if self.scans_enough { 5.0 } else { 7.0 };
        self.frames.run(now, FRAME_PERIOD_MS, 0, !self.has(Fault::CanLoss));
        self.images.run(now, IMAGE_PERIOD_MS, 0, true);
        self.localize();
        if self.pose_is_good() {
            self.pose_good_at_ms = now;
        }
        self.map_obstacles();
        let plannable = self.drive.planner_runs()
            && !self.has(Fault::PlannerStall)
            && self.pose_is_good()
            && self.costmap_delay_ms <= COSTMAP_DELAY_MS_MAX;
        self.plans.run(now, PLAN_PERIOD_MS, jitter / 2, plannable);
        let has_plan = self.plan_is_fresh();
        self.drive.step(step_ms, has_plan);
        self.charge_percent = (self.charge_percent - 2e-6 * self.drive.speed_mps).max(25.0);
    }

    fn localize(&mut self) {
        if self.has(Fault::LocalizationJump) {
            self.jumped_at_ms = Some(self.now_ms);
        }
        let fed = self.scan_age_ms() <= SCAN_AGE_MS_MAX && self.frame_age_ms() <= FRAME_AGE_MS_MAX;
        if !fed {
            self.matching_since_ms = None;
            return;
        }
        let since = *self.matching_since_ms.get_or_insert(self.now_ms);
        if self.now_ms - since >= SETTLE_MS {
            self.pose_at_ms = self.now_ms;
        }
    }

    /// The map is made of scans at known positions: it is as late as both.
    fn map_obstacles(&mut self) {
        if self.has(Fault::CostmapDelay) {
            self.costmap_slow_at_ms = Some(self.now_ms);
        }
        let slow = within(self.costmap_slow_at_ms, self.now_ms, COSTMAP_BACKLOG_MS);
        let own = if slow { COSTMAP_DELAY_MS_FAULTY } else { COSTMAP_DELAY_MS };
        let missed_ms = self.scan_age_ms().saturating_sub(SCAN_PERIOD_MS).max(self.pose_age_ms());
        self.costmap_delay_ms = own + missed_ms as f64;
    }

    pub fn scan_age_ms(&self) -> u64 {
        self.scans.age_ms(self.now_ms)
    }

    /// Scans per second, over two seconds.
    pub fn scan_rate_hz(&self) -> f64 {
        self.scans.rate_hz(self.now_ms)
    }

    /// Falls below five a second, and holds again from seven: at the limit it must not flicker.
    pub fn scans_are_enough(&self) -> bool {
        self.scans_enough
    }

    pub fn frame_age_ms(&self) -> u64 {
        self.frames.age_ms(self.now_ms)
    }

    /// For how long frames have come without a gap.
    pub fn frames_steady_ms(&self) -> u64 {
        self.frames.steady_ms(self.now_ms)
    }

    pub fn plans_steady_ms(&self) -> u64 {
        self.plans.steady_ms(self.now_ms)
    }

    pub fn frame_rate_hz(&self) -> f64 {
        self.frames.rate_hz(self.now_ms)
    }

    pub fn image_rate_hz(&self) -> f64 {
        self.images.rate_hz(self.now_ms)
    }

    pub fn plan_rate_hz(&self) -> f64 {
        self.plans.rate_hz(self.now_ms)
    }

    pub fn plan_age_ms(&self) -> u64 {
        self.plans.age_ms(self.now_ms)
    }

    pub fn plan_is_fresh(&self) -> bool {
        self.plan_age_ms() <= PLAN_AGE_MS_MAX
    }

    pub fn pose_age_ms(&self) -> u64 {
        self.now_ms - self.pose_at_ms
    }

    fn pose_is_good(&self) -> bool {
        self.pose_age_ms() <= SCAN_AGE_MS_MAX && !self.has(Fault::LocalizationJump)
    }

    /// Who works with the position bridges a short gap before giving up.
    pub fn pose_is_missed(&self) -> bool {
        self.now_ms - self.pose_good_at_ms > POSE_GAP_MS_MAX
    }

    /// The position is, or was a moment ago, off what the wheels and the motion sensor say.
    pub fn jumped(&self) -> bool {
        within(self.jumped_at_ms, self.now_ms, JUMP_MEMORY_MS)
    }

    pub fn costmap_delay_ms(&mut self) -> f64 {
        self.measured(self.costmap_delay_ms, 8.0)
    }

    pub fn charge_percent(&self) -> f64 {
        if self.has(Fault::LowBattery) { 17.0 } else { self.charge_percent }
    }

    /// A value as it is measured: `mean`, give or take `spread`.
    pub fn measured(&mut self, mean: f64, spread: f64) -> f64 {
        mean + self.noise.around(spread)
    }
}

fn within(then_ms: Option<u64>, now_ms: u64, span_ms: u64) -> bool {
    then_ms.is_some_and(|then_ms| now_ms - then_ms < span_ms)
}

/// Messages of one kind: when the last came, and how many within a sliding window.
#[derive(Debug, Clone)]
struct Feed {
    window_ms: u64,
    /// Whoever comes later than this leaves a gap.
    gap_ms: u64,
    next_ms: u64,
    last_ms: u64,
    /// The first after the last gap.
    resumed_ms: u64,
    times_ms: VecDeque<u64>,
}

impl Feed {
    fn new(window_ms: u64, gap_ms: u64) -> Feed {
        Feed { window_ms, gap_ms, next_ms: 0, last_ms: 0, resumed_ms: 0, times_ms: VecDeque::new() }
    }

    /// The source keeps its rhythm whether or not what it sends arrives.
    fn run(&mut self, now_ms: u64, period_ms: u64, jitter_ms: u64, arrives: bool) {
        while self.times_ms.front().is_some_and(|&time| time + self.window_ms <= now_ms) {
            self.times_ms.pop_front();
        }
        while self.next_ms + jitter_ms <= now_ms {
            self.next_ms += period_ms;
            if arrives {
                if now_ms - self.last_ms > self.gap_ms {
                    self.resumed_ms = now_ms;
                }
                self.last_ms = now_ms;
                self.times_ms.push_back(now_ms);
            }
        }
    }

    fn age_ms(&self, now_ms: u64) -> u64 {
        now_ms - self.last_ms
    }

    fn steady_ms(&self, now_ms: u64) -> u64 {
        if self.age_ms(now_ms) > self.gap_ms { 0 } else { now_ms - self.resumed_ms }
    }

    fn rate_hz(&self, now_ms: u64) -> f64 {
        let inside = self.times_ms.iter().filter(|&&time| time + self.window_ms > now_ms).count();
        inside as f64 * 1000.0 / self.window_ms as f64
    }
}

/// SplitMix64: enough for plausible numbers, and the same ones everywhere.
#[derive(Debug, Clone)]
struct Noise {
    state: u64,
}

impl Noise {
    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn up_to(&mut self, most: u64) -> u64 {
        self.next() % (most + 1)
    }

    fn around(&mut self, spread: f64) -> f64 {
        let unit = (self.next() >> 11) as f64 / (1u64 << 53) as f64;
        (unit * 2.0 - 1.0) * spread
    }
}
