//! The simulated shuttle on a loop of stops. Pure: given the time, it returns the messages that its nodes
//! published until then. The same seed, instants and orders give the same messages.
//!
//! Faults are faults of the data: packets stop, stamps lag, the position jumps. Everything else follows
//! from the flow of data as in a vehicle: a node that uses the data at once notices at once, one that
//! counts in a sliding window notices later (paper, Sec. V).

mod drive;
mod feed;
mod localizer;
mod obedience;
mod route;
mod statuses;
mod topics;
mod world;

use crate::engine::input::StatusArray;
use crate::engine::model::Stop;
use crate::engine::model::sample::Pose;
use crate::engine::time::{Span, Timestamp};
pub use drive::Departure;
use drive::Drive;
use route::{Pose2d, Route};
use statuses::Node;
use topics::Topics;
use world::World;

/// The step of the shuttle's own time. Calling [`Shuttle::advance`] this often loses nothing.
pub const STEP: Span = Span::from_millis(STEP_MS);
const STEP_MS: u64 = 10;

/// The longest time that one call catches up: a process that was stopped does not flood the bus.
const CATCH_UP_STEPS: u64 = 500;

/// Long enough that every part of the shuttle has its data when the first message is sent.
const WARM_UP_STEPS: u64 = 300;

/// A message of a node of the shuttle and its time, which is the stamp of its header, if it has one, unless
/// the message says otherwise.
#[derive(Debug, Clone, PartialEq)]
pub struct Sent {
    pub at: Timestamp,
    pub message: Message,
}

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

/// An order to the shuttle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// The operator says that it stands about there.
    Localize(Pose),
    /// Whether it may drive to its goal.
    Clear(bool),
    /// A request to slow down by so many m/s²; it holds while it is repeated.
    Decelerate(f64),
    /// Whether it must make a safe stop and stand.
    Stop(bool),
}

/// A fault that can be switched on and off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Fault {
    /// No packets from the LiDAR.
    SensorOutage,
    /// The position jumps by more than a metre, and back, again and again.
    LocalizationJump,
    /// The obstacle map is late.
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

    /// The word on the command line and in the demo's form.
    pub const fn as_str(self) -> &'static str {
        match self {
            Fault::SensorOutage => "sensor_outage",
            Fault::LocalizationJump => "localization_jump",
            Fault::CostmapDelay => "costmap_delay",
            Fault::PlannerStall => "planner_stall",
            Fault::CanLoss => "can_loss",
            Fault::LowBattery => "low_battery",
            Fault::CameraCrash => "camera_crash",
        }
    }

    pub fn from_word(word: &str) -> Option<Fault> {
        Fault::ALL.into_iter().find(|fault| fault.as_str() == word)
    }

    /// Its effect, in one line for people.
    pub const fn about(self) -> &'static str {
        match self {
            Fault::SensorOutage => "LiDAR packets stop; Localization notices before Sensors does",
            Fault::LocalizationJump => "the position jumps by 1.2 m and back",
            Fault::CostmapDelay => "the obstacle map comes 350 ms late",
            Fault::PlannerStall => "no trajectories; matters only while driving",
            Fault::CanLoss => "no frames from the vehicle's bus",
            Fault::LowBattery => "a warning",
            Fault::CameraCrash => "the front camera's node is gone, and with it all that it said",
        }
    }
}

/// The shuttle at one instant.
#[derive(Debug, Clone)]
pub struct Shuttle {
    world: World,
    topics: Topics,
    /// When the next step is due.
    due: Timestamp,
}

impl Shuttle {
    /// A shuttle that has been standing at its first stop for a while at `start`. One that drives by itself
    /// knows its position; another one waits to be told.
    pub fn new(seed: u64, start: Timestamp, stops: &[Stop], departure: Departure) -> Shuttle {
        let drive = Drive::new(Route::through(stops), departure);
        let mut world = World::new(seed, drive, departure == Departure::Alone);
        for _ in 0..WARM_UP_STEPS {
            world.step(STEP_MS);
        }
        Shuttle { world, topics: Topics::default(), due: start + STEP }
    }

    /// Advances to `now` and returns the messages published meanwhile, in order. Of more than five seconds,
    /// only the last five happen.
    pub fn advance(&mut self, now: Timestamp) -> Vec<Sent> {
        let backlog = now.since(self.due).as_nanos() / STEP.as_nanos();
        if backlog > CATCH_UP_STEPS {
            let skipped = Span::from_millis((backlog - CATCH_UP_STEPS) * STEP_MS);
            self.due = self.due + skipped;
        }
        let mut sent = Vec::new();
        while self.due <= now {
            self.world.step(STEP_MS);
            let at = self.due;
            self.topics.publish(&mut self.world, |message| sent.push(Sent { at, message }));
            self.due = self.due + STEP;
        }
        sent
    }

    /// The names of its running nodes.
    pub fn nodes(&self) -> Vec<&'static str> {
        let running = Node::ALL.into_iter().filter(|node| node.runs(&self.world));
        running.map(Node::name).collect()
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
            Order::Clear(cleared) => self.world.drive.clear(cleared),
            Order::Decelerate(mps2) => self.world.drive.obedience.decelerate(mps2),
            Order::Stop(asked) => self.world.drive.obedience.maneuver_stop(asked),
        }
    }
}

#[cfg(test)]
mod tests;
