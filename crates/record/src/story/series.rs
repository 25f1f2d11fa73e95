//! Numbers over time in an incident: a replay of its recording finds them.

use schemars::JsonSchema;
use serde::Serialize;

/// A number that a node reported, or that the vehicle had, over the time of an incident.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
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
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Limit {
    pub name: String,
    pub value: f64,
}

/// The names under which the monitors report their limits.
const NAMES: [&str; 4] = ["warning_below", "error_below", "warning_above", "error_above"];

impl Limit {
    /// Whether the value with this key is a limit.
    pub fn is_name(key: &str) -> bool {
        Limit::split(key).is_some()
    }

    /// The number that a limit bounds, and the name of the limit: `translation_m` and `error_above` of the key
    /// `translation_m_error_above`. A monitor of one number does not name it.
    fn split(key: &str) -> Option<(&str, &'static str)> {
        NAMES.iter().find_map(|&name| match key.strip_suffix(name)? {
            "" => Some(("", name)),
            of => Some((of.strip_suffix('_').filter(|of| !of.is_empty())?, name)),
        })
    }

    /// The limits in a report, each with the key of the number that it bounds: the named one, or the first one, which
    /// the monitor measures.
    pub fn reported(values: &[(Box<str>, Box<str>)]) -> Vec<(&str, Limit)> {
        let mut measured = None;
        let mut limits = Vec::new();
        for (key, value) in values {
            let Some(value) = value.parse().ok().filter(|value: &f64| value.is_finite()) else { continue };
            match (Limit::split(key), measured) {
                (None, _) => drop(measured.get_or_insert(&**key)),
                (Some(("", name)), Some(measured)) => {
                    limits.push((measured, Limit { name: name.to_owned(), value }));
                }
                (Some(("", _)), None) => {}
                (Some((of, name)), _) => limits.push((of, Limit { name: name.to_owned(), value })),
            }
        }
        limits
    }
}
