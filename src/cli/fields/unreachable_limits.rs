//! Limits that a field cannot reach, by its type: a `uint8` is never above 255.

use super::Kinds;
use crate::config::expression;
use crate::engine::model::monitors::{Bands, MonitorSpec, ValueRule, ValueSource};
use crate::engine::model::sample::FieldValue;

impl Kinds<'_> {
    /// Comparisons that hold always or never, whatever the field is, and what to do.
    pub(super) fn beyond(&self, monitor: &MonitorSpec) -> Vec<(String, String)> {
        let mut found = Vec::new();
        let mut look = |source: &ValueSource, name: &str, sign: &str, limit: f64| {
            let Some((least, most)) = self.range(source) else { return };
            let Some(always) = settled((least, most), sign, limit) else { return };
            let (always, path) = (if always { "always" } else { "never" }, self.path(source));
            let text =
                format!("`{name} {sign} {limit}` {always} holds: `{path}` goes from {least} to {most}");
            found.push((text, "correct the limit, or name another field".to_owned()));
        };
        match monitor {
            MonitorSpec::Value { source, rule: ValueRule::Bands(bands), .. } => {
                let Bands { warning_below, error_below, warning_above, error_above, unmeasurable: _ } =
                    *bands;
                let limits =
                    [("<", warning_below), ("<", error_below), (">", warning_above), (">", error_above)];
                for (sign, limit) in limits {
                    limit.into_iter().for_each(|limit| look(source, self.path(source), sign, limit));
                }
            }
            MonitorSpec::Value { source, rule: ValueRule::Unless { error, warning }, .. } => {
                for wanted in [error, warning].into_iter().flatten() {
                    if let FieldValue::Number(wanted) = wanted {
                        look(source, self.path(source), "==", *wanted);
                    }
                }
            }
            MonitorSpec::Expression { inputs, warning, error, .. } => {
                for limit in [error, warning].into_iter().flatten().flat_map(expression::limits) {
                    if let Some((name, source)) = inputs.iter().find(|(name, _)| **name == *limit.input) {
                        look(source, name, limit.sign, limit.number);
                    }
                }
            }
            _ => {}
        }
        found
    }
}

/// Whether a comparison with a number out of the range holds always; `None` where it depends. That what
/// goes from 0 is `>= 0` is no mistake.
fn settled((least, most): (f64, f64), sign: &str, limit: f64) -> Option<bool> {
    match sign {
        "<" if limit <= least => Some(false),
        ">" if limit >= most => Some(false),
        "==" if limit < least || limit > most => Some(false),
        "!=" if limit < least || limit > most => Some(true),
        "<" | "<=" if limit > most => Some(true),
        ">" | ">=" if limit < least => Some(true),
        "<=" if limit < least => Some(false),
        ">=" if limit > most => Some(false),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::check;
    use crate::config;
    use crate::msg::fields::Definitions;

    /// What is said of a monitor, or of a signal of one value.
    fn said(monitor: &str) -> Vec<String> {
        let text = match monitor.split_once("when: ") {
            Some(_) => {
                format!("signals: {{ s: {{ {monitor} }} }}\ngroups: [{{ id: a, match: [{{ name: a }}] }}]\n")
            }
            None => format!("groups: [{{ id: a, modules: [{{ id: m, monitor: {{ {monitor} }} }}] }}]\n"),
        };
        let loaded = config::parse("c", &text).unwrap_or_else(|problems| panic!("{problems}"));
        let lines = check(&loaded, &Definitions::default()).map(|problems| problems.lines());
        let words =
            |line: &String| line.split_once("`: ").map(|(_, rest)| rest.to_owned()).unwrap_or_default();
        lines.unwrap_or_default().iter().map(words).collect()
    }

    #[test]
    fn limits_that_the_type_of_a_field_does_not_reach_are_refused() {
        let battery = "topic: /b, type: sensor_msgs/msg/BatteryState, field: power_supply_status";
        let help = "(correct the limit, or name another field)";
        let is = |text: &str| vec![format!("{text}: `power_supply_status` goes from 0 to 255 {help}")];
        let value = |rule: &str| said(&format!("value: {{ {battery}, {rule} }}"));
        assert_eq!(value("error_above: 300"), is("`power_supply_status > 300` never holds"));
        assert_eq!(value("error_below: 0"), is("`power_supply_status < 0` never holds"));
        assert_eq!(value("warning_above: -1"), is("`power_supply_status > -1` always holds"));
        assert_eq!(value("error_unless: 256"), is("`power_supply_status == 256` never holds"));
        assert_eq!(value("error_above: 254"), [""; 0]);
        assert_eq!(value("error_unless: 255"), [""; 0]);
        let when = |text: &str| said(&format!("{battery}, when: {text}"));
        assert_eq!(when("value > 300"), is("`value > 300` never holds"));
        assert_eq!(when("'!(value <= -1)'"), is("`value <= -1` never holds"));
        assert_eq!(when("value != 256 && value >= 0"), is("`value != 256` always holds"));
        assert_eq!(when("value >= 0 && value * 2 > 300"), [""; 0]);
        let expression =
            |text: &str| said(&format!("expression: {{ inputs: {{ s: {{ {battery} }} }}, error: {text} }}"));
        assert_eq!(expression("1000 <= s"), is("`s >= 1000` never holds"));
        let charge = "topic: /b, type: sensor_msgs/msg/BatteryState, field: charge";
        assert_eq!(said(&format!("value: {{ {charge}, error_above: 1e30 }}")), [""; 0]);
    }
}
