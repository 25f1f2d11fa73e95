//! What each node says about itself and its data, in the words of its developers.

use super::Fault;
use super::world::{FRAME_AGE_MS_MAX, PLAN_GAP_MS_MAX, SCAN_AGE_MS_MAX, World};
use crate::engine::input::StatusArray;

const OK: u8 = 0;
const WARN: u8 = 1;
const ERROR: u8 = 2;

/// Age of the vehicle's feedback at which those who need it give up: later than the bus itself
/// is found dead.
const FEEDBACK_AGE_MS_MAX: u64 = 350;

/// A process of the shuttle that publishes diagnostics.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Node {
    VelodyneMonitor,
    LidarDrivers,
    Camera,
    Imu,
    Gnss,
    Localization,
    Perception,
    Prediction,
    CanBridge,
    VehicleInterface,
    Battery,
    MissionServer,
    MissionRoute,
    PlannerMonitor,
    Planner,
    Controller,
}

impl Node {
    pub const ALL: [Node; 16] = [
        Node::VelodyneMonitor,
        Node::LidarDrivers,
        Node::Camera,
        Node::Imu,
        Node::Gnss,
        Node::Localization,
        Node::Perception,
        Node::Prediction,
        Node::CanBridge,
        Node::VehicleInterface,
        Node::Battery,
        Node::MissionServer,
        Node::MissionRoute,
        Node::PlannerMonitor,
        Node::Planner,
        Node::Controller,
    ];

    /// Each node has its own rhythm, and none the same phase as the one before.
    pub fn is_due(self, now_ms: u64) -> bool {
        let period_ms = match self {
            Node::Battery => 500,
            _ => 100,
        };
        now_ms % period_ms == self as u64 * 10 % 100
    }

    /// Its statuses now; none where it does not run or hears nothing to report on.
    pub fn report(self, world: &mut World) -> Option<StatusArray> {
        let runs = match self {
            Node::VehicleInterface | Node::Battery => world.frame_age_ms() <= FRAME_AGE_MS_MAX,
            Node::Planner | Node::Controller => world.drive.planner_runs(),
            _ => true,
        };
        if !runs {
            return None;
        }
        let mut out = StatusArray::default();
        match self {
            Node::VelodyneMonitor => velodyne_packets(world, &mut out),
            Node::LidarDrivers => lidars(world, &mut out),
            Node::Camera => camera(world, &mut out),
            Node::Imu => imu(world, &mut out),
            Node::Gnss => gnss(world, &mut out),
            Node::Localization => localization(world, &mut out),
            Node::Perception => perception(world, &mut out),
            Node::Prediction => prediction(world, &mut out),
            Node::CanBridge => can_bus(world, &mut out),
            Node::VehicleInterface => wheel_speed(world, &mut out),
            Node::Battery => battery(world, &mut out),
            Node::MissionServer => mission_server(world, &mut out),
            Node::MissionRoute => mission_route(world, &mut out),
            Node::PlannerMonitor => planner_submitted(world, &mut out),
            Node::Planner => planner(world, &mut out),
            Node::Controller => controller(world, &mut out),
        }
        Some(out)
    }
}

fn velodyne_packets(world: &mut World, out: &mut StatusArray) {
    let rate_hz = world.scan_rate_hz();
    let level = match rate_hz {
        _ if !world.scans_are_enough() => ERROR,
        ..9.0 => WARN,
        _ => OK,
    };
    let message = match level {
        OK => "Packets arrive".to_owned(),
        _ if rate_hz == 0.0 => format!("No scan for {}", seconds(world.scan_age_ms())),
        _ => format!("Only {rate_hz:.1} scans per second"),
    };
    out.push_status(level, "velodyne_packet_alive", &message, "velodyne_front");
    out.push_value("rate_hz", &format!("{rate_hz:.1}"));
    out.push_value("expected_hz", "10.0");
    out.push_value("window_s", "2.0");
}

fn lidars(world: &mut World, out: &mut StatusArray) {
    for (name, id, mean_c) in
        [("lidar_front: status", "velodyne_front", 46.0), ("lidar_rear: status", "velodyne_rear", 44.5)]
    {
        let temperature_c = world.measured(mean_c, 0.4);
        let rotation_rpm = world.measured(600.0, 1.5);
        out.push_status(OK, name, "Rotates, optics clean", id);
        out.push_value("temperature_c", &format!("{temperature_c:.1}"));
        out.push_value("rotation_rpm", &format!("{rotation_rpm:.0}"));
    }
}

fn camera(world: &mut World, out: &mut StatusArray) {
    let rate_hz = world.image_rate_hz();
    let exposure_ms = world.measured(8.0, 0.6);
    out.push_status(OK, "camera_front: image_rate", "Images arrive", "camera_front");
    out.push_value("rate_hz", &format!("{rate_hz:.1}"));
    out.push_value("exposure_ms", &format!("{exposure_ms:.1}"));
}

fn imu(world: &mut World, out: &mut StatusArray) {
    let bias_deg_s = world.measured(0.012, 0.002);
    let temperature_c = world.measured(38.0, 0.2);
    out.push_status(OK, "imu: status", "Rates and accelerations plausible", "imu");
    out.push_value("gyro_bias_deg_s", &format!("{bias_deg_s:.4}"));
    out.push_value("temperature_c", &format!("{temperature_c:.1}"));
}

fn gnss(world: &mut World, out: &mut StatusArray) {
    let satellites = world.measured(17.0, 1.6).round();
    let accuracy_m = world.measured(0.024, 0.006);
    out.push_status(OK, "gnss: fix", "Fixed with corrections", "gnss");
    out.push_value("satellites", &format!("{satellites:.0}"));
    out.push_value("accuracy_m", &format!("{accuracy_m:.3}"));
}

fn localization(world: &mut World, out: &mut StatusArray) {
    const ID: &str = "localization";
    let pose_age_ms = world.pose_age_ms();
    let scan_age_ms = world.scan_age_ms();
    let lost = pose_age_ms > SCAN_AGE_MS_MAX;

    let (level, message) = match pose_age_ms {
        501.. => (ERROR, format!("No transform from map to odom for {}", seconds(pose_age_ms))),
        _ => (OK, "Transform from map to odom is there".to_owned()),
    };
    out.push_status(level, "localization: tf_map", &message, ID);
    out.push_value("age_ms", &pose_age_ms.to_string());

    let jumped = world.jumped();
    let offset_m = if jumped { 1.2 } else { world.measured(0.035, 0.015) };
    let (level, message) = if jumped {
        (ERROR, format!("Position jumped by {offset_m:.1} m"))
    } else if lost {
        (ERROR, format!("Position not confirmed for {}", seconds(pose_age_ms)))
    } else {
        (OK, format!("Agrees with odometry within {:.0} cm", offset_m * 100.0))
    };
    out.push_status(level, "localization: tf_quality", &message, ID);
    out.push_value("offset_m", &format!("{offset_m:.3}"));

    let score = if world.has(Fault::LocalizationJump) { 0.55 } else { world.measured(0.93, 0.02) };
    let (level, message) = match scan_age_ms {
        251.. => (ERROR, format!("No scan for {}", seconds(scan_age_ms))),
        _ if score < 0.7 => (WARN, "Scan fits the map badly".to_owned()),
        _ => (OK, "Scan fits the map".to_owned()),
    };
    out.push_status(level, "localization: scan_matching", &message, ID);
    out.push_value("score", &format!("{score:.2}"));

    let frame_age_ms = world.frame_age_ms();
    let (level, message) = if frame_age_ms > FEEDBACK_AGE_MS_MAX {
        (ERROR, format!("No wheel speeds for {}", seconds(frame_age_ms)))
    } else {
        (OK, "Wheels and motion sensor agree".to_owned())
    };
    out.push_status(level, "localization: odometry", &message, ID);
    out.push_value("distance_m", &format!("{:.1}", world.drive.odometer_m));
}

fn perception(world: &mut World, out: &mut StatusArray) {
    const ID: &str = "perception";
    let delay_ms = world.costmap_delay_ms();
    let level = judge_above(delay_ms, 150.0, 300.0);
    let message = match level {
        OK => format!("Costmap is {delay_ms:.0} ms old"),
        _ => format!("Costmap is late: {delay_ms:.0} ms"),
    };
    out.push_status(level, "perception: costmap_delay", &message, ID);
    out.push_value("delay_ms", &format!("{delay_ms:.0}"));
    out.push_value("limit_ms", "300");

    let scan_age_ms = world.scan_age_ms();
    let blind = scan_age_ms > 400;
    let cells = if blind { 0.0 } else { world.measured(9400.0, 300.0) };
    let objects = if blind { 0.0 } else { world.measured(7.0, 2.4).round() };
    let stale = format!("No scan for {}", seconds(scan_age_ms));
    let level = if blind { ERROR } else { OK };
    let message = |fine: &str| if blind { stale.clone() } else { fine.to_owned() };
    out.push_status(level, "perception: free_space", &message("Road ahead is covered"), ID);
    out.push_value("cells", &format!("{cells:.0}"));
    out.push_status(level, "perception: object_detection", &message("Detects at 10 Hz"), ID);
    out.push_value("objects", &format!("{objects:.0}"));
    out.push_status(level, "perception: object_tracking", &message("Tracks are stable"), ID);
    out.push_value("tracks", &format!("{objects:.0}"));
}

fn prediction(world: &mut World, out: &mut StatusArray) {
    const ID: &str = "prediction";
    let input_age_ms = world.costmap_delay_ms();
    let level = judge_above(input_age_ms, 450.0, 700.0);
    let message = match level {
        OK => "Predicts all tracks for 4 s".to_owned(),
        _ => format!("Input is {input_age_ms:.0} ms old"),
    };
    out.push_status(level, "prediction: trajectories", &message, ID);
    out.push_value("input_age_ms", &format!("{input_age_ms:.0}"));
    let (level, message) = if world.pose_is_missed() {
        (ERROR, "Tracks fit no lane: the position is not good")
    } else {
        (OK, "All tracks have a lane")
    };
    out.push_status(level, "prediction: lane_matching", message, ID);
}

fn can_bus(world: &mut World, out: &mut StatusArray) {
    let (rate_hz, age_ms) = (world.frame_rate_hz(), world.frame_age_ms());
    let (level, message) = if age_ms > FRAME_AGE_MS_MAX {
        (ERROR, format!("No frame for {}", seconds(age_ms)))
    } else if world.frames_steady_ms() < 1000 {
        (ERROR, "Frames come back".to_owned())
    } else if rate_hz < 45.0 {
        (WARN, format!("Only {rate_hz:.0} frames per second"))
    } else {
        (OK, "Frames arrive".to_owned())
    };
    out.push_status(level, "can: bus", &message, "can0");
    out.push_value("rate_hz", &format!("{rate_hz:.1}"));
    out.push_value("error_frames", "0");
}

fn wheel_speed(world: &mut World, out: &mut StatusArray) {
    let speed_mps = world.drive.speed_mps;
    let shown_mps = if speed_mps > 0.0 { world.measured(speed_mps, 0.02).max(0.0) } else { 0.0 };
    out.push_status(OK, "can: wheel_speed", "Four wheels agree", "can0");
    out.push_value("speed_mps", &format!("{shown_mps:.2}"));
}

fn battery(world: &mut World, out: &mut StatusArray) {
    let charge_percent = world.charge_percent();
    let voltage_v = world.measured(44.0 + charge_percent * 0.09, 0.05);
    let level = judge_below(charge_percent, 20.0, 8.0);
    let message = format!("{charge_percent:.0} percent charged");
    out.push_status(level, "can: battery", &message, "battery");
    out.push_value("charge_percent", &format!("{charge_percent:.1}"));
    out.push_value("voltage_v", &format!("{voltage_v:.1}"));
}

fn mission_server(world: &mut World, out: &mut StatusArray) {
    let round_trip_ms = world.measured(38.0, 9.0);
    out.push_status(OK, "mission: server", "Control room answers", "mission");
    out.push_value("round_trip_ms", &format!("{round_trip_ms:.0}"));
}

fn mission_route(world: &mut World, out: &mut StatusArray) {
    let drive = &world.drive;
    let message = match (drive.left_m(), drive.departs_in_s()) {
        (Some(left_m), _) => format!("To {}, {left_m:.0} m left", drive.next()),
        (None, Some(left_s)) => format!("At {}, leaves in {left_s} s", drive.here()),
        (None, None) => format!("At {}", drive.here()),
    };
    out.push_status(OK, "mission: route", &message, "mission");
    out.push_value("next_stop", drive.next());
}

/// Watches the planner from outside, so it reports at stops too, where it cannot be content.
fn planner_submitted(world: &mut World, out: &mut StatusArray) {
    let (rate_hz, age_ms) = (world.plan_rate_hz(), world.plan_age_ms());
    let (level, message) = match age_ms {
        _ if age_ms > PLAN_GAP_MS_MAX => (ERROR, format!("No trajectory for {}", seconds(age_ms))),
        // One trajectory after a gap is not yet a planner that works.
        _ if world.plans_steady_ms() < 250 => (ERROR, "Trajectories come back".to_owned()),
        301.. => (WARN, format!("No trajectory for {}", seconds(age_ms))),
        _ => (OK, "Trajectories arrive".to_owned()),
    };
    out.push_status(level, "planner_submitted", &message, "planning");
    out.push_value("rate_hz", &format!("{rate_hz:.1}"));
}

fn planner(world: &mut World, out: &mut StatusArray) {
    let missed = world.pose_is_missed();
    let (level, message) =
        if missed { (ERROR, "No decision without a position") } else { (OK, "Keep the lane") };
    out.push_status(level, "planning: behavior", message, "planning");
    let lateral_mps2 = world.measured(0.35, 0.12);
    let (level, message) =
        if missed { (ERROR, "Start of the path is unknown") } else { (OK, "Drivable and free") };
    out.push_status(level, "planning: trajectory", message, "planning");
    out.push_value("lateral_acceleration_mps2", &format!("{lateral_mps2:.2}"));
}

fn controller(world: &mut World, out: &mut StatusArray) {
    let plan_age_ms = world.plan_age_ms();
    let deviation_m = world.measured(0.04, 0.02);
    let (level, message) = match plan_age_ms {
        801.. => (ERROR, format!("Brakes: last trajectory is {} old", seconds(plan_age_ms))),
        401.. => (WARN, format!("Last trajectory is {} old", seconds(plan_age_ms))),
        _ => (OK, format!("{:.0} cm off the path", deviation_m * 100.0)),
    };
    out.push_status(level, "execution: controller", &message, "execution");
    out.push_value("deviation_m", &format!("{deviation_m:.3}"));

    let frame_age_ms = world.frame_age_ms();
    for (name, fine) in [("execution: steering", "Steering follows"), ("execution: brake", "Brake follows")] {
        let (level, message) = if frame_age_ms > FEEDBACK_AGE_MS_MAX {
            (ERROR, format!("No feedback for {}", seconds(frame_age_ms)))
        } else {
            (OK, fine.to_owned())
        };
        out.push_status(level, name, &message, "execution");
        let lag_ms = world.measured(42.0, 6.0);
        out.push_value("lag_ms", &format!("{lag_ms:.0}"));
    }
}

fn judge_below(value: f64, warn: f64, error: f64) -> u8 {
    if value < error {
        ERROR
    } else if value < warn {
        WARN
    } else {
        OK
    }
}

fn judge_above(value: f64, warn: f64, error: f64) -> u8 {
    judge_below(-value, -warn, -error)
}

fn seconds(ms: u64) -> String {
    format!("{:.1} s", ms as f64 / 1000.0)
}
