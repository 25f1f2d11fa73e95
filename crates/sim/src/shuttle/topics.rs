//! The topics of the shuttle's nodes, and their rates.

use super::Message;
use super::localizer::Localizer;
use super::statuses::Node;
use super::world::World;
use telltale_engine::model::sample::Pose;
use telltale_engine::time::Span;

/// A state is repeated, so that a reader that joins late learns it.
const ACTIVE_EVERY_MS: u64 = 200;
const STATE_EVERY_MS: u64 = 1000;
const GOAL_EVERY_MS: u64 = 1000;
const CONFIRMATION_EVERY_MS: u64 = 100;

/// The length of the planner's trajectory.
const PLAN_M: f64 = 30.0;
const PLAN_POINTS: usize = 16;

/// The last values of topics that are published on change.
#[derive(Debug, Clone, Default)]
pub(super) struct Topics {
    active: Option<bool>,
    state: Option<&'static str>,
    goal: bool,
    decelerates: Option<bool>,
    stops: Option<bool>,
}

impl Topics {
    /// The messages of this step.
    pub fn publish(&mut self, world: &mut World, mut send: impl FnMut(Message)) {
        vehicle(world, &mut send);
        localization(world, &mut send);
        perception(world, &mut send);
        planning(world, &mut send);
        self.mission(world, &mut send);
        self.confirmations(world, &mut send);
        for node in Node::ALL {
            if node.is_due(world.now_ms())
                && let Some(array) = node.report(world)
            {
                send(Message::Diagnostics(array));
            }
        }
    }

    fn mission(&mut self, world: &World, send: &mut impl FnMut(Message)) {
        let (now_ms, drive) = (world.now_ms(), &world.drive);
        if changed(&mut self.active, drive.active()) || now_ms.is_multiple_of(ACTIVE_EVERY_MS) {
            send(Message::Active(drive.active()));
        }
        if changed(&mut self.state, drive.state()) || now_ms.is_multiple_of(STATE_EVERY_MS) {
            send(Message::MissionState(drive.state()));
        }
        let goal = drive.goal();
        let is_new = goal.is_some() && !self.goal;
        self.goal = goal.is_some();
        if let Some(goal) = goal.filter(|_| is_new || now_ms.is_multiple_of(GOAL_EVERY_MS)) {
            send(Message::Goal(goal.pose()));
        }
    }

    fn confirmations(&mut self, world: &World, send: &mut impl FnMut(Message)) {
        let (obedience, due) = (&world.drive.obedience, world.now_ms().is_multiple_of(CONFIRMATION_EVERY_MS));
        if changed(&mut self.decelerates, obedience.decelerates()) || due {
            send(Message::Decelerates(obedience.decelerates()));
        }
        if changed(&mut self.stops, obedience.stops()) || due {
            send(Message::Stops(obedience.stops()));
        }
    }
}

fn vehicle(world: &mut World, send: &mut impl FnMut(Message)) {
    if world.arrived.scan {
        send(Message::Scan);
    }
    if world.arrived.frame {
        let speed_mps = world.drive.speed_mps;
        let mps = if speed_mps > 0.0 { world.measured(speed_mps, 0.02).max(0.0) } else { 0.0 };
        send(Message::WheelSpeed { mps });
        if world.now_ms().is_multiple_of(500) {
            let charge = world.charge();
            let voltage_v = world.measured(44.0 + charge * 9.0, 0.05);
            let current_a = world.measured(-6.0 - speed_mps * 8.0, 0.5);
            send(Message::Battery { charge, voltage_v, current_a });
        }
    }
}

fn localization(world: &mut World, send: &mut impl FnMut(Message)) {
    let now_ms = world.now_ms();
    if world.arrived.frame && now_ms.is_multiple_of(40) {
        let Localizer { odometry, yaw_rate, .. } = world.localizer;
        let speed_mps = world.drive.speed_mps;
        send(Message::Odometry { pose: odometry.pose(), speed_mps, yaw_rate });
    }
    if now_ms.is_multiple_of(40) && world.localizer.publishes(now_ms) {
        send(Message::Position(world.localizer.pose.pose()));
    }
}

fn perception(world: &mut World, send: &mut impl FnMut(Message)) {
    if world.now_ms() % 100 == 40 {
        let age_ms = world.costmap_delay_ms();
        send(Message::Costmap { age: Span::from_nanos((age_ms * 1e6) as u64) });
    }
    if world.arrived.scan {
        let count = world.measured(7.0, 2.4).round() as usize;
        let object = |world: &mut World| Pose {
            x_m: world.measured(30.0, 25.0),
            y_m: world.measured(0.0, 15.0),
            qw: 1.0,
            ..Pose::default()
        };
        send(Message::Objects((0..count).map(|_| object(world)).collect()));
        send(Message::FreeDistance(world.measured(45.0, 3.0)));
    }
}

fn planning(world: &mut World, send: &mut impl FnMut(Message)) {
    if world.arrived.plan {
        let place = |index: usize| world.drive.ahead(PLAN_M * index as f64 / PLAN_POINTS as f64);
        send(Message::Trajectory((0..=PLAN_POINTS).map(|index| place(index).pose()).collect()));
    }
    // The controller commands a speed at a stop, too: none.
    if world.now_ms() % 40 == 20 {
        send(Message::SpeedCommand(world.drive.speed_mps));
    }
}

fn changed<T: PartialEq + Copy>(last: &mut Option<T>, now: T) -> bool {
    last.replace(now) != Some(now)
}
