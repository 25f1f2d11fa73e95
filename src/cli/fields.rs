//! Whether the fields that a configuration names can be read: before anything starts, and before
//! another configuration is taken.

use std::path::PathBuf;

use crate::config::{Loaded, Place};
use crate::engine::monitor::spec::TopicId;
use crate::ros::fields::{Definitions, FieldError};
use crate::yaml::Problems;

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

/// Everything that the signals and monitors of a configuration want of topics and cannot have, each
/// with its place.
pub fn check(loaded: &Loaded, definitions: &Definitions) -> Option<Problems> {
    let about = |topic: &str, error: FieldError| (format!("topic {topic}: {}", error.text), error.help);
    let levels = loaded.model.signals.iter().enumerate().filter(|(_, signal)| signal.present_for.is_none());
    let signals = levels.filter_map(|(index, signal)| {
        let source = &signal.source;
        let error = definitions.boolean(&source.type_name, &source.field).err()?;
        let field = error.path.is_some();
        let (text, help) = about(&source.topic, error);
        Some((if field { Place::SignalField(index) } else { Place::SignalType(index) }, text, help))
    });
    let topics = (0..).map(TopicId).zip(&loaded.model.watched.topics);
    let monitors = topics.flat_map(|(id, spec)| {
        let errors = definitions.check(spec).err().map(|all| all.0).unwrap_or_default();
        errors.into_iter().map(move |error| {
            let field = spec.fields.iter().position(|field| Some(&field.path) == error.path.as_ref());
            let (text, help) = about(&spec.topic, error);
            (field.map_or(Place::Type(id), |field| Place::Field(id, field as u32)), text, help)
        })
    });
    loaded.problems(signals.chain(monitors))
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
";
        let loaded = config::parse("c", text).unwrap_or_else(|problems| panic!("{problems}"));
        let lines =
            check(&loaded, &Definitions::default()).map(|problems| problems.lines()).unwrap_or_default();
        let places: Vec<&str> =
            lines.iter().map(|line| line.split(": ").next().unwrap_or_default()).collect();
        assert_eq!(places, ["c:3:68", "c:4:68", "c:8:53", "c:9:84"], "{lines:#?}");
        assert!(lines[0].contains("did you mean `is_dense`?"), "{lines:#?}");
        assert!(lines[2].contains("my_msgs/msg/Unknown.msg"), "{lines:#?}");
    }
}
