//! Whether the fields that a configuration names can be read: before anything starts, and before
//! another configuration is taken.

use std::fmt;
use std::path::PathBuf;

use crate::engine::model::Model;
use crate::ros::fields::{Definitions, FieldError};
use crate::ros::{self, SubscriptionError};

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

/// Something of a topic that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldProblem {
    /// As ROS names it: `/odometry`.
    pub topic: Box<str>,
    /// The field that it is about; `None` if it is the type or its stamp.
    pub path: Option<Box<str>>,
    pub text: String,
    /// What to do.
    pub help: String,
}

/// Everything that the signals and monitors of a model want of topics and cannot have.
pub fn check(model: &Model, definitions: &Definitions) -> Vec<FieldProblem> {
    let problem = |topic: &str, error: FieldError| FieldProblem {
        topic: topic.into(),
        path: error.path,
        text: error.text,
        help: error.help,
    };
    let levels = model.signals.iter().filter(|signal| signal.present_for.is_none());
    let signals = levels.filter_map(|signal| {
        let source = &signal.source;
        let error = definitions.boolean(&source.type_name, &source.field).err()?;
        Some(problem(&source.topic, error))
    });
    let monitors = model.watched.topics.iter().flat_map(|spec| {
        let errors = definitions.check(spec).err().map(|all| all.0).unwrap_or_default();
        errors.into_iter().map(|error| problem(&spec.topic, error))
    });
    let problems: Vec<_> = signals.chain(monitors).collect();
    match ros::check(model, definitions) {
        Err(error) if problems.is_empty() => vec![of_topics(&error)],
        _ => problems,
    }
}

/// What is wrong with topics beside their fields.
fn of_topics(error: &SubscriptionError) -> FieldProblem {
    let (topic, help) = match error {
        SubscriptionError::TwoTypes { topic, .. } => (topic, "give it the type that its publisher has"),
        SubscriptionError::NoType { topic, .. } | SubscriptionError::Fields { topic, .. } => {
            (topic, "write a type as nav_msgs/msg/Odometry")
        }
        SubscriptionError::NoBool { signal, .. } => (signal, "name a field of type bool"),
    };
    FieldProblem { topic: topic.clone(), path: None, text: error.to_string(), help: help.to_owned() }
}

/// For people, one line each.
pub fn list(problems: &[FieldProblem]) -> String {
    let lines: Vec<_> = problems.iter().map(ToString::to_string).collect();
    lines.join("\n")
}

impl fmt::Display for FieldProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "topic {}: {}\n  help: {}", self.topic, self.text, self.help)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;
    use crate::engine::model::FieldSource;

    #[test]
    fn every_signal_and_topic_is_judged() {
        let loaded = config::parse("c", "groups: [{ id: a }]").expect("it is one");
        let mut parts = (**loaded.model).clone();
        let source = |field: &str| FieldSource {
            topic: "/cloud".into(),
            type_name: "sensor_msgs/msg/PointCloud2".into(),
            field: field.into(),
        };
        let signal = |field: &str| crate::engine::model::SignalSpec {
            name: field.into(),
            source: source(field),
            timeout: None,
            present_for: None,
        };
        parts.signals = vec![signal("is_dense"), signal("is_dens"), signal("width")];
        let spec = crate::engine::monitor::spec::TopicSpec {
            topic: "/x".into(),
            type_name: "my_msgs/msg/Unknown".into(),
            stamp: true,
            fields: Vec::new(),
        };
        parts.watched.topics = vec![std::sync::Arc::new(spec)];
        let mut two_types = parts.clone();
        let model = Model::new(parts).expect("nothing depends on anything");
        let problems = check(&model, &Definitions::default());
        let paths: Vec<_> =
            problems.iter().map(|problem| (&*problem.topic, problem.path.as_deref())).collect();
        assert_eq!(paths, [("/cloud", Some("is_dens")), ("/cloud", Some("width")), ("/x", None)]);
        two_types.signals.truncate(1);
        two_types.signals[0].source.topic = "/diagnostics".into();
        two_types.watched.topics.clear();
        let model = Model::new(two_types).expect("nothing depends on anything");
        let of_type = check(&model, &Definitions::default());
        assert!(of_type.len() == 1 && of_type[0].text.contains("two types"), "{of_type:?}");
        let text = list(&problems);
        assert!(
            text.contains("did you mean `is_dense`?") && text.contains("my_msgs/msg/Unknown.msg"),
            "{text}"
        );
    }
}
