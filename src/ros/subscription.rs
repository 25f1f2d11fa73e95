//! What is read: `/diagnostics`, and the topics of the model's signals and monitors, each once.

use std::sync::Arc;

use super::cdr::Endian;
use super::fields::{BooleanReader, Definitions, FieldError, FieldsError, Miss, Reader};
use super::messages::{self, DIAGNOSTIC_ARRAY};
use super::raw::RawBody;
use crate::engine::input::Input;
use crate::engine::model::{Limits, Model, SignalSpec};
use crate::engine::monitor::spec::{TopicSpec, WatchdogSpec};
use crate::engine::sample::{FieldValue, Sample};

pub const DIAGNOSTICS: &str = "/diagnostics";

#[derive(Debug, thiserror::Error)]
pub enum SubscriptionError {
    #[error(
        "signal {signal}: `{field}` of {type_name} cannot be read as true or false: {why}. Use `present_for` if each \
         message is an event"
    )]
    NoBool { signal: Box<str>, type_name: Box<str>, field: Box<str>, why: FieldError },
    #[error("topic {topic}: {type_name:?} is no type: write it as package/msg/Name")]
    NoType { topic: Box<str>, type_name: Box<str> },
    #[error("topic {topic} is used with two types: {first} and {second}")]
    TwoTypes { topic: Box<str>, first: Box<str>, second: Box<str> },
    #[error("topic {topic} cannot be read: {why}")]
    Fields { topic: Box<str>, why: FieldsError },
}

/// Everything that a model needs from outside.
#[derive(Debug)]
pub struct Plan {
    pub subscriptions: Vec<Arc<Subscription>>,
    pub watchdogs: Vec<Arc<WatchdogSpec>>,
}

/// One topic and what becomes of its messages.
#[derive(Debug, Clone)]
pub struct Subscription {
    /// As ROS names it: `/diagnostics`.
    pub topic: Box<str>,
    pub type_name: Box<str>,
    pub dds_topic: String,
    pub dds_type: String,
    diagnostics: bool,
    signals: Vec<Signal>,
    watch: Option<Watch>,
    limits: Limits,
}

#[derive(Debug, Clone)]
struct Signal {
    name: Box<str>,
    /// `None` for an event: every message means true, whatever is in it.
    level: Option<BooleanReader>,
}

/// What monitors watch.
#[derive(Debug, Clone)]
struct Watch {
    spec: Arc<TopicSpec>,
    reader: Reader,
}

/// When a message was published, and what that makes of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum When {
    Now,
    /// When we listened and did not know its publisher: it is taken, and neither counted nor timed.
    Late,
    /// Before our time, by a publisher that keeps it for whoever comes later.
    Kept,
    /// Before our time, for others: it says that somebody publishes, and nothing of now.
    Past,
}

/// A received message.
#[derive(Debug, Clone, Copy)]
pub struct Received<'a> {
    pub body: &'a RawBody,
    /// By this machine's wall clock, since 1970.
    pub wall_ns: i64,
    pub when: When,
}

impl Plan {
    /// `/diagnostics` comes first.
    ///
    /// # Errors
    /// A signal or a field that no message of its type can feed.
    pub fn of(model: &Model, definitions: &Definitions) -> Result<Plan, SubscriptionError> {
        let mut all = Vec::new();
        subscribe(&mut all, DIAGNOSTICS, DIAGNOSTIC_ARRAY, &model.limits)?.diagnostics = true;
        for spec in &model.signals {
            let level = level(spec, definitions)?;
            let source = &spec.source;
            subscribe(&mut all, &source.topic, &source.type_name, &model.limits)?
                .signals
                .push(Signal { name: spec.name.clone(), level });
        }
        for spec in &model.watched.topics {
            let subscription = subscribe(&mut all, &spec.topic, &spec.type_name, &model.limits)?;
            let reader = definitions
                .check(spec)
                .map_err(|why| SubscriptionError::Fields { topic: spec.topic.clone(), why })?;
            subscription.watch = Some(Watch { spec: spec.clone(), reader });
        }
        let subscriptions = all.into_iter().map(Arc::new).collect();
        Ok(Plan { subscriptions, watchdogs: model.watched.watchdogs.clone() })
    }
}

/// The subscription of a topic, made where there is none yet.
fn subscribe<'a>(
    all: &'a mut Vec<Subscription>,
    topic: &str,
    type_name: &str,
    limits: &Limits,
) -> Result<&'a mut Subscription, SubscriptionError> {
    let topic = format!("/{}", topic.trim_start_matches('/'));
    let at = match all.iter().position(|known| *known.topic == *topic) {
        Some(at) if *all[at].type_name != *type_name => {
            return Err(SubscriptionError::TwoTypes {
                topic: topic.into(),
                first: all[at].type_name.clone(),
                second: type_name.into(),
            });
        }
        Some(at) => at,
        None => {
            let dds_type = messages::dds_type_name(type_name).ok_or_else(|| SubscriptionError::NoType {
                topic: topic.as_str().into(),
                type_name: type_name.into(),
            })?;
            all.push(Subscription {
                dds_topic: format!("rt{topic}"),
                topic: topic.into(),
                type_name: type_name.into(),
                dds_type,
                diagnostics: false,
                signals: Vec::new(),
                watch: None,
                limits: limits.clone(),
            });
            all.len() - 1
        }
    };
    Ok(&mut all[at])
}

/// A field that is true or false is a level; where there is none, a message can be an event.
fn level(spec: &SignalSpec, definitions: &Definitions) -> Result<Option<BooleanReader>, SubscriptionError> {
    let source = &spec.source;
    match definitions.boolean(&source.type_name, &source.field) {
        Ok(reader) => Ok(Some(reader)),
        Err(_) if spec.present_for.is_some() => Ok(None),
        Err(why) => Err(SubscriptionError::NoBool {
            signal: spec.name.clone(),
            type_name: source.type_name.clone(),
            field: source.field.clone(),
            why,
        }),
    }
}

impl Subscription {
    /// Whether the last message from before our time counts. The level of a signal and a watched
    /// value do; an event does not, and neither does what is only counted. Where the age of messages
    /// is watched, an old one would be judged as late.
    pub fn wants_last_value(&self) -> bool {
        self.signals.iter().any(|signal| signal.level.is_some())
            || self.watch.as_ref().is_some_and(Watch::wants_last_value)
    }

    /// What monitors watch of this topic.
    pub fn watched(&self) -> Option<&Arc<TopicSpec>> {
        self.watch.as_ref().map(|watch| &watch.spec)
    }

    /// What a message of this topic means, and what was wrong with it.
    pub fn decode(&self, received: Received<'_>) -> (Vec<Input>, Option<Miss>) {
        let mut inputs = Vec::with_capacity(1);
        if received.when == When::Past {
            inputs.extend(self.watch.as_ref().map(|watch| Input::Sample(watch.past(received.wall_ns))));
            return (inputs, None);
        }
        let mut wrong = received.body.as_ref().err().cloned().map(Miss::Fault);
        let readable = received.body.as_ref().ok().map(|(body, endian)| (&**body, *endian));
        if let Some((body, endian)) = readable {
            let history = received.when == When::Kept;
            self.decode_readable(body, endian, history, &mut inputs, &mut wrong);
        }
        if let Some(watch) = &self.watch {
            let sample = match received.when {
                When::Kept if !watch.wants_last_value() => watch.past(received.wall_ns),
                _ => watch.sample(received, &mut wrong),
            };
            inputs.push(Input::Sample(sample));
        }
        (inputs, wrong)
    }

    fn decode_readable(
        &self,
        body: &[u8],
        endian: Endian,
        history: bool,
        inputs: &mut Vec<Input>,
        wrong: &mut Option<Miss>,
    ) {
        if self.diagnostics && !history {
            let (array, fault) = messages::diagnostic_array(body, endian, &self.limits);
            // An empty array that is whole is a message too; a fault before the first status is none.
            if !array.is_empty() || fault.is_none() {
                inputs.push(Input::Diagnostics(array));
            }
            *wrong = fault.map(Miss::Fault);
        }
        for signal in &self.signals {
            let value = match &signal.level {
                Some(reader) => reader.read(body, endian),
                None if history => continue,
                None => Ok(true),
            };
            match value {
                Ok(value) => inputs.push(Input::Signal { name: signal.name.clone(), value }),
                Err(Miss::Absent) => {}
                Err(why) => *wrong = Some(why),
            }
        }
    }
}

impl Watch {
    fn wants_last_value(&self) -> bool {
        !self.spec.fields.is_empty() && !self.spec.stamp
    }

    fn sample(&self, received: Received<'_>, wrong: &mut Option<Miss>) -> Sample {
        let reading = match received.body {
            Ok((body, endian)) => self.reader.read(body, *endian),
            Err(fault) => self.reader.unreadable(fault),
        };
        if let Some(fault) = reading.fault {
            *wrong = Some(Miss::Fault(fault));
        }
        Sample {
            source: self.spec.clone(),
            stamp_ns: reading.stamp_ns,
            received_wall_ns: received.wall_ns,
            late: received.when != When::Now,
            values: reading.values,
        }
    }

    /// Nothing but that a message came.
    fn past(&self, received_wall_ns: i64) -> Sample {
        let values = vec![FieldValue::Absent; self.spec.fields.len()].into();
        Sample { source: self.spec.clone(), stamp_ns: None, received_wall_ns, late: true, values }
    }
}

/// About what an input takes while it waits for the engine.
pub fn waiting_bytes(input: &Input, body_bytes: usize) -> usize {
    const SMALL: usize = 64;
    match input {
        Input::Diagnostics(_) => body_bytes,
        Input::Sample(sample) => {
            let text = |value: &FieldValue| match value {
                FieldValue::Text(text) | FieldValue::Unreadable(text) => text.len(),
                _ => 0,
            };
            sample.values.iter().map(|value| SMALL + text(value)).sum::<usize>() + SMALL
        }
        _ => SMALL,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::input::StatusArray;
    use crate::engine::model::{Driving, FieldSource, Parts, Policy, StageModel, Text};
    use crate::engine::monitor::spec::{FieldKind, FieldSpec, Watched};
    use crate::engine::time::Span;
    use crate::ros::cdr::{Fault, FaultKind};
    use crate::ros::messages::{BOOL, encode};

    fn signal(name: &str, topic: &str, type_name: &str, present_for: Option<Span>) -> SignalSpec {
        let source = FieldSource { topic: topic.into(), type_name: type_name.into(), field: "data".into() };
        SignalSpec { name: name.into(), source, timeout: None, present_for }
    }

    fn read(signals: Vec<SignalSpec>) -> Result<Vec<Arc<Subscription>>, String> {
        read_all(signals, Vec::new())
    }

    fn read_all(signals: Vec<SignalSpec>, topics: Vec<TopicSpec>) -> Result<Vec<Arc<Subscription>>, String> {
        let parts = Parts {
            vehicle_id: "v".into(),
            vehicle_name: Text::plain("v"),
            stages: StageModel::None,
            signals,
            groups: Vec::new(),
            modules: Vec::new(),
            watched: Watched { topics: topics.into_iter().map(Arc::new).collect(), watchdogs: Vec::new() },
            driving: Driving::default(),
            discovered: Policy::default(),
            limits: Limits::default(),
        };
        let model = Model::new(parts).expect("nothing depends on anything");
        let plan = Plan::of(&model, &Definitions::default());
        plan.map(|plan| plan.subscriptions).map_err(|error| error.to_string())
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
        assert_eq!(all.iter().map(|one| one.wants_last_value()).collect::<Vec<_>>(), [false, true, false]);
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
        let decode = |index: usize, body: &[u8]| {
            let body = Ok((body.to_vec(), Endian::Little));
            all[index].decode(Received { body: &body, wall_ns: 0, when: When::Now })
        };
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

    fn topic(topic: &str, type_name: &str, stamp: bool, paths: &[&str]) -> TopicSpec {
        let fields = paths.iter().map(|&path| FieldSpec { path: path.into(), kind: FieldKind::Scalar });
        TopicSpec { topic: topic.into(), type_name: type_name.into(), stamp, fields: fields.collect() }
    }

    #[test]
    fn a_signal_and_monitors_share_one_topic() {
        let mut ready = signal("dense", "/cloud", encode::POINT_CLOUD_2, None);
        ready.source.field = "is_dense".into();
        let topics = vec![
            topic("/cloud", encode::POINT_CLOUD_2, true, &["width", "nothing[0].x"]),
            topic("/number", encode::FLOAT64, false, &["data"]),
            topic("/counted", "my_msgs/msg/Unknown", false, &[]),
        ];
        let error = read_all(vec![ready.clone()], topics.clone()).unwrap_err();
        assert!(error.contains("/cloud") && error.contains("no field `nothing`"), "{error}");
        let mut topics = topics;
        topics[0].fields.truncate(1);
        let all = read_all(vec![ready], topics).unwrap();
        assert_eq!(all.len(), 4);
        assert_eq!(
            all.iter().map(|one| one.wants_last_value()).collect::<Vec<_>>(),
            [false, true, true, false]
        );

        let header = encode::Header { stamp: std::time::UNIX_EPOCH, frame_id: "" };
        let body = Ok((encode::point_cloud(header, 3), Endian::Little));
        let decode = |when| all[1].decode(Received { body: &body, wall_ns: 7, when });
        let signal = Input::Signal { name: "dense".into(), value: true };
        let sample = |stamp_ns, late, value| {
            let source = all[1].watched().unwrap().clone();
            Input::Sample(Sample { source, stamp_ns, received_wall_ns: 7, late, values: [value].into() })
        };
        let of_now = |late| sample(Some(0), late, FieldValue::Number(3.0));
        assert_eq!(decode(When::Now), (vec![signal.clone(), of_now(false)], None));
        assert_eq!(decode(When::Late), (vec![signal.clone(), of_now(true)], None));
        let past = sample(None, true, FieldValue::Absent);
        assert_eq!(decode(When::Kept), (vec![signal, past.clone()], None), "ages are judged there");
        assert_eq!(decode(When::Past), (vec![past], None));

        let unreadable: RawBody = Err(Fault { at: 0, what: FaultKind::Encoding([0, 7]) });
        let (inputs, wrong) = all[2].decode(Received { body: &unreadable, wall_ns: 7, when: When::Now });
        let Input::Sample(sample) = &inputs[0] else { panic!("{inputs:?}") };
        assert!(matches!(&sample.values[..], [FieldValue::Unreadable(_)]) && wrong.is_some());
        let (inputs, wrong) =
            all[3].decode(Received { body: &Ok((vec![], Endian::Big)), wall_ns: 7, when: When::Now });
        assert!(
            matches!(&inputs[..], [Input::Sample(sample)] if sample.values.is_empty()) && wrong.is_none()
        );
    }
}
