//! The simulated machine that a demo runs, with its topics.

use std::time::{Duration, SystemTime};

use super::robot_wire;
use super::shuttle_wire::ShuttleWire;
use crate::config::Loaded;
use crate::engine::input::StatusArray;
use crate::engine::model::{Model, Stop};
use crate::engine::time::{Span, Timestamp};
use crate::msg::messages;
use crate::msg::messages::encode::{self, Grid, Header};
use crate::ros::Quality;
use crate::sim::machine::{Departure, FaultInfo, Order};
use crate::sim::robot::{self, Robot};
use crate::sim::shuttle::{self, Shuttle};

/// The seed of the simulation: with the same one, each demo runs alike.
pub const SEED: u64 = 1;

/// A topic with its type and its quality of service.
pub type Offer<'a> = (&'a str, &'static str, Quality);

/// Cells along each side of a costmap.
pub const COSTMAP_SIDE: usize = 60;
pub type CostmapCells = [i8; COSTMAP_SIDE * COSTMAP_SIDE];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Shuttle(Departure),
    Robot,
}

impl Kind {
    /// What the flags `--robot` and `--drive` ask for.
    pub fn of(robot: bool, alone: bool) -> Kind {
        match (robot, alone) {
            (true, _) => Kind::Robot,
            (false, true) => Kind::Shuttle(Departure::Alone),
            (false, false) => Kind::Shuttle(Departure::Cleared),
        }
    }

    pub fn faults(self) -> Vec<FaultInfo> {
        match self {
            Kind::Shuttle(_) => shuttle::Fault::ALL.map(shuttle::Fault::info).to_vec(),
            Kind::Robot => robot::Fault::ALL.map(robot::Fault::info).to_vec(),
        }
    }
}

#[derive(Debug, Clone)]
pub enum Machine {
    Shuttle(Box<Shuttle>, ShuttleWire),
    Robot(Box<Robot>),
}

impl Machine {
    pub fn new(kind: Kind, seed: u64, loaded: &Loaded, start: Timestamp) -> Machine {
        Machine::along(kind, seed, &loaded.model, &loaded.model.driving.stops, start)
    }

    /// A shuttle drives from one of these stops to the next.
    pub fn along(kind: Kind, seed: u64, model: &Model, stops: &[Stop], start: Timestamp) -> Machine {
        match kind {
            Kind::Shuttle(departure) => {
                let shuttle = Shuttle::new(seed, start, stops, departure);
                Machine::Shuttle(Box::new(shuttle), ShuttleWire::of(model))
            }
            Kind::Robot => Machine::Robot(Box::new(Robot::new(seed, start))),
        }
    }

    pub fn offers(&self) -> Vec<Offer<'_>> {
        match self {
            Machine::Shuttle(_, wire) => wire.offers().to_vec(),
            Machine::Robot(_) => robot_wire::OFFERS.to_vec(),
        }
    }

    pub fn nodes(&self) -> Vec<&'static str> {
        match self {
            Machine::Shuttle(shuttle, _) => shuttle.nodes(),
            Machine::Robot(robot) => robot.nodes(),
        }
    }

    pub fn topics_of(&self, node: &str) -> Vec<&str> {
        match self {
            Machine::Shuttle(_, wire) => wire.topics_of(node),
            Machine::Robot(_) => robot_wire::topics_of(node),
        }
    }

    /// The topics to which a node is subscribed.
    pub fn subscriptions_of(&self, node: &str) -> Vec<&str> {
        match self {
            Machine::Shuttle(_, wire) => wire.subscriptions_of(node),
            Machine::Robot(_) => robot_wire::subscriptions_of(node),
        }
    }

    /// The messages until `now`, each with its topic and its body; `wall` is the wall time of an instant.
    pub fn advance(
        &mut self,
        now: Timestamp,
        wall: impl Fn(Timestamp) -> SystemTime,
    ) -> Vec<(&str, Vec<u8>)> {
        match self {
            Machine::Shuttle(shuttle, wire) => {
                let sent = shuttle.advance(now);
                sent.iter().map(|sent| wire.encode(&sent.message, wall(sent.at))).collect()
            }
            Machine::Robot(robot) => {
                let sent = robot.advance(now);
                sent.iter().map(|sent| robot_wire::encode(&sent.message, wall(sent.at))).collect()
            }
        }
    }

    /// Switches the fault of this name, if the machine has it.
    pub fn set_fault(&mut self, name: &str, on: bool) {
        match self {
            Machine::Shuttle(shuttle, _) => {
                shuttle::Fault::from_word(name).into_iter().for_each(|fault| shuttle.set_fault(fault, on));
            }
            Machine::Robot(robot) => {
                robot::Fault::from_word(name).into_iter().for_each(|fault| robot.set_fault(fault, on));
            }
        }
    }

    pub fn obey(&mut self, order: Order) {
        match self {
            Machine::Shuttle(shuttle, _) => shuttle.obey(order),
            Machine::Robot(robot) => robot.obey(order),
        }
    }
}

/// A node of a simulated machine has few statuses: they fit one message.
pub fn diagnostics(array: &StatusArray, stamp: SystemTime) -> Vec<u8> {
    messages::encode_diagnostic_arrays(array, stamp, usize::MAX).swap_remove(0)
}

/// A costmap with the machine in its middle.
pub fn costmap(header: Header<'_>, resolution_m: f32, cells: &CostmapCells) -> Vec<u8> {
    let half_m = COSTMAP_SIDE as f64 * f64::from(resolution_m) / 2.0;
    let (width, [origin_x_m, origin_y_m]) = (COSTMAP_SIDE as u32, [-half_m; 2]);
    encode::occupancy_grid(header, Grid { resolution_m, width, origin_x_m, origin_y_m, cells })
}

/// The wall time so long before.
pub fn before(stamp: SystemTime, age: Span) -> SystemTime {
    stamp.checked_sub(Duration::from(age)).unwrap_or(SystemTime::UNIX_EPOCH)
}
