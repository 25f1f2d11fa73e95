//! The simulated warehouse robot: it drives from its dock to two places and back, and charges. Pure, as the
//! shuttle is: given the time, it returns the messages that its nodes published until then.

mod statuses;
#[cfg(test)]
mod tests;
mod world;

use crate::machine::Clockwork;
use crate::machine::route::Route;
use crate::machine::{self, FaultInfo, Order};
use telltale_engine::input::StatusArray;
use telltale_engine::model::Stop;
use telltale_engine::model::sample::Pose;
use telltale_engine::text::Text;
use telltale_engine::time::{Span, Timestamp};
use world::World;

pub type Sent = machine::Sent<Message>;

/// Metres, seconds and radians; positions are in the frame of the map.
#[derive(Debug, Clone, PartialEq)]
pub enum Message {
    /// On `/diagnostics`, the status of one node.
    Diagnostics(StatusArray),
    /// One turn of a laser scanner.
    Scan(Lidar),
    Imu {
        yaw_rate: f64,
    },
    /// By the wheels.
    Odometry {
        pose: Pose,
        speed_mps: f64,
        yaw_rate: f64,
    },
    /// The origin of the odometry on the map, by the localization.
    MapToOdometry(Pose),
    /// The position by the localization, while the robot moves.
    Position {
        pose: Pose,
        variance_m2: f64,
    },
    /// The path that the planner found.
    Plan(Vec<Pose>),
    /// The surroundings of the robot, with the age of the map.
    Costmap {
        age: Span,
    },
    /// The commands of the controller to the base.
    Command {
        speed_mps: f64,
        yaw_rate: f64,
    },
    Battery {
        charge: f64,
        voltage_v: f64,
        current_a: f64,
    },
    Docked(bool),
    /// It has a goal, and drives there.
    Navigating(bool),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lidar {
    Front,
    Rear,
}

/// A fault that can be switched on and off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// No scans of the front scanner.
    LidarOutage,
    /// A wheel slips, so the odometry turns while the robot does not.
    WheelSlip,
    /// The scans fit the map in many places.
    LocalizationLost,
    /// The controller gives no commands.
    NavigationStall,
    /// The node of the controller ends.
    ControllerCrash,
    /// At the dock no current flows.
    DockingFailed,
    BatteryLow,
}

impl Fault {
    pub const ALL: [Fault; 7] = [
        Fault::LidarOutage,
        Fault::WheelSlip,
        Fault::LocalizationLost,
        Fault::NavigationStall,
        Fault::ControllerCrash,
        Fault::DockingFailed,
        Fault::BatteryLow,
    ];

    pub fn from_word(word: &str) -> Option<Fault> {
        Fault::ALL.into_iter().find(|fault| fault.info().name == word)
    }

    pub fn info(self) -> FaultInfo {
        let (name, title, about) = match self {
            Fault::LidarOutage => (
                "lidar_outage",
                ("Lidar outage", "Laserscanner-Ausfall"),
                ("The front scanner falls silent.", "Der vordere Scanner verstummt."),
            ),
            Fault::WheelSlip => (
                "wheel_slip",
                ("Wheel slip", "Rad rutscht durch"),
                (
                    "The wheels turn and the robot does not. Matters while it moves.",
                    "Die Räder drehen, der Roboter nicht. Zählt nur unterwegs.",
                ),
            ),
            Fault::LocalizationLost => (
                "localization_lost",
                ("Localization lost", "Position verloren"),
                (
                    "The scans fit the map in many places. Matters while it moves.",
                    "Die Scans passen an vielen Stellen zur Karte. Zählt nur unterwegs.",
                ),
            ),
            Fault::NavigationStall => (
                "navigation_stall",
                ("Navigation stall", "Navigation steht"),
                (
                    "The controller gives no commands. Matters on the way.",
                    "Die Regelung gibt keine Befehle. Zählt unterwegs.",
                ),
            ),
            Fault::ControllerCrash => (
                "controller_crash",
                ("Controller crash", "Regelung abgestürzt"),
                ("The node /controller_server ends.", "Der Knoten /controller_server endet."),
            ),
            Fault::DockingFailed => (
                "docking_failed",
                ("Docking failed", "Andocken misslungen"),
                (
                    "At the dock no current flows. Matters there.",
                    "An der Ladestation fließt kein Strom. Zählt nur dort.",
                ),
            ),
            Fault::BatteryLow => (
                "battery_low",
                ("Low battery", "Batterie schwach"),
                ("A warning that stops nothing.", "Eine Warnung, die nichts anhält."),
            ),
        };
        FaultInfo::new(name, title, about)
    }
}

/// The robot at one instant.
#[derive(Debug, Clone)]
pub struct Robot {
    world: World,
    clockwork: Clockwork,
}

impl Robot {
    /// A robot that has been standing at its dock for a while at `start`.
    pub fn new(seed: u64, start: Timestamp) -> Robot {
        let place = |id: &str, x_m, y_m, yaw_deg| {
            let (id, name) = (id.into(), Text::plain(id));
            Stop { id, name, x_m, y_m, yaw_deg }
        };
        let route = Route::through(&[
            place("dock", 0.0, 0.0, 0.0),
            place("aisle 7", 22.0, 9.0, 90.0),
            place("packing", 4.0, 16.0, 180.0),
        ]);
        Robot { world: World::new(seed, route), clockwork: Clockwork::new(start) }
    }

    /// Advances to `now` and returns the messages published meanwhile, in order.
    pub fn advance(&mut self, now: Timestamp) -> Vec<Sent> {
        let Robot { world, clockwork } = self;
        clockwork.advance(now, |send| {
            world.step();
            world.publish(send);
            statuses::publish(world, send);
        })
    }

    /// The names of its running nodes.
    pub fn nodes(&self) -> Vec<&'static str> {
        statuses::nodes(&self.world)
    }

    pub fn set_fault(&mut self, fault: Fault, on: bool) {
        self.world.set_fault(fault, on);
    }

    /// Its configuration asks for nothing; one that does is obeyed.
    pub fn obey(&mut self, order: Order) {
        self.world.obey(order);
    }
}
