//! Numbers over time in an incident: a replay of its recording finds them.

use serde::Serialize;

/// A number that a node reported, or that the vehicle had, over the time of an incident.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Series {
    /// Empty: the vehicle.
    pub node: String,
    /// The key of the report; `speed_kmh` of the vehicle.
    pub key: String,
    /// Milliseconds since 1970; `null` where there was no number.
    pub points: Vec<(i64, Option<f64>)>,
    pub limits: Vec<Limit>,
}

/// A limit of a monitor, by its name in the configuration.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Limit {
    pub name: String,
    pub value: f64,
}
