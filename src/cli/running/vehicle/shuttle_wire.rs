//! The topics of the simulated shuttle, and its messages as bytes.

use std::time::SystemTime;

use super::machine::{COSTMAP_SIDE, CostmapCells, Offer, before, costmap, diagnostics};
use crate::engine::model::{ACTIVE_SIGNAL, Model};
use crate::msg::messages::encode;
use crate::msg::messages::encode::{Header, Motion, Transform};
use crate::msg::messages::{BOOL, DIAGNOSTIC_ARRAY};
use crate::ros::{DIAGNOSTICS, Quality};
use crate::sim::shuttle::Message;

const PACKETS: &str = "/velodyne_packets";
const TF: &str = "/tf";
const ODOMETRY: &str = "/odometry";
const WHEEL_SPEED: &str = "/can/speed";
const BATTERY: &str = "/battery";
const COSTMAP: &str = "/costmap";
const OBJECTS: &str = "/perception/objects";
const FREE_DISTANCE: &str = "/perception/free_distance";
const TRAJECTORY: &str = "/planning/trajectory";
const SPEED_COMMAND: &str = "/control/speed_command";
const GOAL: &str = "/goal_pose";
const ACTIVE: &str = "/mission/active";
const MISSION_STATE: &str = "/mission/state";
const DECELERATES: &str = "/vehicle/deceleration_active";
const STOPS: &str = "/vehicle/maneuver_stop_active";

const MAP: &str = "map";
const BASE: &str = "base_link";

/// A real turn has about six times as many; what matters here is that it is a message of many frames.
const PACKETS_PER_TURN: usize = 12;

/// How the messages of the shuttle travel.
#[derive(Debug, Clone)]
pub struct ShuttleWire {
    /// Where the configuration wants to hear whether it drives.
    active: Box<str>,
}

impl ShuttleWire {
    pub fn of(model: &Model) -> ShuttleWire {
        let active = model.signals.iter().find(|signal| &*signal.name == ACTIVE_SIGNAL);
        let source = active.and_then(|signal| signal.source.field());
        ShuttleWire { active: source.map_or(ACTIVE.into(), |source| source.topic.clone()) }
    }

    /// Every topic with its type and its quality of service: sensors as sensors have it, states for
    /// those who join late.
    pub fn offers(&self) -> [Offer<'_>; 16] {
        use Quality::{BestEffort, LastValue, Reliable};
        [
            (DIAGNOSTICS, DIAGNOSTIC_ARRAY, Reliable),
            (PACKETS, encode::VELODYNE_SCAN, BestEffort),
            (TF, encode::TF_MESSAGE, Reliable),
            (ODOMETRY, encode::ODOMETRY, Reliable),
            (WHEEL_SPEED, encode::TWIST_STAMPED, Reliable),
            (BATTERY, encode::BATTERY_STATE, Reliable),
            (COSTMAP, encode::OCCUPANCY_GRID, Reliable),
            (OBJECTS, encode::POSE_ARRAY, Reliable),
            (FREE_DISTANCE, encode::FLOAT64, Reliable),
            (TRAJECTORY, encode::PATH, Reliable),
            (SPEED_COMMAND, encode::FLOAT64, Reliable),
            (GOAL, encode::POSE_STAMPED, Reliable),
            (&self.active, BOOL, LastValue),
            (MISSION_STATE, encode::STRING, LastValue),
            (DECELERATES, BOOL, LastValue),
            (STOPS, BOOL, LastValue),
        ]
    }

    /// What a node publishes; the mission speaks for the rest of the vehicle.
    pub fn topics_of(&self, node: &str) -> Vec<&str> {
        let all = self.offers();
        let of = |(topic, ..): &Offer<'_>| match *topic {
            PACKETS => "lidar_drivers",
            WHEEL_SPEED | BATTERY => "can_gateway",
            TF | ODOMETRY => "localization",
            COSTMAP | OBJECTS | FREE_DISTANCE => "perception",
            TRAJECTORY => "planner",
            SPEED_COMMAND | DECELERATES | STOPS => "controller",
            _ => "mission",
        };
        let published = all.iter().filter(|offer| of(offer) == node);
        published.map(|&(topic, ..)| topic).collect()
    }

    /// To what a node is subscribed, as far as the simulation publishes it. The prediction, the cameras and the other
    /// sensors publish statuses alone, so nobody is subscribed to them.
    pub fn subscriptions_of(&self, node: &str) -> Vec<&str> {
        match node {
            "can_gateway" => vec![SPEED_COMMAND],
            "localization" => vec![PACKETS, WHEEL_SPEED],
            "perception" => vec![PACKETS, TF],
            "prediction" => vec![OBJECTS, TF],
            "mission" => vec![TF],
            "planner" => vec![COSTMAP, TF, GOAL, &self.active],
            "controller" => vec![TRAJECTORY, WHEEL_SPEED, TF],
            _ => Vec::new(),
        }
    }

    /// The topic and the body of a message that was published then.
    pub fn encode(&self, message: &Message, stamp: SystemTime) -> (&str, Vec<u8>) {
        let header = |frame_id| Header { stamp, frame_id };
        let forward = |mps| Motion { linear: [mps, 0.0, 0.0], ..Motion::default() };
        match message {
            Message::Diagnostics(array) => (DIAGNOSTICS, diagnostics(array, stamp)),
            Message::Scan => (PACKETS, encode::velodyne_scan(header("velodyne"), PACKETS_PER_TURN)),
            Message::Position(pose) => {
                let transform = Transform { header: header(MAP), child_frame_id: BASE, pose: *pose };
                (TF, encode::tf_message(&[transform]))
            }
            Message::Odometry { pose, speed_mps, yaw_rate } => {
                let velocity = Motion { angular: [0.0, 0.0, *yaw_rate], ..forward(*speed_mps) };
                (ODOMETRY, encode::odometry(header("odom"), BASE, *pose, velocity))
            }
            Message::WheelSpeed { mps } => (WHEEL_SPEED, encode::twist_stamped(header(BASE), forward(*mps))),
            Message::Battery { charge, voltage_v, current_a } => {
                (BATTERY, encode::battery_state(header(BASE), *charge, *voltage_v, *current_a))
            }
            Message::Costmap { age } => {
                (COSTMAP, costmap(Header { stamp: before(stamp, *age), frame_id: BASE }, 0.5, &road()))
            }
            Message::Objects(poses) => (OBJECTS, encode::pose_array(header(BASE), poses)),
            Message::FreeDistance(metres) => (FREE_DISTANCE, encode::float64(*metres)),
            Message::Trajectory(poses) => (TRAJECTORY, encode::path(header(MAP), poses)),
            Message::SpeedCommand(mps) => (SPEED_COMMAND, encode::float64(*mps)),
            Message::Goal(pose) => (GOAL, encode::pose_stamped(header(MAP), *pose)),
            Message::Active(active) => (&self.active, encode::boolean(*active)),
            Message::MissionState(state) => (MISSION_STATE, encode::string(state)),
            Message::Decelerates(on) => (DECELERATES, encode::boolean(*on)),
            Message::Stops(on) => (STOPS, encode::boolean(*on)),
        }
    }
}

/// Free road between two kerbs.
fn road() -> CostmapCells {
    std::array::from_fn(|index| if matches!(index / COSTMAP_SIDE, 0..10 | 50..) { 100 } else { 0 })
}
