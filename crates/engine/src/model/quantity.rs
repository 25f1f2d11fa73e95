//! How people read numbers: with few digits, and with the units of the fields of standard messages.

use std::sync::Arc;

use super::monitors::{MonitorSpec, ValueSource, Watched};

/// How people read a number: times `factor`, with its unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    pub unit: Arc<str>,
    pub factor: f64,
}

impl Quantity {
    fn plain(unit: &str) -> Quantity {
        Quantity { unit: unit.into(), factor: 1.0 }
    }

    /// A part of a whole, which people read in hundredths.
    fn fraction() -> Quantity {
        Quantity { unit: "%".into(), factor: 100.0 }
    }

    /// The quantity of a value, if its unit is known: that of a standard message's field, or the one that the
    /// configuration names.
    pub fn of(source: &ValueSource, watched: &Watched) -> Option<Quantity> {
        match source {
            ValueSource::Field { topic, field } => {
                let topic = &watched.topics[topic.0 as usize];
                of_field(&topic.type_name, &topic.fields[*field as usize].path)
            }
            ValueSource::Key { unit, .. } => unit.as_deref().map(Quantity::plain),
        }
    }

    /// Whether the messages have it as a number from 0 to 1.
    pub fn is_fraction(&self) -> bool {
        *self == Quantity::fraction()
    }

    /// The quantity of what a monitor measures, if its values have one quantity.
    pub fn measured_by(spec: &MonitorSpec, watched: &Watched) -> Option<Quantity> {
        let (sources, _) = spec.measured();
        let mut quantities = sources.into_iter().map(|source| Quantity::of(source, watched));
        let first = quantities.next()??;
        quantities.all(|it| it.as_ref() == Some(&first)).then_some(first)
    }
}

/// Three significant digits for fractions, whole numbers up to a million in full.
pub fn number(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e6 { format!("{}", value + 0.0) } else { rounded(value, 3) }
}

pub fn rounded(value: f64, digits: i32) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if !value.is_finite() {
        return if value.is_nan() { "not a number".into() } else { "infinite".into() };
    }
    let magnitude = value.abs().log10().floor() as i32;
    if !(-5..9).contains(&magnitude) {
        return format!("{value:.*e}", digits as usize - 1);
    }
    let text = format!("{value:.*}", (digits - 1 - magnitude).max(0) as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

/// The quantity of a field by the standard messages' definitions (REP 103, and the comments in their files).
fn of_field(type_name: &str, path: &str) -> Option<Quantity> {
    let (package, kind) = type_name.split_once("/msg/")?;
    if !matches!(package, "geometry_msgs" | "nav_msgs" | "sensor_msgs" | "std_msgs") {
        return None;
    }
    let members: Vec<&str> =
        path.split('.').map(|it| it.split_once('[').map_or(it, |(name, _)| name)).collect();
    if let [member] = *members {
        return of_member(kind, member);
    }
    let [.., part, axis] = *members else { return None };
    if !matches!(axis, "x" | "y" | "z") {
        return None;
    }
    // `twist.twist.linear.x` of an Odometry, `linear.x` of a Twist.
    let around = members.iter().rev().nth(2).copied().unwrap_or(kind).to_ascii_lowercase();
    Some(Quantity::plain(match part {
        "linear" if around.starts_with("twist") => "m/s",
        "linear" if around.starts_with("accel") => "m/s²",
        "angular" if around.starts_with("twist") => "rad/s",
        "angular" if around.starts_with("accel") => "rad/s²",
        "angular_velocity" => "rad/s",
        "linear_acceleration" => "m/s²",
        "magnetic_field" => "T",
        "force" => "N",
        "torque" => "N m",
        "position" | "translation" | "point" => "m",
        _ => return None,
    }))
}

fn of_member(kind: &str, member: &str) -> Option<Quantity> {
    Some(match (kind, member) {
        ("BatteryState", "percentage")
        | ("RelativeHumidity", "relative_humidity")
        | ("JoyFeedback", "intensity")
        | ("ColorRGBA", "r" | "g" | "b" | "a") => Quantity::fraction(),
        ("BatteryState", "voltage" | "cell_voltage") => Quantity::plain("V"),
        ("BatteryState", "current") => Quantity::plain("A"),
        ("BatteryState", "charge" | "capacity" | "design_capacity") => Quantity::plain("Ah"),
        ("BatteryState" | "Temperature", "temperature") | ("BatteryState", "cell_temperature") => {
            Quantity::plain("°C")
        }
        ("FluidPressure", "fluid_pressure") => Quantity::plain("Pa"),
        ("Illuminance", "illuminance") => Quantity::plain("lx"),
        ("Range", "range" | "min_range" | "max_range")
        | ("LaserScan", "ranges" | "range_min" | "range_max")
        | ("NavSatFix", "altitude")
        | ("Point" | "Point32", "x" | "y" | "z") => Quantity::plain("m"),
        ("NavSatFix", "latitude" | "longitude") => Quantity::plain("°"),
        ("LaserScan", "angle_min" | "angle_max" | "angle_increment") | ("Range", "field_of_view") => {
            Quantity::plain("rad")
        }
        ("LaserScan", "scan_time" | "time_increment") => Quantity::plain("s"),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_of_standard_messages_have_their_units() {
        let cases = [
            ("sensor_msgs/msg/BatteryState", "percentage", Some(("%", 100.0))),
            ("sensor_msgs/msg/BatteryState", "voltage", Some(("V", 1.0))),
            ("sensor_msgs/msg/BatteryState", "cell_voltage[2]", Some(("V", 1.0))),
            ("sensor_msgs/msg/BatteryState", "temperature", Some(("°C", 1.0))),
            ("sensor_msgs/msg/BatteryState", "power_supply_status", None),
            ("sensor_msgs/msg/Imu", "angular_velocity.z", Some(("rad/s", 1.0))),
            ("sensor_msgs/msg/Imu", "orientation.z", None),
            ("sensor_msgs/msg/JointState", "position[0]", None),
            ("geometry_msgs/msg/Twist", "linear.x", Some(("m/s", 1.0))),
            ("geometry_msgs/msg/TwistStamped", "twist.angular.z", Some(("rad/s", 1.0))),
            ("geometry_msgs/msg/AccelStamped", "accel.linear.x", Some(("m/s²", 1.0))),
            ("nav_msgs/msg/Odometry", "twist.twist.linear.x", Some(("m/s", 1.0))),
            ("nav_msgs/msg/Odometry", "pose.pose.position.y", Some(("m", 1.0))),
            ("nav_msgs/msg/Odometry", "pose.covariance[0]", None),
            ("std_msgs/msg/Float64", "data", None),
            ("my_msgs/msg/BatteryState", "percentage", None),
            ("", "percentage", None),
        ];
        for (type_name, path, expected) in cases {
            let found = of_field(type_name, path);
            let found = found.as_ref().map(|it| (&*it.unit, it.factor));
            assert_eq!(found, expected, "{type_name} {path}");
        }
    }
}
