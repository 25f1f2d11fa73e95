//! The topics of the simulated robot, as Nav2 and common drivers name them, and its messages as bytes.

use std::time::SystemTime;

use super::machine::{COSTMAP_SIDE, CostmapCells, Offer, before, costmap, diagnostics};
use crate::msg::messages::encode;
use crate::msg::messages::encode::{Header, Motion, Transform};
use crate::msg::messages::{BOOL, DIAGNOSTIC_ARRAY};
use crate::ros::DIAGNOSTICS;
use crate::ros::Quality::{BestEffort, LastValue, Reliable};
use crate::sim::robot::{Lidar, Message};

const SCAN_FRONT: &str = "/scan_front";
const SCAN_REAR: &str = "/scan_rear";
const IMU: &str = "/imu/data";
const ODOMETRY: &str = "/odom";
const TF: &str = "/tf";
const POSITION: &str = "/amcl_pose";
const PLAN: &str = "/plan";
const COSTMAP: &str = "/local_costmap/costmap";
const COMMAND: &str = "/cmd_vel";
const BATTERY: &str = "/battery_state";
const DOCKED: &str = "/docked";
const NAVIGATING: &str = "/navigating";

/// The robot's frame, and those of its odometry and its map.
const BASE: &str = "base_link";
const ODOM: &str = "odom";
const MAP: &str = "map";

const RANGES: usize = 360;
const FREE_FLOOR: CostmapCells = [0; COSTMAP_SIDE * COSTMAP_SIDE];

pub const OFFERS: [Offer<'static>; 13] = [
    (DIAGNOSTICS, DIAGNOSTIC_ARRAY, Reliable),
    (SCAN_FRONT, encode::LASER_SCAN, BestEffort),
    (SCAN_REAR, encode::LASER_SCAN, BestEffort),
    (IMU, encode::IMU, BestEffort),
    (ODOMETRY, encode::ODOMETRY, Reliable),
    (TF, encode::TF_MESSAGE, Reliable),
    (POSITION, encode::POSE_WITH_COVARIANCE_STAMPED, LastValue),
    (PLAN, encode::PATH, Reliable),
    (COSTMAP, encode::OCCUPANCY_GRID, LastValue),
    (COMMAND, encode::TWIST, Reliable),
    (BATTERY, encode::BATTERY_STATE, Reliable),
    (DOCKED, BOOL, LastValue),
    (NAVIGATING, BOOL, LastValue),
];

pub fn topics_of(node: &str) -> Vec<&'static str> {
    match node {
        "lidar_front" => vec![SCAN_FRONT],
        "lidar_rear" => vec![SCAN_REAR],
        "imu" => vec![IMU],
        "base_driver" => vec![ODOMETRY],
        "battery_driver" => vec![BATTERY],
        "amcl" => vec![TF, POSITION],
        "planner_server" => vec![PLAN],
        "controller_server" => vec![COSTMAP, COMMAND],
        "docking_server" => vec![DIAGNOSTICS, DOCKED, NAVIGATING],
        _ => Vec::new(),
    }
}

/// To what a node is subscribed, as in the default configurations of Nav2: AMCL takes one scan, each of the two
/// servers has a costmap of both scanners.
pub fn subscriptions_of(node: &str) -> Vec<&'static str> {
    match node {
        "base_driver" => vec![COMMAND],
        "amcl" => vec![SCAN_FRONT, TF],
        "planner_server" => vec![SCAN_FRONT, SCAN_REAR, TF],
        "controller_server" => vec![SCAN_FRONT, SCAN_REAR, ODOMETRY, TF],
        "docking_server" => vec![BATTERY, ODOMETRY, TF],
        _ => Vec::new(),
    }
}

/// The topic and the body of a message that was published then.
pub fn encode(message: &Message, stamp: SystemTime) -> (&'static str, Vec<u8>) {
    let header = |frame_id| Header { stamp, frame_id };
    let motion = |mps, yaw_rate| Motion { linear: [mps, 0.0, 0.0], angular: [0.0, 0.0, yaw_rate] };
    match message {
        Message::Diagnostics(array) => (DIAGNOSTICS, diagnostics(array, stamp)),
        Message::Scan(Lidar::Front) => {
            (SCAN_FRONT, encode::laser_scan(header("lidar_front"), &[4.0; RANGES]))
        }
        Message::Scan(Lidar::Rear) => (SCAN_REAR, encode::laser_scan(header("lidar_rear"), &[4.0; RANGES])),
        Message::Imu { yaw_rate } => (IMU, encode::imu(header("imu"), motion(0.0, *yaw_rate))),
        Message::Odometry { pose, speed_mps, yaw_rate } => {
            (ODOMETRY, encode::odometry(header(ODOM), BASE, *pose, motion(*speed_mps, *yaw_rate)))
        }
        Message::MapToOdometry(pose) => {
            let transform = Transform { header: header(MAP), child_frame_id: ODOM, pose: *pose };
            (TF, encode::tf_message(&[transform]))
        }
        Message::Position { pose, variance_m2 } => {
            let mut covariance = [0.0; 36];
            (covariance[0], covariance[7]) = (*variance_m2, *variance_m2);
            (POSITION, encode::pose_with_covariance_stamped(header(MAP), *pose, &covariance))
        }
        Message::Plan(poses) => (PLAN, encode::path(header(MAP), poses)),
        Message::Costmap { age } => {
            (COSTMAP, costmap(Header { stamp: before(stamp, *age), frame_id: ODOM }, 0.05, &FREE_FLOOR))
        }
        Message::Command { speed_mps, yaw_rate } => (COMMAND, encode::twist(motion(*speed_mps, *yaw_rate))),
        Message::Battery { charge, voltage_v, current_a } => {
            (BATTERY, encode::battery_state(header(BASE), *charge, *voltage_v, *current_a))
        }
        Message::Docked(docked) => (DOCKED, encode::boolean(*docked)),
        Message::Navigating(navigating) => (NAVIGATING, encode::boolean(*navigating)),
    }
}
