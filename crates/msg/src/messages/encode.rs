//! The bodies of the messages that simulated machines publish. Poses are in metres, their rotations
//! are unit quaternions; fields that a simulation does not use are zero, as ROS 2 initializes them.

use std::time::{SystemTime, UNIX_EPOCH};

use super::Writer;
use telltale_engine::model::sample::Pose;

pub const ACCEL_STAMPED: &str = "geometry_msgs/msg/AccelStamped";
pub const BATTERY_STATE: &str = "sensor_msgs/msg/BatteryState";
pub const FLOAT64: &str = "std_msgs/msg/Float64";
pub const IMU: &str = "sensor_msgs/msg/Imu";
pub const LOG: &str = "rcl_interfaces/msg/Log";
pub const LASER_SCAN: &str = "sensor_msgs/msg/LaserScan";
pub const OCCUPANCY_GRID: &str = "nav_msgs/msg/OccupancyGrid";
pub const ODOMETRY: &str = "nav_msgs/msg/Odometry";
pub const PATH: &str = "nav_msgs/msg/Path";
pub const POINT_CLOUD_2: &str = "sensor_msgs/msg/PointCloud2";
pub const POSE_ARRAY: &str = "geometry_msgs/msg/PoseArray";
pub const POSE_STAMPED: &str = "geometry_msgs/msg/PoseStamped";
pub const POSE_WITH_COVARIANCE_STAMPED: &str = "geometry_msgs/msg/PoseWithCovarianceStamped";
pub const STRING: &str = "std_msgs/msg/String";
pub const TF_MESSAGE: &str = "tf2_msgs/msg/TFMessage";
pub const TWIST: &str = "geometry_msgs/msg/Twist";
pub const TWIST_STAMPED: &str = "geometry_msgs/msg/TwistStamped";
pub const VELODYNE_SCAN: &str = "velodyne_msgs/msg/VelodyneScan";

/// Bytes of one Velodyne packet on the network.
pub const VELODYNE_PACKET_BYTES: usize = 1206;

/// `std_msgs/Header`.
#[derive(Debug, Clone, Copy)]
pub struct Header<'a> {
    pub stamp: SystemTime,
    pub frame_id: &'a str,
}

/// A velocity, in m/s and rad/s, or an acceleration, in their squares.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Motion {
    pub linear: [f64; 3],
    pub angular: [f64; 3],
}

/// `geometry_msgs/TransformStamped`.
#[derive(Debug, Clone, Copy)]
pub struct Transform<'a> {
    pub header: Header<'a>,
    pub child_frame_id: &'a str,
    pub pose: Pose,
}

/// `nav_msgs/OccupancyGrid`, its origin without a rotation.
#[derive(Debug, Clone, Copy)]
pub struct Grid<'a> {
    pub resolution_m: f32,
    pub width: u32,
    pub origin_x_m: f64,
    pub origin_y_m: f64,
    /// Rows of `width` cells: 0 to 100, or -1 if unknown.
    pub cells: &'a [i8],
}

/// The levels of `rcl_interfaces/Log` that are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    Warn = 30,
    Error = 40,
}

/// `rcl_interfaces/Log`, with the file and the line that say it.
pub fn log(at: SystemTime, severity: Severity, name: &str, text: &str, (file, line): (&str, u32)) -> Vec<u8> {
    body(|writer| {
        stamp(writer, at);
        writer.u8(severity as u8);
        writer.string(name);
        writer.string(text);
        writer.string(file);
        writer.string("");
        writer.u32(line);
    })
}

pub fn boolean(value: bool) -> Vec<u8> {
    body(|writer| writer.u8(u8::from(value)))
}

pub fn float64(value: f64) -> Vec<u8> {
    body(|writer| writer.f64(value))
}

pub fn string(text: &str) -> Vec<u8> {
    body(|writer| writer.string(text))
}

pub fn odometry(head: Header<'_>, child_frame_id: &str, at: Pose, velocity: Motion) -> Vec<u8> {
    body(|writer| {
        header(writer, head);
        writer.string(child_frame_id);
        pose(writer, at);
        covariance(writer);
        motion(writer, velocity);
        covariance(writer);
    })
}

pub fn twist(velocity: Motion) -> Vec<u8> {
    body(|writer| motion(writer, velocity))
}

pub fn twist_stamped(head: Header<'_>, velocity: Motion) -> Vec<u8> {
    body(|writer| {
        header(writer, head);
        motion(writer, velocity);
    })
}

/// `sensor_msgs/BatteryState`: the charge from 0 to 1; values that are not measured are NaN.
pub fn battery_state(head: Header<'_>, charge: f64, voltage_v: f64, current_a: f64) -> Vec<u8> {
    const NOT_MEASURED: f32 = f32::NAN;
    const DISCHARGES: u8 = 2;
    const GOOD: u8 = 1;
    const LITHIUM_IRON: u8 = 4;
    body(|writer| {
        header(writer, head);
        let [charge, voltage_v, current_a] = [charge, voltage_v, current_a].map(|it| it as f32);
        let measured = [voltage_v, NOT_MEASURED, current_a, NOT_MEASURED, NOT_MEASURED, NOT_MEASURED, charge];
        measured.into_iter().for_each(|value| writer.f32(value));
        [DISCHARGES, GOOD, LITHIUM_IRON, 1].into_iter().for_each(|value| writer.u8(value));
        count(writer, 0);
        count(writer, 0);
        writer.string("");
        writer.string("");
    })
}

pub fn accel_stamped(head: Header<'_>, acceleration: Motion) -> Vec<u8> {
    twist_stamped(head, acceleration)
}

pub fn pose_stamped(head: Header<'_>, at: Pose) -> Vec<u8> {
    body(|writer| {
        header(writer, head);
        pose(writer, at);
    })
}

pub fn pose_with_covariance_stamped(head: Header<'_>, at: Pose, covariance: &[f64; 36]) -> Vec<u8> {
    body(|writer| {
        header(writer, head);
        pose(writer, at);
        covariance.iter().for_each(|&value| writer.f64(value));
    })
}

pub fn pose_array(head: Header<'_>, poses: &[Pose]) -> Vec<u8> {
    body(|writer| {
        header(writer, head);
        count(writer, poses.len());
        poses.iter().for_each(|&at| pose(writer, at));
    })
}

/// Every pose of a path has the header of the whole.
pub fn path(head: Header<'_>, poses: &[Pose]) -> Vec<u8> {
    body(|writer| {
        header(writer, head);
        count(writer, poses.len());
        for &at in poses {
            header(writer, head);
            pose(writer, at);
        }
    })
}

pub fn tf_message(transforms: &[Transform<'_>]) -> Vec<u8> {
    body(|writer| {
        count(writer, transforms.len());
        for transform in transforms {
            header(writer, transform.header);
            writer.string(transform.child_frame_id);
            pose(writer, transform.pose);
        }
    })
}

/// Only whole rows.
pub fn occupancy_grid(head: Header<'_>, grid: Grid<'_>) -> Vec<u8> {
    let rows = grid.cells.len().checked_div(grid.width as usize).unwrap_or(0);
    let cells = &grid.cells[..rows * grid.width as usize];
    body(|writer| {
        header(writer, head);
        stamp(writer, head.stamp);
        writer.f32(grid.resolution_m);
        writer.u32(grid.width);
        count(writer, rows);
        pose(writer, Pose { x_m: grid.origin_x_m, y_m: grid.origin_y_m, qw: 1.0, ..Pose::default() });
        count(writer, cells.len());
        cells.iter().for_each(|&cell| writer.u8(cell.cast_unsigned()));
    })
}

/// `velodyne_msgs/VelodyneScan` with this many empty packets.
pub fn velodyne_scan(head: Header<'_>, packets: usize) -> Vec<u8> {
    body(|writer| {
        header(writer, head);
        count(writer, packets);
        for _ in 0..packets {
            stamp(writer, head.stamp);
            writer.octets(&[0; VELODYNE_PACKET_BYTES]);
        }
    })
}

/// `sensor_msgs/Imu` that does not know its orientation.
pub fn imu(head: Header<'_>, motions: Motion) -> Vec<u8> {
    let unknown = |writer: &mut Writer, first: f64| {
        writer.f64(first);
        (0..8).for_each(|_| writer.f64(0.0));
    };
    let vector =
        |writer: &mut Writer, values: [f64; 3]| values.into_iter().for_each(|value| writer.f64(value));
    body(|writer| {
        header(writer, head);
        [0.0, 0.0, 0.0, 1.0].into_iter().for_each(|value| writer.f64(value));
        unknown(writer, -1.0);
        vector(writer, motions.angular);
        unknown(writer, 0.0);
        vector(writer, motions.linear);
        unknown(writer, 0.0);
    })
}

/// `sensor_msgs/LaserScan` around itself, ten times a second, with these distances.
pub fn laser_scan(head: Header<'_>, ranges_m: &[f32]) -> Vec<u8> {
    let step = std::f32::consts::TAU / ranges_m.len().max(1) as f32;
    let around = [-std::f32::consts::PI, std::f32::consts::PI - step, step];
    body(|writer| {
        header(writer, head);
        around.into_iter().chain([0.0, 0.1, 0.1, 25.0]).for_each(|value| writer.f32(value));
        count(writer, ranges_m.len());
        ranges_m.iter().for_each(|&range_m| writer.f32(range_m));
        count(writer, 0);
    })
}

/// `sensor_msgs/PointCloud2` of `points` points at its origin: three `float32` each, one row.
pub fn point_cloud(head: Header<'_>, points: u32) -> Vec<u8> {
    const FLOAT32: u8 = 7;
    const POINT_BYTES: u32 = 12;
    let bytes = points.saturating_mul(POINT_BYTES);
    body(|writer| {
        header(writer, head);
        writer.u32(1);
        writer.u32(points);
        writer.u32(3);
        for (index, name) in ["x", "y", "z"].into_iter().enumerate() {
            writer.string(name);
            writer.u32(4 * index as u32);
            writer.u8(FLOAT32);
            writer.u32(1);
        }
        writer.u8(0);
        writer.u32(POINT_BYTES);
        writer.u32(bytes);
        writer.u32(bytes);
        writer.octets(&vec![0; bytes as usize]);
        writer.u8(1);
    })
}

pub(super) fn header(writer: &mut Writer, header: Header<'_>) {
    stamp(writer, header.stamp);
    writer.string(header.frame_id);
}

fn body(write: impl FnOnce(&mut Writer)) -> Vec<u8> {
    let mut writer = Writer::default();
    write(&mut writer);
    writer.finish()
}

fn stamp(writer: &mut Writer, stamp: SystemTime) {
    let since_epoch = stamp.duration_since(UNIX_EPOCH).unwrap_or_default();
    // Seconds are an int32 in ROS 2 and last until 2038.
    writer.u32(u32::try_from(since_epoch.as_secs()).unwrap_or(i32::MAX as u32));
    writer.u32(since_epoch.subsec_nanos());
}

/// The length of an array; no array here has 2^32 elements.
fn count(writer: &mut Writer, elements: usize) {
    writer.u32(u32::try_from(elements).unwrap_or(u32::MAX));
}

fn pose(writer: &mut Writer, Pose { x_m, y_m, z_m, qx, qy, qz, qw }: Pose) {
    [x_m, y_m, z_m, qx, qy, qz, qw].into_iter().for_each(|value| writer.f64(value));
}

fn motion(writer: &mut Writer, Motion { linear, angular }: Motion) {
    let axes = |writer: &mut Writer, values: [f64; 3]| values.into_iter().for_each(|value| writer.f64(value));
    axes(writer, linear);
    axes(writer, angular);
}

fn covariance(writer: &mut Writer) {
    (0..36).for_each(|_| writer.f64(0.0));
}
