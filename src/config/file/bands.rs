//! Limits as they are written: up to four, in an order that makes sense.

use super::units;
use crate::engine::model::monitors::Bands;
use crate::yaml::decode::scalar;
use crate::yaml::{Fields, FromNode, Log, Node, Problem, Span, Spanned};

const KEYS: [&str; 4] = ["warning_below", "error_below", "warning_above", "error_above"];

/// What the limits of a monitor are written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::config) enum Unit {
    /// Any number.
    Number,
    /// A number that is never below 0: a ratio, a distance.
    Size,
    /// The same, with or without the unit `Hz`.
    Hertz,
    /// A duration, or one with a minus.
    Duration,
    /// An angle between two rotations: from 0 to 180.
    Degrees,
}

impl Unit {
    fn read(self, node: &Node, log: &mut Log) -> Option<f64> {
        match self {
            Unit::Number | Unit::Size | Unit::Degrees => f64::from_node(node, log),
            Unit::Hertz => {
                let hertz = scalar(node).and_then(hertz);
                if hertz.is_none() {
                    let problem =
                        Problem::at(node.span, format!("expected a rate, found {}", node.describe()));
                    log.push(problem.help("write a number in hertz, for example `9` or `9 Hz`"));
                }
                hertz
            }
            Unit::Duration => {
                let seconds = scalar(node).and_then(seconds);
                if seconds.is_none() {
                    let problem =
                        Problem::at(node.span, format!("expected a duration, found {}", node.describe()));
                    log.push(problem.help(
                        "write a number with one of the units ns, us, ms, s, m, h: for example `300ms`",
                    ));
                }
                seconds
            }
        }
    }

    /// The least and the most that can be measured.
    fn range(self) -> (f64, f64) {
        match self {
            Unit::Number | Unit::Duration => (f64::NEG_INFINITY, f64::INFINITY),
            Unit::Size | Unit::Hertz => (0.0, f64::INFINITY),
            Unit::Degrees => (0.0, 180.0),
        }
    }
}

/// `9`, `9 Hz`, `0.5Hz`.
pub(in crate::config) fn hertz(text: &str) -> Option<f64> {
    let number = text.strip_suffix("Hz").map_or(text, str::trim_end);
    number.parse().ok().filter(|hertz: &f64| hertz.is_finite())
}

/// `300ms`, `-50ms`.
fn seconds(text: &str) -> Option<f64> {
    let (sign, size) = text.strip_prefix('-').map_or((1.0, text), |size| (-1.0, size));
    units::parse(size).map(|span| sign * span.as_nanos() as f64 / 1e9)
}

/// Reads the four keys. The log says what cannot be; no limit at all can.
pub(in crate::config) fn bands(fields: &mut Fields, unit: Unit) -> Bands {
    of_keys(fields, unit, |_| true)
}

/// The same for what can only be too much: the other two keys are unknown.
pub(in crate::config) fn above(fields: &mut Fields, unit: Unit) -> Bands {
    of_keys(fields, unit, |key| key.ends_with("above"))
}

fn of_keys(fields: &mut Fields, unit: Unit, is_wanted: impl Fn(&str) -> bool) -> Bands {
    let limits = KEYS.map(|key| {
        let node = is_wanted(key).then(|| fields.node(key)).flatten()?;
        unit.read(node, fields.log).map(|value| Spanned { value, span: node.span })
    });
    let (least, most) = unit.range();
    for (limit, key) in limits.iter().zip(KEYS) {
        let Some(limit) = limit else { continue };
        let never = if key.ends_with("below") { limit.value <= least } else { limit.value >= most };
        if never || !(least..=most).contains(&limit.value) {
            let text = format!("what is measured here is never {} {}", &key[key.len() - 5..], limit.value);
            fields.log.push(Problem::at(limit.span, text).help(match most.is_finite() {
                true => format!("choose a limit between {least} and {most}, or remove it"),
                false => format!("choose a limit above {least}, or remove it"),
            }));
        }
    }
    let [warning_below, error_below, warning_above, error_above] = limits;
    let order = [
        (error_below, warning_below, "`error_below` is above `warning_below`"),
        (warning_above, error_above, "`warning_above` is above `error_above`"),
        (warning_below.or(error_below), warning_above.or(error_above), "no value lies between these limits"),
    ];
    for (lower, upper, text) in order {
        check_order(lower, upper, text, fields.log);
    }
    let value = |limit: Option<Spanned<f64>>| limit.map(|limit| limit.value);
    Bands {
        warning_below: value(warning_below),
        error_below: value(error_below),
        warning_above: value(warning_above),
        error_above: value(error_above),
    }
}

fn check_order(lower: Option<Spanned<f64>>, upper: Option<Spanned<f64>>, text: &str, log: &mut Log) {
    if let (Some(lower), Some(upper)) = (lower, upper)
        && lower.value > upper.value
    {
        let problem = Problem::at(lower.span, text).label("this one").also(upper.span, "and this one");
        log.push(problem.help("exchange the two, or correct one of them"));
    }
}

/// Logs that nothing limits anything.
pub(in crate::config) fn without_a_limit(span: Span, more: &str, log: &mut Log) {
    let problem = Problem::at(span, "without a limit this would never be anything but OK");
    log.push(problem.help(format!("add at least one of {}{more}", KEYS.join(", "))));
}

/// Whether any key of the four is there, readable or not.
pub(in crate::config) fn any(fields: &Fields) -> bool {
    KEYS.iter().any(|key| fields.key_span(key).is_some())
}

/// Limits in a map of their own.
pub(in crate::config) fn map(node: &Node, what: &'static str, unit: Unit, log: &mut Log) -> Option<Bands> {
    let mut fields = Fields::of(node, what, log)?;
    let found = bands(&mut fields, unit);
    if !any(&fields) {
        without_a_limit(node.span, "", fields.log);
    }
    fields.finish();
    Some(found)
}
