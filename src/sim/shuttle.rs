//! A shuttle on a loop of three stops. Pure: it is told what time it is and answers with the
//! messages that its nodes published until then. Same seed, same instants, same messages.
//!
//! Faults break a cause (packets stop, the position jumps); everything else follows from the
//! data flow as it does in a vehicle: who uses the data at once notices at once, who counts in a
//! sliding window notices later (paper, Sec. V).

mod drive;
mod statuses;
mod world;

use crate::engine::input::StatusArray;
use crate::engine::time::{Span, Timestamp};
use statuses::Node;
use world::World;

/// How finely the shuttle's own time runs. Calling [`Shuttle::advance`] this often loses nothing.
pub const STEP: Span = Span::from_millis(STEP_MS);
const STEP_MS: u64 = 10;

/// Time that one call makes up for at most: a process that was stopped does not flood the bus.
const CATCH_UP_STEPS: u64 = 500;

/// Long enough that every sliding window is full when the first message leaves.
const WARM_UP_STEPS: u64 = 300;

/// The mission component repeats its signal, so that whoever joins late learns it.
const ACTIVE_PERIOD_MS: u64 = 200;

/// What a node of the shuttle published.
#[derive(Debug, Clone, PartialEq)]
pub enum Message {
    /// On `/diagnostics`, as one node groups it.
    Diagnostics(StatusArray),
    /// On `/mission/active`: the shuttle drives by itself.
    Active(bool),
}

/// A fault that can be switched on and off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Fault {
    /// No packets from the LiDAR.
    SensorOutage,
    /// The position jumps by more than a metre.
    LocalizationJump,
    /// The obstacle map comes late.
    CostmapDelay,
    /// The planner submits no trajectory: it matters only while driving.
    PlannerStall,
    /// No frames from the vehicle's bus.
    CanLoss,
    /// The battery is nearly empty: a warning.
    LowBattery,
}

impl Fault {
    pub const ALL: [Fault; 6] = [
        Fault::SensorOutage,
        Fault::LocalizationJump,
        Fault::CostmapDelay,
        Fault::PlannerStall,
        Fault::CanLoss,
        Fault::LowBattery,
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
        }
    }

    pub fn from_word(word: &str) -> Option<Fault> {
        Fault::ALL.into_iter().find(|fault| fault.as_str() == word)
    }

    /// What happens, in one line for people.
    pub const fn about(self) -> &'static str {
        match self {
            Fault::SensorOutage => "LiDAR packets stop; Localization notices before Sensors does",
            Fault::LocalizationJump => "the position jumps by 1.2 m",
            Fault::CostmapDelay => "the obstacle map comes 350 ms late",
            Fault::PlannerStall => "no trajectories; matters only while driving",
            Fault::CanLoss => "no frames from the vehicle's bus",
            Fault::LowBattery => "a warning",
        }
    }
}

/// The shuttle at one instant.
#[derive(Debug, Clone)]
pub struct Shuttle {
    world: World,
    /// When the next step is due.
    due: Timestamp,
    last_active: Option<bool>,
}

impl Shuttle {
    /// A shuttle that has been standing at its depot for a while at `start`.
    pub fn new(seed: u64, start: Timestamp) -> Shuttle {
        let mut world = World::new(seed);
        for _ in 0..WARM_UP_STEPS {
            world.step(STEP_MS);
        }
        Shuttle { world, due: start + STEP, last_active: None }
    }

    /// Lets time pass until `now` and returns what was published meanwhile, in order. Of more than
    /// five seconds at once only the last five happen.
    pub fn advance(&mut self, now: Timestamp) -> Vec<Message> {
        let backlog = now.since(self.due).as_nanos() / STEP.as_nanos();
        if backlog > CATCH_UP_STEPS {
            let skipped = Span::from_millis((backlog - CATCH_UP_STEPS) * STEP_MS);
            self.due = self.due + skipped;
        }
        let mut messages = Vec::new();
        while self.due <= now {
            self.world.step(STEP_MS);
            self.publish(&mut messages);
            self.due = self.due + STEP;
        }
        messages
    }

    pub fn set_fault(&mut self, fault: Fault, on: bool) {
        self.world.set_fault(fault, on);
    }

    fn publish(&mut self, messages: &mut Vec<Message>) {
        let active = self.world.drive.active();
        if self.last_active != Some(active) || self.world.now_ms().is_multiple_of(ACTIVE_PERIOD_MS) {
            self.last_active = Some(active);
            messages.push(Message::Active(active));
        }
        for node in Node::ALL {
            if node.is_due(self.world.now_ms())
                && let Some(array) = node.report(&mut self.world)
            {
                messages.push(Message::Diagnostics(array));
            }
        }
    }
}

#[cfg(test)]
mod tests;
