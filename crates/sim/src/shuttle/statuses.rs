//! The statuses of the shuttle's nodes, in the words of their developers. They say only what a node
//! itself knows; other monitors read the topics.

use super::Fault;
use super::localizer::Match;
use super::world::World;
use telltale_engine::input::StatusArray;

const OK: u8 = 0;
const WARN: u8 = 1;
const ERROR: u8 = 2;
const STALE: u8 = 3;

/// The age of the vehicle's feedback at which its users give up: later than the bus itself is found dead.
const FEEDBACK_AGE_MS_MAX: u64 = 450;

/// A process of the shuttle that publishes diagnostics.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Node {
    LidarDrivers,
    Camera,
    Imu,
    Gnss,
    Localization,
    Perception,
    Prediction,
    Mission,
    Planner,
    Controller,
}

impl Node {
    pub const ALL: [Node; 10] = [
        Node::LidarDrivers,
        Node::Camera,
        Node::Imu,
        Node::Gnss,
        Node::Localization,
        Node::Perception,
        Node::Prediction,
        Node::Mission,
        Node::Planner,
        Node::Controller,
    ];

    /// Its ROS 2 name.
    pub const fn name(self) -> &'static str {
        match self {
            Node::LidarDrivers => "lidar_drivers",
            Node::Camera => "camera_driver",
            Node::Imu => "imu_driver",
            Node::Gnss => "gnss_driver",
            Node::Localization => "localization",
            Node::Perception => "perception",
            Node::Prediction => "prediction",
            Node::Mission => "mission",
            Node::Planner => "planner",
            Node::Controller => "controller",
        }
    }

    /// Whether its process runs.
    pub fn runs(self, world: &World) -> bool {
        self != Node::Camera || !world.has(Fault::CameraCrash)
    }

    /// Ten times a second, each at another moment.
    pub fn is_due(self, now_ms: u64) -> bool {
        now_ms % 100 == self as u64 * 10
    }

    /// Its statuses now; none if it is gone or has nothing to do.
    pub fn report(self, world: &mut World) -> Option<StatusArray> {
        let rests = matches!(self, Node::Planner | Node::Controller) && !world.drive.planner_runs();
        if rests || !self.runs(world) {
            return None;
        }
        let mut out = StatusArray::default();
        match self {
            Node::LidarDrivers => lidars(world, &mut out),
            Node::Camera => camera(world, &mut out),
            Node::Imu => imu(world, &mut out),
            Node::Gnss => gnss(world, &mut out),
            Node::Localization => localization(world, &mut out),
            Node::Perception => perception(world, &mut out),
            Node::Prediction => prediction(world, &mut out),
            Node::Mission => mission(world, &mut out),
            Node::Planner => planner(world, &mut out),
            Node::Controller => controller(world, &mut out),
        }
        Some(out)
    }
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
    let rate_hz = world.measured(30.0, 0.4);
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
    let scan_age_ms = world.scan_age_ms();
    let jumps = world.has(Fault::LocalizationJump);
    let score = if jumps { 0.55 } else { world.measured(0.93, 0.02) };
    let (level, message) = match world.localizer.matches(world.now_ms()) {
        _ if scan_age_ms > 250 => (ERROR, format!("No scan for {}", seconds(scan_age_ms))),
        Match::NoPosition => (STALE, "Waits to be told where it is".to_owned()),
        Match::Searches => (STALE, "Looks for the position that it was given".to_owned()),
        Match::FitsNowhere => (ERROR, "Scan does not fit the map where it was told to be".to_owned()),
        Match::Found if jumps => (WARN, "Scan fits the map badly".to_owned()),
        Match::Found => (OK, "Scan fits the map".to_owned()),
    };
    out.push_status(level, "localization: scan_matching", &message, "localization");
    out.push_value("score", &format!("{score:.2}"));
}

fn perception(world: &mut World, out: &mut StatusArray) {
    let tracks = if world.blind() { 0.0 } else { world.measured(7.0, 2.4).round() };
    let (level, message) = if world.blind() {
        (ERROR, format!("No scan for {}", seconds(world.scan_age_ms())))
    } else {
        (OK, "Tracks are stable".to_owned())
    };
    out.push_status(level, "perception: object_tracking", &message, "perception");
    out.push_value("tracks", &format!("{tracks:.0}"));
}

fn prediction(world: &mut World, out: &mut StatusArray) {
    const ID: &str = "prediction";
    let input_age_ms = world.costmap_delay_ms();
    let (level, message) = match input_age_ms {
        700.0.. => (ERROR, format!("Input is {input_age_ms:.0} ms old")),
        450.0.. => (WARN, format!("Input is {input_age_ms:.0} ms old")),
        _ => (OK, "Predicts all tracks for 4 s".to_owned()),
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

fn mission(world: &mut World, out: &mut StatusArray) {
    let drive = &world.drive;
    let message = match (drive.left_m(), drive.goal()) {
        (Some(left_m), _) => format!("To {}, {left_m:.0} m left", drive.next()),
        (None, Some(_)) => format!("At {}, wants to go to {}", drive.here(), drive.next()),
        (None, None) => format!("At {}", drive.here()),
    };
    out.push_status(OK, "mission: route", &message, "mission");
    out.push_value("next_stop", drive.next());
    let round_trip_ms = world.measured(38.0, 9.0);
    out.push_value("round_trip_ms", &format!("{round_trip_ms:.0}"));
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
    // Plans that were missing before the departure are no fault.
    let plan_age_ms = world.plan_age_ms().min(world.drive.driving_ms());
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

fn seconds(ms: u64) -> String {
    format!("{:.1} s", ms as f64 / 1000.0)
}
