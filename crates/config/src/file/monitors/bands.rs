//! How limits are written: up to four, in an order that makes sense.

use crate::decode::{FromNode, Spanned};
use crate::fields::Fields;
use crate::file::{forms, units};
use telltale_engine::model::monitors::Bands;
use telltale_engine::state::State;
use telltale_yaml::decode::scalar;
use telltale_yaml::schema::{least, most, needs_any, of_type};
use telltale_yaml::{KeyDoc, Log, MapDoc, Members, Node, Problem, Schema, Span, key};

/// The names of the limits.
pub(crate) const KEYS: [&str; 4] = ["warning_below", "error_below", "warning_above", "error_above"];

/// The unit of a monitor's limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Unit {
    /// Any number.
    Number,
    /// A number that is never below 0: a ratio, a distance.
    Size,
    /// The same, optionally with the unit `Hz`.
    Hertz,
    /// A duration: a stamp that is ahead counts as one of now, or cannot be measured.
    Duration,
    /// An angle between two rotations: from 0 to 180.
    Degrees,
    /// A part of a whole: from 0 to 100.
    Percent,
}

impl Unit {
    fn read(self, node: &Node, log: &mut Log) -> Option<f64> {
        match self {
            Unit::Number | Unit::Size | Unit::Degrees | Unit::Percent => f64::from_node(node, log),
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
                        "write a number with one of the units ns, us, ms, s, m, h, d: for example `300ms`",
                    ));
                }
                seconds
            }
        }
    }

    fn form(self, schema: &mut Schema) -> Members {
        match self {
            Unit::Number => of_type("number"),
            Unit::Size => [of_type("number"), vec![least(0)]].concat(),
            Unit::Hertz => forms::rate(schema),
            Unit::Duration => forms::duration(schema),
            Unit::Percent => [of_type("number"), vec![least(0), most(100)]].concat(),
            Unit::Degrees => [of_type("number"), vec![least(0), most(180)]].concat(),
        }
    }

    /// The smallest and the largest possible measurement.
    fn range(self) -> (f64, f64) {
        match self {
            Unit::Number => (f64::NEG_INFINITY, f64::INFINITY),
            Unit::Size | Unit::Hertz | Unit::Duration => (0.0, f64::INFINITY),
            Unit::Degrees => (0.0, 180.0),
            Unit::Percent => (0.0, 100.0),
        }
    }
}

/// `9`, `9 Hz`, `0.5Hz`.
pub(crate) fn hertz(text: &str) -> Option<f64> {
    let number = text.strip_suffix("Hz").map_or(text, str::trim_end);
    number.parse().ok().filter(|hertz: &f64| hertz.is_finite())
}

/// `300ms`, `-50ms`.
fn seconds(text: &str) -> Option<f64> {
    let (sign, size) = text.strip_prefix('-').map_or((1.0, text), |size| (-1.0, size));
    units::parse(size).map(|span| sign * span.as_secs_f64())
}

/// Reads the four keys, which may all be missing. Impossible limits are logged.
pub(crate) fn bands(fields: &mut Fields, unit: Unit) -> Bands {
    of_keys(fields, unit, KEYS.map(|name| Some(key(name))))
}

/// The same for a duration that can only be too long: the other two keys are unknown.
pub(crate) fn durations_above(fields: &mut Fields, about: &'static str) -> Bands {
    let doc = |name: &'static str| key(name).about(about).form(forms::duration);
    of_keys(fields, Unit::Duration, KEYS.map(|name| name.ends_with("above").then(|| doc(name))))
}

fn of_keys(fields: &mut Fields, unit: Unit, keys: [Option<KeyDoc>; 4]) -> Bands {
    let read =
        |node: &Node, log: &mut Log| unit.read(node, log).map(|value| Spanned { value, span: node.span });
    let limits = keys.map(|key| fields.optional_by(key?, |schema| unit.form(schema), read));
    let (least, most) = unit.range();
    for (limit, key) in limits.iter().zip(KEYS) {
        let Some(limit) = limit else { continue };
        let never = if key.ends_with("below") { limit.value <= least } else { limit.value >= most };
        if never || !(least..=most).contains(&limit.value) {
            let text = match limit.value < least {
                true => format!("what is measured here is never below {least}"),
                false => format!("what is measured here is never {} {}", &key[key.len() - 5..], limit.value),
            };
            fields.log.push(Problem::at(limit.span, text).help(match unit {
                Unit::Duration => {
                    "choose a limit above 0, or remove it; `ahead` of a latency judges stamps of the future".to_owned()
                }
                _ if most.is_finite() => format!("choose a limit between {least} and {most}, or remove it"),
                _ => format!("choose a limit above {least}, or remove it"),
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
        unmeasurable: None,
    }
}

/// Limits of a number of events under these two names, and the place of the first; `None` if there are none.
pub(crate) fn counts_above(
    fields: &mut Fields,
    [warning, error]: [&'static str; 2],
    about: &'static str,
    (most, rules): (u64, fn() -> Members),
) -> Option<(Span, Bands)> {
    let mut limit = |name: &'static str| fields.optional::<Spanned<u64>>(key(name).about(about).rules(rules));
    let limits = [limit(warning), limit(error)];
    let first = limits.iter().flatten().next()?.span;
    for limit in limits.iter().flatten().filter(|limit| limit.value > most) {
        let problem = Problem::at(limit.span, format!("{} is not between 0 and {most}", limit.value));
        fields.log.push(problem.help("choose `0` where each of them is a fault"));
    }
    if let [Some(of_warning), Some(of_error)] = &limits
        && of_error.value < of_warning.value
    {
        let problem = Problem::at(of_error.span, format!("`{error}` is below `{warning}`"));
        fields.log.push(problem.help("exchange the two, or correct one of them"));
    }
    let [warning_above, error_above] = limits.map(|limit| limit.map(|limit| limit.value as f64));
    Some((first, Bands { warning_above, error_above, ..Bands::default() }))
}

/// Reads the state of what cannot be measured.
pub(crate) fn unmeasurable(fields: &mut Fields, key: KeyDoc) -> Option<State> {
    let states = [State::Unknown, State::Warning, State::Error].map(|state| (state.as_str(), state));
    fields.choice(key, "state", &states)
}

fn check_order(lower: Option<Spanned<f64>>, upper: Option<Spanned<f64>>, text: &str, log: &mut Log) {
    if let (Some(lower), Some(upper)) = (lower, upper)
        && lower.value > upper.value
    {
        let problem = Problem::at(lower.span, text).label("this one").also(upper.span, "and this one");
        log.push(problem.help("exchange the two, or correct one of them"));
    }
}

/// Reads the four keys; at least one has to be there.
pub(crate) fn some_bands(fields: &mut Fields, unit: Unit) -> Bands {
    fields.rule(|| needs_any(&KEYS.each_ref().map(std::slice::from_ref)));
    let found = bands(fields, unit);
    if !any(fields) {
        without_a_limit(fields.span(), "", fields.log);
    }
    found
}

/// Logs that there is no limit.
pub(crate) fn without_a_limit(span: Span, more: &str, log: &mut Log) {
    let problem = Problem::at(span, "without a limit this would never be anything but OK");
    log.push(problem.help(format!("add at least one of {}{more}", KEYS.join(", "))));
}

/// Whether any of the four keys is there, valid or not.
pub(crate) fn any(fields: &Fields) -> bool {
    KEYS.iter().any(|key| fields.key_span(key).is_some())
}

/// Limits in a map of their own.
pub(crate) fn map(node: &Node, doc: MapDoc, unit: Unit, log: &mut Log) -> Option<Bands> {
    let mut fields = Fields::of(node, doc, log)?;
    Some(some_bands(&mut fields, unit))
}
