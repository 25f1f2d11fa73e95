//! Converts the sources of the vehicle's motion: its speed, its position, and the pose of its goal.

use super::topics::Topics;
use crate::decode::Spanned;
use crate::describe::words;
use crate::file::monitors::sources::Topic;
use crate::file::motion::{RawMotion, STANDING_MPS_MAX, TIMEOUT_MAX};
use telltale_engine::model::monitors::{FieldKind, MonitorSpec, ValueSource};
use telltale_engine::model::motion::{
    POSITION_TIMEOUT, PositionSource, SPEED_TIMEOUT, STANDING_BELOW_MPS, SpeedSource, WatchedField,
};
use telltale_engine::model::{GOAL_SIGNAL, SignalSource, SignalSpec};
use telltale_engine::time::Span;
use telltale_yaml::{Log, Problem};

/// The type of goals whose place is known.
const GOAL_TYPE: &str = "geometry_msgs/msg/PoseStamped";

pub(crate) fn speed(raw: Option<&RawMotion>, topics: &mut Topics, log: &mut Log) -> Option<SpeedSource> {
    let raw = raw?;
    if let Some(below) = raw.standing_below.filter(|it| !(it.value > 0.0 && it.value <= STANDING_MPS_MAX)) {
        let problem = Problem::at(below.span, format!("{} m/s is no limit of standing", below.value));
        log.push(
            problem.help(format!("write a speed above 0 and up to {STANDING_MPS_MAX}, for example `0.1`")),
        );
    }
    let speed = raw.speed.as_ref()?;
    let timeout = timeout(speed.timeout, "an older speed says nothing about the present motion", log);
    let data = || Spanned { value: "data".to_owned(), span: speed.topic.place() };
    let type_name = speed.topic.type_name.as_ref();
    let path = match (&speed.field, type_name) {
        (Some(path), _) => path.clone(),
        (None, Some(of)) if !of.value.starts_with("std_msgs/") => {
            let problem = Problem::at(of.span, format!("which field of a {}?", of.value));
            log.push(problem.help("add `field: PATH`"));
            return None;
        }
        (None, _) => data(),
    };
    let (topic, field) = topics.field(&speed.topic, &path, FieldKind::Scalar, log);
    Some(SpeedSource {
        value: WatchedField { topic, field },
        timeout: timeout.unwrap_or(SPEED_TIMEOUT),
        standing_below_mps: raw.standing_below.map_or(STANDING_BELOW_MPS, |below| below.value),
    })
}

pub(crate) fn position(
    raw: Option<&RawMotion>,
    topics: &mut Topics,
    log: &mut Log,
) -> Option<PositionSource> {
    let position = raw?.position.as_ref()?;
    let timeout = timeout(position.timeout, "an older position says nothing about the present place", log);
    let (topic, field) = topics.field(&position.topic, &position.pose, FieldKind::Pose, log);
    Some(PositionSource {
        value: WatchedField { topic, field },
        timeout: timeout.unwrap_or(POSITION_TIMEOUT),
    })
}

fn timeout(written: Option<Spanned<Span>>, wrong: &str, log: &mut Log) -> Option<Span> {
    if let Some(timeout) = written.filter(|it| it.value.is_zero() || it.value > TIMEOUT_MAX) {
        let help = format!("write a duration above 0 and up to {}", words::span(TIMEOUT_MAX));
        log.push(Problem::at(timeout.span, wrong).help(help));
    }
    written.map(|timeout| timeout.value)
}

/// The pose in the messages of the goal, if they are poses. The types of the signals are complete.
pub(crate) fn goal(signals: &[SignalSpec], topics: &mut Topics, log: &mut Log) -> Option<WatchedField> {
    let goal = signals.iter().find(|signal| &*signal.name == GOAL_SIGNAL)?;
    let mut named: Vec<String> = match &goal.source {
        SignalSource::Field(source) => vec![source.topic.to_string()],
        SignalSource::Condition(spec) => topics_of(spec, topics),
    };
    named.retain(|name| topics.type_of(name) == GOAL_TYPE);
    let name = named.into_iter().next()?;
    let span = topics.place(&name)?;
    let topic = Topic { name: Spanned { value: name, span }, type_name: None };
    let path = Spanned { value: "pose".to_owned(), span };
    let (topic, field) = topics.field(&topic, &path, FieldKind::Pose, log);
    Some(WatchedField { topic, field })
}

/// The topics of a condition.
fn topics_of(spec: &MonitorSpec, topics: &Topics) -> Vec<String> {
    let MonitorSpec::Expression { inputs, .. } = spec else { return Vec::new() };
    let field = |source: &ValueSource| match source {
        ValueSource::Field { topic, .. } => Some(topics.name_of(*topic).to_owned()),
        ValueSource::Key { .. } => None,
    };
    inputs.iter().filter_map(|(_, source)| field(source)).collect()
}
