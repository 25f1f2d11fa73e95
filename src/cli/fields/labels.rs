//! A number that was written by its name: whether its message has that name, and which it has, as `CHARGING` is meant for
//! `POWER_SUPPLY_STATUS_CHARGING`, which is 1 in a battery's message.

use super::Kinds;
use crate::config::expression;
use crate::engine::model::monitors::{Condition, FieldKind, FieldSpec, ScalarKind, ValueSource};

/// Names that are listed.
const NAMED_MAX: usize = 8;

impl Kinds<'_> {
    /// What to write instead of the name of a number, by the definition of its message; `None` if that names none.
    pub(super) fn number_of(
        &self,
        source: &ValueSource,
        label: &str,
        write: impl Fn(i64) -> String,
    ) -> Option<String> {
        let ValueSource::Field { topic, field } = source else { return None };
        let spec = &self.model.watched.topics[topic.0 as usize];
        let path = &spec.fields[*field as usize].path;
        let labels = self.definitions.labels(&spec.type_name, path);
        let last = path.rsplit('.').next().and_then(|part| part.split('[').next()).unwrap_or_default();
        let (whole, end) = (format!("{last}_{label}"), format!("_{label}").to_ascii_uppercase());
        let meant: Vec<_> =
            labels.iter().filter(|(name, _)| name.to_ascii_uppercase().ends_with(&end)).collect();
        let is_exact = |name: &str| [label, &whole].iter().any(|it| name.eq_ignore_ascii_case(it));
        let exact = labels.iter().find(|(name, _)| is_exact(name));
        match (exact, &meant[..], &labels[..]) {
            (Some((name, number)), ..) | (None, [(name, number)], _) => {
                Some(format!("{} is {number} in {}: write {}", name, spec.type_name, write(*number)))
            }
            (None, _, []) => None,
            (None, ..) => {
                let listed =
                    labels.iter().take(NAMED_MAX).map(|(name, number)| format!("{name} is {number}"));
                let listed = listed.collect::<Vec<_>>().join(", ");
                let more = match labels.len().saturating_sub(NAMED_MAX) {
                    0 => String::new(),
                    more => format!(" and {more} more"),
                };
                Some(format!("write the number: in {} {listed}{more}", spec.type_name))
            }
        }
    }

    /// What is wrong with the name of a number that its message does not have, and what to do.
    pub(super) fn misnamed(
        &self,
        source: &ValueSource,
        label: &str,
        write: impl Fn(i64) -> String,
    ) -> Option<(String, String)> {
        let ValueSource::Field { topic, field } = source else { return None };
        let spec = &self.model.watched.topics[topic.0 as usize];
        let FieldSpec { path, kind, .. } = &spec.fields[*field as usize];
        let labels = self.definitions.labels(&spec.type_name, path);
        if *kind != FieldKind::Named || labels.iter().any(|(name, _)| **name == *label) {
            return None;
        }
        let help = self.number_of(source, label, write)?;
        Some((format!("{} has no value `{label}` of `{path}`", spec.type_name), help))
    }

    /// The same for the names in a condition.
    pub(super) fn misnamed_in(
        &self,
        condition: &Condition,
        inputs: &[(Box<str>, ValueSource)],
    ) -> Option<(String, String)> {
        expression::texts(&condition.text).into_iter().find_map(|(input, label)| {
            let (_, source) = inputs.iter().find(|(name, _)| **name == *input)?;
            self.misnamed(source, &label, |number| format!("`{number}`"))
        })
    }

    /// What to write instead of the first number in a list that a condition compares with a text.
    pub(super) fn label_in(
        &self,
        condition: &Condition,
        inputs: &[(Box<str>, ValueSource)],
    ) -> Option<String> {
        expression::texts(&condition.text).into_iter().find_map(|(input, label)| {
            let (_, source) = inputs.iter().find(|(name, _)| **name == *input)?;
            let is_number = self.kind(source) == Some(ScalarKind::Number);
            is_number.then(|| self.number_of(source, &label, |number| format!("`{number}`")))?
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::check;
    use crate::config;
    use crate::msg::fields::Definitions;

    /// What is to be done about a monitor of a field.
    #[track_caller]
    fn help(monitor: &str) -> String {
        let text = format!("groups: [{{ id: a, modules: [{{ id: m, monitor: {{ {monitor} }} }}] }}]\n");
        let loaded = config::parse("c", &text).unwrap_or_else(|problems| panic!("{problems}"));
        let problems = check(&loaded, &Definitions::default()).expect("it never judges");
        problems.list()[0].help.as_deref().unwrap_or_default().to_owned()
    }

    #[test]
    fn a_name_that_the_message_has_stands_for_its_number() {
        let named = |name: &str, field: &str| {
            let source = format!("topic: /b, type: sensor_msgs/msg/BatteryState, field: {field}");
            let monitors = [
                format!("value: {{ {source}, error_unless: {name} }}"),
                format!("expression: {{ inputs: {{ s: {{ {source} }} }}, error: 's != \"{name}\"' }}"),
                format!("expression: {{ inputs: {{ s: {{ {source} }} }}, error: '!(s in [\"{name}\"])' }}"),
            ];
            monitors.map(|monitor| {
                let text =
                    format!("groups: [{{ id: a, modules: [{{ id: m, monitor: {{ {monitor} }} }}] }}]\n");
                let loaded = config::parse("c", &text).unwrap_or_else(|problems| panic!("{problems}"));
                check(&loaded, &Definitions::default()).map(|problems| problems.list()[0].message.clone())
            })
        };
        assert_eq!(named("POWER_SUPPLY_STATUS_FULL", "power_supply_status"), [None, None, None]);
        let wrong = "sensor_msgs/msg/BatteryState has no value `FULL` of `power_supply_status`";
        let said = named("FULL", "power_supply_status");
        assert!(said.iter().all(|said| said.as_ref().is_some_and(|said| said.contains(wrong))), "{said:?}");
        assert_eq!(named("anything", "location"), [None, None, None], "a text may be any");
    }

    #[test]
    fn a_number_written_by_its_name_is_answered_with_that_number() {
        let battery = "topic: /b, type: sensor_msgs/msg/BatteryState, field: power_supply_status";
        let value = |rule: &str| help(&format!("value: {{ {battery}, {rule} }}"));
        let charging = "POWER_SUPPLY_STATUS_CHARGING is 1 in sensor_msgs/msg/BatteryState: write";
        for label in ["CHARGING", "charging"] {
            // `NOT_CHARGING` ends alike.
            let said = value(&format!("error_unless: {label}"));
            assert_eq!(said, format!("{charging} `error_unless: 1`"), "{label}");
        }
        assert_eq!(
            value("warning_unless: FULL"),
            "POWER_SUPPLY_STATUS_FULL is 4 in sensor_msgs/msg/BatteryState: write `warning_unless: 4`"
        );
        assert!(value("error_unless: HALF").starts_with(
            "write the number: in sensor_msgs/msg/BatteryState POWER_SUPPLY_STATUS_UNKNOWN is 0, "
        ));
        let condition =
            format!("expression: {{ inputs: {{ s: {{ {battery} }} }}, error: 's != \"CHARGING\"' }}");
        assert_eq!(help(&condition), format!("{charging} `1`"));
        let cloud =
            "value: { topic: /c, type: sensor_msgs/msg/PointCloud2, field: width, error_unless: WIDE }";
        assert_eq!(help(cloud), "watch it with limits, or `error_unless: NUMBER`");
    }
}
