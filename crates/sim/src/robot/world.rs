//! The flow of data inside the robot, from the scanners to the wheels, and the topics that show it.

use super::{Fault, Lidar, Message};
use crate::machine::Order;
use crate::machine::STEP_MS;
use crate::machine::drive::{Departure, Drive, Pace};
use crate::machine::feed::{Feed, Noise};
use crate::machine::route::{Pose2d, Route};
use telltale_engine::time::Span;

const PACE: Pace =
    Pace { speed_mps_max: 1.2, acceleration_mps2: 0.5, stands_ms: 8_000, first_stands_ms: 12_000 };
/// The stop at which it charges.
const DOCK: usize = 0;
const SCAN_PERIOD_MS: u64 = 100;
/// Without scans for so long, the controller does not go on.
const SCAN_AGE_MS_MAX: u64 = 500;
/// Without its controller for so long, Nav2 takes itself out of service.
const BOND_MS_MAX: u64 = 4_000;
/// The odometry of a wheel that slips turns this much faster than the robot.
const SLIP_RAD_S: f64 = 0.5;
const VARIANCE_M2: f64 = 0.02;
const VARIANCE_M2_LOST: f64 = 2.4;
const PLAN_M: f64 = 5.0;
const PLAN_POINTS: usize = 20;
const CHARGE: f64 = 0.84;
const CHARGE_LOW: f64 = 0.16;

#[derive(Debug, Clone)]
pub(super) struct World {
    now_ms: u64,
    noise: Noise,
    faults: [bool; Fault::ALL.len()],
    drive: Drive,
    scans: [Feed; 2],
    /// Whether a scan of each scanner arrived in this step.
    scanned: [bool; 2],
    odometry: Pose2d,
    yaw_rate: f64,
    navigating: bool,
    docked: bool,
    /// When the controller was last there.
    controller_at_ms: u64,
}

impl World {
    pub fn new(seed: u64, route: Route) -> World {
        World {
            now_ms: 0,
            noise: Noise::new(seed),
            faults: [false; Fault::ALL.len()],
            drive: Drive::new(route, Departure::Alone, PACE),
            scans: [Feed::new(SCAN_PERIOD_MS), Feed::new(SCAN_PERIOD_MS)],
            scanned: [false; 2],
            odometry: Pose2d::default(),
            yaw_rate: 0.0,
            navigating: false,
            docked: true,
            controller_at_ms: 0,
        }
    }

    pub fn now_ms(&self) -> u64 {
        self.now_ms
    }

    pub fn set_fault(&mut self, fault: Fault, on: bool) {
        self.faults[fault as usize] = on;
    }

    pub fn obey(&mut self, order: Order) {
        self.drive.obey(order);
    }

    pub fn has(&self, fault: Fault) -> bool {
        self.faults[fault as usize]
    }

    pub fn docked(&self) -> bool {
        self.docked
    }

    /// The lifecycle manager has not heard of the controller for too long.
    pub fn misses_controller(&self) -> bool {
        self.now_ms - self.controller_at_ms > BOND_MS_MAX
    }

    pub fn measured(&mut self, mean: f64, spread: f64) -> f64 {
        mean + self.noise.around(spread)
    }

    /// One round through the robot, in the direction of the data.
    pub fn step(&mut self) {
        self.now_ms += STEP_MS;
        let now_ms = self.now_ms;
        if !self.has(Fault::ControllerCrash) {
            self.controller_at_ms = now_ms;
        }
        let jitter_ms = self.noise.up_to(8);
        let arrives = [!self.has(Fault::LidarOutage), true];
        for (index, arrives) in arrives.into_iter().enumerate() {
            self.scanned[index] = self.scans[index].run(now_ms, jitter_ms, arrives);
        }
        let before = self.drive.place();
        self.drive.step(STEP_MS, true, self.controls());
        let step_s = STEP_MS as f64 / 1000.0;
        self.yaw_rate = before.turn_to(self.drive.place()) / step_s;
        self.odometry =
            self.odometry.moved(self.drive.speed_mps * step_s, 0.0, self.wheel_yaw_rate() * step_s);
    }

    /// The controller gives commands.
    fn controls(&self) -> bool {
        let stops =
            [Fault::LocalizationLost, Fault::NavigationStall, Fault::ControllerCrash].map(|it| self.has(it));
        !stops.contains(&true) && self.scans[Lidar::Front as usize].age_ms(self.now_ms) <= SCAN_AGE_MS_MAX
    }

    fn wheel_yaw_rate(&self) -> f64 {
        let slips = self.has(Fault::WheelSlip) && self.drive.speed_mps > 0.05;
        self.yaw_rate + if slips { SLIP_RAD_S } else { 0.0 }
    }

    pub fn publish(&mut self, send: &mut dyn FnMut(Message)) {
        let now_ms = self.now_ms;
        let due = |every_ms: u64| now_ms.is_multiple_of(every_ms);
        for lidar in [Lidar::Front, Lidar::Rear] {
            if self.scanned[lidar as usize] {
                send(Message::Scan(lidar));
            }
        }
        if due(20) {
            let yaw_rate = self.measured(self.yaw_rate, 0.01);
            send(Message::Imu { yaw_rate });
        }
        if due(50) {
            let (pose, speed_mps) = (self.odometry.pose(), self.drive.speed_mps);
            send(Message::Odometry { pose, speed_mps, yaw_rate: self.wheel_yaw_rate() });
        }
        if due(100) {
            send(Message::MapToOdometry(Pose2d::default().pose()));
        }
        let navigating = self.drive.active();
        if navigating {
            self.navigate(send);
        }
        if std::mem::replace(&mut self.navigating, navigating) != navigating || due(500) {
            send(Message::Navigating(navigating));
        }
        let docked = self.drive.stands_at() == Some(DOCK);
        if std::mem::replace(&mut self.docked, docked) != docked || due(500) {
            send(Message::Docked(docked));
        }
        if due(200) && !self.has(Fault::ControllerCrash) {
            let age_ms = self.measured(80.0, 10.0);
            send(Message::Costmap { age: Span::from_nanos((age_ms * 1e6) as u64) });
        }
        if due(500) {
            self.battery(send);
        }
    }

    fn navigate(&mut self, send: &mut dyn FnMut(Message)) {
        let departs = !self.navigating;
        let due = |every_ms: u64| departs || self.now_ms.is_multiple_of(every_ms);
        if due(50) && self.controls() {
            send(Message::Command { speed_mps: self.drive.speed_mps, yaw_rate: self.yaw_rate });
        }
        if due(500) {
            let place = |index: usize| self.drive.ahead(PLAN_M * index as f64 / PLAN_POINTS as f64).pose();
            send(Message::Plan((0..=PLAN_POINTS).map(place).collect()));
            let variance_m2 = if self.has(Fault::LocalizationLost) { VARIANCE_M2_LOST } else { VARIANCE_M2 };
            send(Message::Position { pose: self.drive.place().pose(), variance_m2 });
        }
    }

    fn battery(&mut self, send: &mut dyn FnMut(Message)) {
        let charge = if self.has(Fault::BatteryLow) { CHARGE_LOW } else { CHARGE };
        let charges = self.docked && !self.has(Fault::DockingFailed);
        let current_a = if charges { 9.0 } else { -1.5 - 3.0 * self.drive.speed_mps };
        let current_a = self.measured(current_a, 0.2);
        let voltage_v = self.measured(23.2 + 3.4 * charge, 0.03);
        send(Message::Battery { charge, voltage_v, current_a });
    }
}
