//! What is read: `/diagnostics` and the topics of the model's signals.

use super::cdr::{Endian, Fault};
use super::messages::{self, BOOL, DIAGNOSTIC_ARRAY};
use crate::engine::input::Input;
use crate::engine::model::{Limits, Model, SignalSpec};

pub const DIAGNOSTICS: &str = "/diagnostics";

#[derive(Debug, thiserror::Error)]
pub enum SubscriptionError {
    #[error(
        "signal {signal}: field `{field}` of {type_name} cannot be read as true or false: use std_msgs/msg/Bool with \
         `data`, or `present_for` if each message is an event"
    )]
    NoBool { signal: Box<str>, type_name: Box<str>, field: Box<str> },
    #[error("signal {signal}: {type_name:?} is no type: write it as package/msg/Name")]
    NoType { signal: Box<str>, type_name: Box<str> },
    #[error("topic {topic} is used with two types: {first} and {second}")]
    TwoTypes { topic: Box<str>, first: Box<str>, second: Box<str> },
}

/// One topic and what becomes of its messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subscription {
    /// As ROS names it: `/diagnostics`.
    pub topic: Box<str>,
    pub type_name: Box<str>,
    pub dds_topic: String,
    pub dds_type: String,
    diagnostics: bool,
    signals: Vec<Signal>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
struct Signal {
    name: Box<str>,
    /// Every message means true, whatever is in it.
    event: bool,
}

/// One entry a topic, `/diagnostics` first.
///
/// # Errors
/// A signal that no message of its type can feed.
pub fn subscriptions(model: &Model) -> Result<Vec<Subscription>, SubscriptionError> {
    let mut all =
        vec![Subscription::new(DIAGNOSTICS, DIAGNOSTIC_ARRAY, dds_type(DIAGNOSTICS, DIAGNOSTIC_ARRAY)?)];
    all[0].diagnostics = true;
    for spec in &model.signals {
        let signal = readable(spec)?;
        let topic = format!("/{}", spec.source.topic.trim_start_matches('/'));
        let type_name = &*spec.source.type_name;
        if let Some(known) = all.iter_mut().find(|known| *known.topic == *topic) {
            if *known.type_name != *type_name {
                return Err(SubscriptionError::TwoTypes {
                    topic: topic.into(),
                    first: known.type_name.clone(),
                    second: type_name.into(),
                });
            }
            known.signals.push(signal);
        } else {
            let mut new = Subscription::new(&topic, type_name, dds_type(&spec.name, type_name)?);
            new.signals.push(signal);
            all.push(new);
        }
    }
    Ok(all)
}

fn readable(spec: &SignalSpec) -> Result<Signal, SubscriptionError> {
    let source = &spec.source;
    let is_bool = *source.type_name == *BOOL && *source.field == *"data";
    if !is_bool && spec.present_for.is_none() {
        return Err(SubscriptionError::NoBool {
            signal: spec.name.clone(),
            type_name: source.type_name.clone(),
            field: source.field.clone(),
        });
    }
    Ok(Signal { name: spec.name.clone(), event: !is_bool })
}

fn dds_type(signal: &str, type_name: &str) -> Result<String, SubscriptionError> {
    messages::dds_type_name(type_name)
        .ok_or_else(|| SubscriptionError::NoType { signal: signal.into(), type_name: type_name.into() })
}

impl Subscription {
    fn new(topic: &str, type_name: &str, dds_type: String) -> Subscription {
        Subscription {
            topic: topic.into(),
            type_name: type_name.into(),
            dds_topic: format!("rt{topic}"),
            dds_type,
            diagnostics: false,
            signals: Vec::new(),
        }
    }

    /// Whether the last message from before our time counts: a level does, an event does not.
    pub fn wants_last_value(&self) -> bool {
        self.signals.iter().any(|signal| !signal.event)
    }

    /// What a message of this topic means, and what was wrong with it.
    pub fn decode(&self, body: &[u8], endian: Endian, limits: &Limits) -> (Vec<Input>, Option<Fault>) {
        let mut inputs = Vec::with_capacity(1);
        let mut fault = None;
        if self.diagnostics {
            let (array, wrong) = messages::diagnostic_array(body, endian, limits);
            // An empty array that is whole is a message too; a fault before the first status is none.
            if !array.is_empty() || wrong.is_none() {
                inputs.push(Input::Diagnostics(array));
            }
            fault = wrong;
        }
        for signal in &self.signals {
            let value = if signal.event { Ok(true) } else { messages::boolean(body, endian) };
            match value {
                Ok(value) => inputs.push(Input::Signal { name: signal.name.clone(), value }),
                Err(wrong) => fault = Some(wrong),
            }
        }
        (inputs, fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::input::StatusArray;
    use crate::engine::model::{Driving, FieldSource, Parts, Policy, StageModel, Text};
    use crate::engine::monitor::spec::Watched;
    use crate::engine::time::Span;

    fn signal(name: &str, topic: &str, type_name: &str, present_for: Option<Span>) -> SignalSpec {
        let source = FieldSource { topic: topic.into(), type_name: type_name.into(), field: "data".into() };
        SignalSpec { name: name.into(), source, timeout: None, present_for }
    }

    fn read(signals: Vec<SignalSpec>) -> Result<Vec<Subscription>, String> {
        let parts = Parts {
            vehicle_id: "v".into(),
            vehicle_name: Text::plain("v"),
            stages: StageModel::None,
            signals,
            groups: Vec::new(),
            modules: Vec::new(),
            watched: Watched::default(),
            driving: Driving::default(),
            discovered: Policy::default(),
            limits: Limits::default(),
        };
        let model = Model::new(parts).expect("nothing depends on anything");
        subscriptions(&model).map_err(|error| error.to_string())
    }

    #[test]
    fn topics_are_read_once_with_their_wire_names() {
        let all = read(vec![
            signal("active", "/mission/active", BOOL, None),
            signal("moving", "mission/active", BOOL, None),
            signal("goal", "/goal_pose", "geometry_msgs/msg/PoseStamped", Some(Span::from_secs(1))),
        ])
        .unwrap();
        let wire: Vec<_> = all.iter().map(|one| (&*one.dds_topic, &*one.dds_type)).collect();
        assert_eq!(
            wire,
            [
                ("rt/diagnostics", "diagnostic_msgs::msg::dds_::DiagnosticArray_"),
                ("rt/mission/active", "std_msgs::msg::dds_::Bool_"),
                ("rt/goal_pose", "geometry_msgs::msg::dds_::PoseStamped_"),
            ]
        );
        assert_eq!(all.iter().map(Subscription::wants_last_value).collect::<Vec<_>>(), [false, true, false]);
    }

    #[test]
    fn messages_become_inputs() {
        let all = read(vec![
            signal("active", "/a", BOOL, None),
            signal("moving", "/a", BOOL, None),
            signal("goal", "/g", "geometry_msgs/msg/PoseStamped", Some(Span::from_secs(1))),
        ])
        .unwrap();
        let signal = |name: &str, value| Input::Signal { name: name.into(), value };
        let decode = |index: usize, body: &[u8]| all[index].decode(body, Endian::Little, &Limits::default());
        assert_eq!(decode(1, &[1, 0, 0, 0]), (vec![signal("active", true), signal("moving", true)], None));
        assert_eq!(decode(1, &[0]), (vec![signal("active", false), signal("moving", false)], None));
        assert_eq!(decode(2, &[]), (vec![signal("goal", true)], None));
        let (inputs, fault) = decode(1, &[]);
        assert!(inputs.is_empty() && fault.is_some());
        let (inputs, fault) = decode(0, &[1, 2]);
        assert!(inputs.is_empty() && fault.is_some());
        let empty = messages::encode_diagnostic_arrays(&StatusArray::default(), std::time::UNIX_EPOCH, 100);
        assert_eq!(decode(0, &empty[0]), (vec![Input::Diagnostics(StatusArray::default())], None));
    }

    #[test]
    fn what_cannot_be_read_is_refused() {
        let pose = "geometry_msgs/msg/PoseStamped";
        let error = read(vec![signal("goal", "/g", pose, None)]).unwrap_err();
        assert!(error.contains("goal") && error.contains(pose) && error.contains("present_for"), "{error}");
        let error = read(vec![signal("goal", "/g", "PoseStamped", Some(Span::from_secs(1)))]).unwrap_err();
        assert!(error.contains("package/msg/Name"), "{error}");
        let error = read(vec![signal("a", "/diagnostics", BOOL, None)]).unwrap_err();
        assert!(error.contains("two types"), "{error}");
    }
}
