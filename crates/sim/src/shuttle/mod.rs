//! The simulated shuttle on a loop of stops. Pure: given the time, it returns the messages that its nodes
//! published until then. The same seed, instants and orders give the same messages.
//!
//! Faults are faults of the data: packets stop, stamps lag, the position jumps. Everything else follows
//! from the flow of data as in a vehicle: a node that uses the data at once notices at once, one that
//! counts in a sliding window notices later (paper, Sec. V).

mod localizer;
mod statuses;
mod topics;
mod world;

use crate::machine::drive::{Departure, Drive, Pace};
use crate::machine::route::{Pose2d, Route};
use crate::machine::{self, FaultInfo, Order};
use crate::machine::{Clockwork, STEP_MS};
use statuses::Node;
use telltale_engine::input::StatusArray;
use telltale_engine::model::Stop;
use telltale_engine::model::sample::Pose;
use telltale_engine::time::{Span, Timestamp};
use topics::Topics;
use world::World;

/// Long enough that every part of the shuttle has its data when the first message is sent.
const WARM_UP_STEPS: u64 = 300;

/// The node of the drive-by-wire interface. It publishes topics and no status.
const CAN_GATEWAY: &str = "can_gateway";

pub type Sent = machine::Sent<Message>;

/// Metres, seconds and radians; poses are in the frame of the map unless stated otherwise.
#[derive(Debug, Clone, PartialEq)]
pub enum Message {
    /// On `/diagnostics`, the statuses of one node.
    Diagnostics(StatusArray),
    /// The packets of one turn of the LiDAR.
    Scan,
    /// The position by the localization.
    Position(Pose),
    /// The position by the wheels, from where they began to count.
    Odometry {
        pose: Pose,
        speed_mps: f64,
        yaw_rate: f64,
    },
    WheelSpeed {
        mps: f64,
    },
    Battery {
        charge: f64,
        voltage_v: f64,
        current_a: f64,
    },
    /// The surroundings of the shuttle, with the age of the map.
    Costmap {
        age: Span,
    },
    /// Other road users, relative to the shuttle.
    Objects(Vec<Pose>),
    /// Free road ahead.
    FreeDistance(f64),
    /// The trajectory of the planner.
    Trajectory(Vec<Pose>),
    /// The commands of the controller to the drive.
    SpeedCommand(f64),
    /// The next stop of the mission.
    Goal(Pose),
    /// The shuttle drives by itself.
    Active(bool),
    MissionState(&'static str),
    /// It brakes, or stands, because of a request.
    Decelerates(bool),
    /// It makes a safe stop because of a request.
    Stops(bool),
}

/// A fault that can be switched on and off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Fault {
    /// No packets from the LiDAR.
    SensorOutage,
    /// The position jumps by more than a metre, again and again.
    LocalizationJump,
    /// The obstacle map falls behind.
    CostmapDelay,
    /// The planner submits no trajectory, which matters only while driving.
    PlannerStall,
    /// No frames from the vehicle's bus.
    CanLoss,
    /// The battery is nearly empty, which is a WARNING.
    LowBattery,
    /// The driver of the front camera ends, and its node with it.
    CameraCrash,
}

impl Fault {
    pub const ALL: [Fault; 7] = [
        Fault::SensorOutage,
        Fault::LocalizationJump,
        Fault::CostmapDelay,
        Fault::PlannerStall,
        Fault::CanLoss,
        Fault::LowBattery,
        Fault::CameraCrash,
    ];

    pub fn from_word(word: &str) -> Option<Fault> {
        Fault::ALL.into_iter().find(|fault| fault.info().name == word)
    }

    pub fn info(self) -> FaultInfo {
        let (name, title, about) = match self {
            Fault::SensorOutage => (
                "sensor_outage",
                ("Sensor outage", "Sensorausfall"),
                (
                    "The LiDAR falls silent. Localization notices before Sensors does.",
                    "Der LiDAR verstummt. Die Lokalisierung merkt es vor den Sensoren.",
                ),
            ),
            Fault::LocalizationJump => (
                "localization_jump",
                ("Localization jump", "Positionssprung"),
                (
                    "The position jumps by more than a metre, again and again.",
                    "Die Position springt immer wieder um mehr als einen Meter.",
                ),
            ),
            Fault::CostmapDelay => (
                "costmap_delay",
                ("Costmap delay", "Hinderniskarte verspätet"),
                (
                    "The map of obstacles falls behind, by up to two seconds.",
                    "Die Hinderniskarte bleibt zurück, um bis zu zwei Sekunden.",
                ),
            ),
            Fault::PlannerStall => (
                "planner_stall",
                ("Planner stall", "Planung steht"),
                ("No new path. Matters only while driving.", "Kein neuer Weg. Zählt nur während der Fahrt."),
            ),
            Fault::CanLoss => (
                "can_loss",
                ("CAN loss", "CAN-Ausfall"),
                ("The vehicle bus falls silent.", "Der Fahrzeugbus verstummt."),
            ),
            Fault::LowBattery => (
                "low_battery",
                ("Low battery", "Batterie schwach"),
                ("A warning that stops nothing.", "Eine Warnung, die nichts anhält."),
            ),
            Fault::CameraCrash => (
                "camera_crash",
                ("Camera crash", "Kamera abgestürzt"),
                (
                    "The program of the front camera ends, and with it all that it said.",
                    "Das Programm der Frontkamera endet, und mit ihm seine Meldungen.",
                ),
            ),
        };
        FaultInfo::new(name, title, about)
    }
}

/// The shuttle at one instant.
#[derive(Debug, Clone)]
pub struct Shuttle {
    world: World,
    topics: Topics,
    clockwork: Clockwork,
}

impl Shuttle {
    /// A shuttle that has been standing at its first stop for a while at `start`. One that drives by itself
    /// knows its position; another one waits to be told.
    pub fn new(seed: u64, start: Timestamp, stops: &[Stop], departure: Departure) -> Shuttle {
        let drive = Drive::new(Route::through(stops), departure, pace(departure));
        let mut world = World::new(seed, drive, departure == Departure::Alone);
        for _ in 0..WARM_UP_STEPS {
            world.step(STEP_MS);
        }
        Shuttle { world, topics: Topics::default(), clockwork: Clockwork::new(start) }
    }

    /// Advances to `now` and returns the messages published meanwhile, in order.
    pub fn advance(&mut self, now: Timestamp) -> Vec<Sent> {
        let Shuttle { world, topics, clockwork } = self;
        clockwork.advance(now, |send| {
            world.step(STEP_MS);
            topics.publish(world, send);
        })
    }

    /// The names of its running nodes.
    pub fn nodes(&self) -> Vec<&'static str> {
        let running = Node::ALL.into_iter().filter(|node| node.runs(&self.world));
        running.map(Node::name).chain([CAN_GATEWAY]).collect()
    }

    pub fn set_fault(&mut self, fault: Fault, on: bool) {
        self.world.set_fault(fault, on);
    }

    /// A value that is not a number requests nothing.
    pub fn obey(&mut self, order: Order) {
        match order {
            Order::Localize(pose) => {
                let now_ms = self.world.now_ms();
                self.world.localizer.hint(Pose2d::of_pose(&pose), now_ms);
            }
            order => self.world.drive.obey(order),
        }
    }
}

/// A shuttle that drives by itself stands longer, so that somebody who has just started to watch sees it stand.
fn pace(departure: Departure) -> Pace {
    let (stands_ms, first_stands_ms) = match departure {
        Departure::Alone => (7_500, 17_500),
        Departure::Cleared => (5_000, 5_000),
    };
    Pace { speed_mps_max: 7.0, acceleration_mps2: 1.0, stands_ms, first_stands_ms }
}

#[cfg(test)]
mod tests;
