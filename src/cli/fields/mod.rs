//! Checks that the fields of a configuration can be read, before the start and before a reload.

mod labels;
mod unreachable_limits;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use crate::config::{Examined, Loaded, ModelPlace, expression};
use crate::engine::model::monitors::{
    Condition, FieldSpec, MonitorSpec, ScalarKind, TopicId, TopicSpec, ValueRule, ValueSource,
};
use crate::engine::model::motion::WatchedField;
use crate::engine::model::sample::FieldValue;
use crate::engine::model::{Model, ModuleId};
use crate::msg::fields::{Definitions, FieldError, FieldsError};
use crate::yaml::{Problems, Sources};

/// Where definitions of messages are found.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct DefinitionFlags {
    /// A folder with definitions of messages, DIR/package/msg/Name.msg; may be repeated. Those of a
    /// sourced ROS 2 installation and the common packages are known
    #[arg(long = "definitions", value_name = "DIR")]
    folders: Vec<PathBuf>,
}

impl DefinitionFlags {
    pub fn definitions(&self) -> Definitions {
        Definitions::of_environment(self.folders.clone(), |name| std::env::var(name).ok())
    }
}

/// The configuration, if the fields that it names exist. All errors are reported at once.
///
/// # Errors
/// Everything that is wrong.
pub fn whole(
    examined: Examined,
    definitions: impl FnOnce(&Loaded) -> Definitions,
) -> Result<Loaded, Problems> {
    let Examined { loaded, problems } = examined;
    let of_fields = loaded.as_ref().and_then(|loaded| check(loaded, &definitions(loaded)));
    match (problems, of_fields, loaded) {
        (None, None, Some(loaded)) => Ok(loaded),
        (Some(problems), Some(more), _) => Err(problems.and(more)),
        (Some(problems), None, _) | (None, Some(problems), _) => Err(problems),
        // What cannot be read has a problem.
        (None, None, None) => Err(Problems::new(Sources::default(), Vec::new())),
    }
}

/// Every field that the signals and monitors of a configuration name and that does not exist, each with its
/// place.
pub fn check(loaded: &Loaded, definitions: &Definitions) -> Option<Problems> {
    let about = |topic: &str, error: FieldError| (format!("topic {topic}: {}", error.text), error.help);
    let levels = loaded.model.signals.iter().enumerate().filter(|(_, signal)| signal.present_for.is_none());
    let signals = levels.filter_map(|(index, signal)| {
        let source = signal.source.field().filter(|source| !source.type_name.is_empty())?;
        let error = definitions.boolean(&source.type_name, &source.field).err()?;
        let field = error.path.is_some();
        let (text, help) = about(&source.topic, error);
        Some((if field { ModelPlace::SignalField(index) } else { ModelPlace::SignalType(index) }, text, help))
    });
    let topics = &loaded.model.watched.topics;
    // Where the type is left out, nothing is known before somebody publishes.
    let untyped = || Err(FieldsError(Vec::new()));
    // The names of numbers are judged with the condition that writes them.
    let nameless = |spec: &TopicSpec| {
        let field = |field: &FieldSpec| FieldSpec::new(field.path.clone(), field.kind);
        TopicSpec { fields: spec.fields.iter().map(field).collect(), ..spec.clone() }
    };
    let read = topics
        .iter()
        .map(|spec| if spec.type_name.is_empty() { untyped() } else { definitions.check(&nameless(spec)) });
    let read: Vec<_> = read.collect();
    let kinds: Vec<Option<Vec<_>>> =
        read.iter().map(|read| read.as_ref().ok().map(|reader| reader.kinds().collect())).collect();
    let ranges: Vec<Option<Vec<_>>> =
        read.iter().map(|read| read.as_ref().ok().map(|reader| reader.ranges().collect())).collect();
    let monitors = (0..).map(TopicId).zip(topics).zip(read).flat_map(|((id, spec), read)| {
        let errors = read.err().map(|all| all.0).unwrap_or_default();
        errors.into_iter().map(move |error| {
            let field = spec.fields.iter().position(|field| Some(&field.path) == error.path.as_ref());
            let (text, help) = about(&spec.topic, error);
            (field.map_or(ModelPlace::Type(id), |field| ModelPlace::Field(id, field as u32)), text, help)
        })
    });
    let kinds = Kinds { model: &loaded.model, definitions, kinds, ranges };
    loaded.problems(signals.chain(monitors).chain(kinds.misfits()))
}

/// The assumptions on topics whose type the configuration leaves out, one sentence each.
pub fn assumed(model: &Model) -> Vec<String> {
    let of_signals = model.signals.iter().filter_map(|signal| signal.source.field());
    let of_signals = of_signals.map(|source| (&*source.topic, &*source.type_name, vec![&*source.field]));
    let watched = model.watched.topics.iter().map(|spec| {
        let fields = spec.fields.iter().map(|field| &*field.path);
        (&*spec.topic, &*spec.type_name, fields.collect::<Vec<_>>())
    });
    let mut topics: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for (topic, _, fields) in of_signals.chain(watched).filter(|(_, type_name, _)| type_name.is_empty()) {
        topics.entry(topic).or_default().extend(fields.into_iter().filter(|field| !field.is_empty()));
    }
    let sentence = |(topic, fields): (&str, BTreeSet<&str>)| {
        let fields: Vec<String> = fields.into_iter().map(|field| format!("`{field}`")).collect();
        let open = match fields.is_empty() {
            true => String::new(),
            false => format!("; that it has {} cannot be checked before", fields.join(" and ")),
        };
        format!("{topic} is read as the type that its publisher says{open}")
    };
    topics.into_iter().map(sentence).collect()
}

/// The least and the greatest number.
type Range = (f64, f64);

/// The types of the fields of a model.
struct Kinds<'m> {
    model: &'m Model,
    definitions: &'m Definitions,
    /// By topic, then by field; none of a topic that cannot be read.
    kinds: Vec<Option<Vec<Option<ScalarKind>>>>,
    /// The least and greatest value of each field, if its type has them.
    ranges: Vec<Option<Vec<Option<Range>>>>,
}

impl Kinds<'_> {
    /// Monitors whose rule can never judge what their fields are.
    fn misfits(&self) -> Vec<(ModelPlace, String, String)> {
        let mut found = Vec::new();
        for (id, module) in (0..).map(ModuleId).zip(&self.model.modules) {
            let Some(monitor) = module.monitor.other() else { continue };
            let mut problems = match monitor {
                MonitorSpec::Value { source, rule: ValueRule::Unless { error, warning }, .. } => {
                    let wanted = [("error_unless", error), ("warning_unless", warning)];
                    wanted
                        .iter()
                        .filter_map(|(key, wanted)| self.never_equal(source, key, wanted.as_ref()?))
                        .collect()
                }
                MonitorSpec::Expression { .. } => self.unanswered(monitor),
                other => {
                    let (sources, _) = other.measured();
                    sources.into_iter().filter_map(|source| self.no_number(source)).collect()
                }
            };
            problems.extend(self.beyond(monitor));
            let name = &module.id;
            found.extend(
                problems
                    .into_iter()
                    .map(|(text, help)| (ModelPlace::Module(id), format!("module `{name}`: {text}"), help)),
            );
        }
        if let Some(WatchedField { topic, field }) = self.model.driving.speed.map(|speed| speed.value) {
            let source = ValueSource::Field { topic, field };
            let problem = self.kind(&source).filter(|kind| *kind != ScalarKind::Number).map(|kind| {
                let text = format!("`{}` is {}, and a speed is a number", self.path(&source), name(kind));
                (ModelPlace::Field(topic, field), text, "name a field that is a number, in m/s".to_owned())
            });
            found.extend(problem);
        }
        for (index, signal) in self.model.signals.iter().enumerate() {
            let Some(condition) = signal.source.condition() else { continue };
            let problems = self.unanswered(condition).into_iter().chain(self.beyond(condition));
            let named = |(text, help)| {
                (ModelPlace::SignalField(index), format!("signal `{}`: {text}", signal.name), help)
            };
            found.extend(problems.map(named));
        }
        found
    }

    /// Errors of conditions that have no answer for any value of their inputs.
    fn unanswered(&self, monitor: &MonitorSpec) -> Vec<(String, String)> {
        let MonitorSpec::Expression { inputs, warning, error, .. } = monitor else { return Vec::new() };
        let kinds: Vec<_> = inputs.iter().map(|(name, source)| (&**name, self.kind(source))).collect();
        let misfit = |condition: &Condition| {
            if let Some((text, help)) = self.misnamed_in(condition, inputs) {
                return Some((format!("`{}`: {text}", condition.text), help));
            }
            let (text, help) = expression::misfit(condition, &kinds)?;
            let help = self.label_in(condition, inputs).unwrap_or(help);
            Some((format!("`{}` can never be judged: {text}", condition.text), help))
        };
        [error, warning].into_iter().flatten().filter_map(misfit).collect()
    }

    /// Unknown of a KeyValue, of a pose, and where the topic cannot be read.
    fn kind(&self, source: &ValueSource) -> Option<ScalarKind> {
        let ValueSource::Field { topic, field } = source else { return None };
        self.kinds[topic.0 as usize].as_ref()?.get(*field as usize).copied().flatten()
    }

    /// Unknown where the topic cannot be read, and of what can be any number.
    fn range(&self, source: &ValueSource) -> Option<Range> {
        let ValueSource::Field { topic, field } = source else { return None };
        self.ranges[topic.0 as usize].as_ref()?.get(*field as usize).copied().flatten()
    }

    fn path<'a>(&'a self, source: &'a ValueSource) -> &'a str {
        match source {
            ValueSource::Field { topic, field } => {
                &self.model.watched.topics[topic.0 as usize].fields[*field as usize].path
            }
            ValueSource::Key { key, .. } => key,
        }
    }

    fn no_number(&self, source: &ValueSource) -> Option<(String, String)> {
        let kind = self.kind(source).filter(|kind| *kind != ScalarKind::Number)?;
        let text = format!("`{}` is {}, and a number is judged", self.path(source), name(kind));
        Some((
            text,
            format!("name a field that is a number, or watch it with {}", unless("error_unless", kind)),
        ))
    }

    fn never_equal(&self, source: &ValueSource, key: &str, wanted: &FieldValue) -> Option<(String, String)> {
        let is = self.kind(source)?;
        if let FieldValue::Text(label) = wanted
            && let Some((text, help)) = self.misnamed(source, label, |number| format!("`{key}: {number}`"))
        {
            return Some((format!("{text}, as `{key}` wants"), help));
        }
        let wants = match wanted {
            FieldValue::Number(_) => ScalarKind::Number,
            FieldValue::Bool(_) => ScalarKind::Bool,
            _ => ScalarKind::Text,
        };
        if is == wants {
            return None;
        }
        let text = format!(
            "`{}` is {} and never equals {}, as `{key}` wants",
            self.path(source),
            name(is),
            name(wants)
        );
        let help = match wanted {
            FieldValue::Text(label) if is == ScalarKind::Number => {
                self.number_of(source, label, |number| format!("`{key}: {number}`"))
            }
            _ => None,
        };
        Some((text, help.unwrap_or_else(|| format!("watch it with {}", unless(key, is)))))
    }
}

fn name(kind: ScalarKind) -> &'static str {
    match kind {
        ScalarKind::Number => "a number",
        ScalarKind::Bool => "a boolean",
        ScalarKind::Text => "a text",
    }
}

/// The rule that suits a field of this type; `key` is `error_unless` or `warning_unless`.
fn unless(key: &str, kind: ScalarKind) -> String {
    match kind {
        ScalarKind::Number => format!("limits, or `{key}: NUMBER`"),
        ScalarKind::Bool => format!("`{key}: true` or `{key}: false`"),
        ScalarKind::Text => format!("`{key}: WORD`, in quotes if it looks like a number"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;

    #[test]
    fn every_signal_and_topic_is_judged_at_its_place() {
        let text = "signals:
  good: { topic: /cloud, type: sensor_msgs/msg/PointCloud2, field: is_dense }
  dens: { topic: /cloud, type: sensor_msgs/msg/PointCloud2, field: is_dens }
  wide: { topic: /cloud, type: sensor_msgs/msg/PointCloud2, field: width }
groups:
- id: a
  modules:
  - { id: l, monitor: { latency: { topic: /x, type: my_msgs/msg/Unknown, error_above: 1s } } }
  - { id: v, monitor: { value: { topic: /odom, type: nav_msgs/msg/Odometry, field: twist.twist.linear.w, error_above: 1 } } }
  - { id: f, monitor: { frequency: { topic: /points, type: sensor_msgs/msg/PointClod2, error_below: 1 } } }
  - { id: o, monitor: { frequency: { topic: /own, type: my_msgs/msg/Own, error_below: 1 } } }
";
        let loaded = config::parse("c", text).unwrap_or_else(|problems| panic!("{problems}"));
        let lines =
            check(&loaded, &Definitions::default()).map(|problems| problems.lines()).unwrap_or_default();
        let places: Vec<&str> =
            lines.iter().map(|line| line.split(": ").next().unwrap_or_default()).collect();
        assert_eq!(places, ["c:3:68", "c:4:68", "c:8:53", "c:9:84", "c:10:60"], "{lines:#?}");
        assert!(lines[0].contains("did you mean `is_dense`?"), "{lines:#?}");
        assert!(lines[2].contains("my_msgs/msg/Unknown.msg"), "{lines:#?}");
        assert!(lines[4].contains("did you mean sensor_msgs/msg/PointCloud2?"), "{lines:#?}");
    }

    #[test]
    fn a_condition_of_a_signal_is_judged_by_what_its_fields_are() {
        let of = |when: &str| {
            let battery = "topic: /b, type: sensor_msgs/msg/BatteryState";
            let text = format!(
                "signals:\n  s: {{ inputs: {{ n: {{ {battery}, field: charge }}, b: {{ {battery}, field: present }} }}, when: {when} }}\ngroups: [{{ id: a, match: [{{ name: s }}] }}]\n"
            );
            let loaded = config::parse("c", &text).unwrap_or_else(|problems| panic!("{problems}"));
            check(&loaded, &Definitions::default()).map(|problems| problems.lines()).unwrap_or_default()
        };
        assert_eq!(of("n > 1 && b"), [""; 0]);
        let lines = of("b > 1");
        assert!(
            lines.len() == 1 && lines[0].contains("signal `s`: `b > 1` can never be judged"),
            "{lines:?}"
        );
    }

    #[test]
    fn a_speed_is_a_number() {
        let of = |field: &str| {
            let speed = format!("topic: /odom, type: nav_msgs/msg/Odometry, field: {field}");
            let text = format!(
                "motion: {{ speed: {{ {speed} }} }}\ngroups: [{{ id: a, match: [{{ name: s }}] }}]\n"
            );
            let loaded = config::parse("c", &text).unwrap_or_else(|problems| panic!("{problems}"));
            check(&loaded, &Definitions::default()).map(|problems| problems.lines()).unwrap_or_default()
        };
        assert_eq!(of("twist.twist.linear.x"), [""; 0]);
        let lines = of("header.frame_id");
        assert!(lines.len() == 1 && lines[0].contains("is a text, and a speed is a number"), "{lines:?}");
        let lines = of("twist.twist.linear.w");
        assert!(lines.len() == 1 && lines[0].starts_with("c:1:70: "), "{lines:?}");
    }

    #[test]
    fn rules_that_can_never_judge_their_fields_are_refused() {
        let cloud = |rule: &str| format!("value: {{ topic: /c, type: sensor_msgs/msg/PointCloud2, {rule} }}");
        let of = |field: &str| format!("{{ topic: /c, type: sensor_msgs/msg/PointCloud2, field: {field} }}");
        let two = |kind: &str, a: &str, b: &str, rule: &str| {
            let (first, second) = if kind == "sequence" { ("earlier", "later") } else { ("a", "b") };
            format!("{kind}: {{ {first}: {}, {second}: {}, {rule} }}", of(a), of(b))
        };
        let condition = |text: &str| {
            let inputs = format!("n: {}, b: {}, t: {}", of("width"), of("is_dense"), of("header.frame_id"));
            let key = "k: { status: s, key: k }";
            format!("expression: {{ inputs: {{ {inputs}, {key} }}, error: '{text}' }}")
        };
        let cases = [
            (cloud("field: width, error_above: 1"), None),
            (cloud("field: data.length, error_below: 1"), None),
            (cloud("field: header.stamp, error_below: 1"), None),
            (
                cloud("field: is_dense, error_above: 1"),
                Some("`is_dense` is a boolean, and a number is judged"),
            ),
            (cloud("field: header.frame_id, error_above: 1"), Some("is a text")),
            (cloud("field: is_dense, error_unless: true"), None),
            (
                cloud("field: is_dense, error_unless: 5"),
                Some("never equals a number, as `error_unless` wants"),
            ),
            (cloud("field: width, error_unless: true"), Some("never equals a boolean")),
            (
                cloud("field: width, warning_unless: \"5\""),
                Some("never equals a text, as `warning_unless` wants"),
            ),
            (cloud("field: header.frame_id, error_unless: lidar"), None),
            (cloud("field: header.frame_id, error_unless: 5"), Some("never equals a number")),
            (two("sequence", "header.stamp", "width", "error_below: 0"), None),
            (two("sequence", "header.stamp", "is_dense", "error_below: 0"), Some("`is_dense` is a boolean")),
            (
                two("agreement", "header.frame_id", "width", "error_above: 1"),
                Some("`header.frame_id` is a text"),
            ),
            ("value: { status: s, key: k, error_above: 1 }".to_owned(), None),
            (condition("n > 1 && b || t == \"x\""), None),
            (condition("n > 1 || k"), None),
            (condition("double(t) > 1"), None),
            (condition("n > \"a\""), Some("this is a text, not a number")),
            (condition("b > 3"), Some("can never be judged")),
            (condition("n"), Some("must be true or false")),
            (condition("n && b"), Some("this is a number, not a truth value")),
            (condition("k > 3 && t"), Some("this is a text, not a truth value")),
        ];
        for (monitor, expected) in cases {
            let text = format!("groups:\n- id: a\n  modules:\n  - {{ id: m, monitor: {{ {monitor} }} }}\n");
            let loaded = config::parse("c", &text).unwrap_or_else(|problems| panic!("{monitor}: {problems}"));
            let found = check(&loaded, &Definitions::default()).map(|problems| problems.lines());
            let fits = match (&found, expected) {
                (None, None) => true,
                (Some(lines), Some(words)) => {
                    lines.len() == 1 && lines[0].starts_with("c:4:11: ") && lines[0].contains(words)
                }
                _ => false,
            };
            assert!(fits, "{monitor}: {found:#?}");
        }
    }
}
