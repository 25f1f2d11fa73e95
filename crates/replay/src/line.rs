//! The lines that a replay prints: each change of a node, and if wanted of the rest.

use std::fmt::Write as _;
use std::sync::Arc;
use std::time::SystemTime;

use humantime::format_rfc3339_millis;
use serde::Serialize;

use super::{Facts, Taken};
use telltale_engine::event::{Event, EventKind};
use telltale_engine::model::NodeId;
use telltale_engine::snapshot::{Reason, Snapshot};
use telltale_engine::time::Timestamp;
use telltale_engine::view::record::{Record, Recorded};
use telltale_record::transition::{Change, Transition};
use telltale_record::why::Why;

/// A node shows another state.
#[derive(Debug, Serialize)]
pub struct ShownLine<'a> {
    /// Seconds since the first instant of the recording that is shown.
    t_s: f64,
    #[serde(serialize_with = "wall")]
    at: SystemTime,
    node: &'a str,
    shown: &'static str,
    /// Its state as if nothing were masked.
    own: &'static str,
    reason: Option<Why<'a>>,
    /// The root causes at that instant.
    roots: Vec<&'a str>,
}

/// Another change. Its words are those of a recording's `/telltale/transitions`.
#[derive(Debug, Serialize)]
struct OtherLine<'a> {
    t_s: f64,
    #[serde(serialize_with = "wall")]
    at: SystemTime,
    #[serde(flatten)]
    change: Change<'a>,
}

fn wall<S: serde::Serializer>(at: &SystemTime, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_rfc3339_millis(*at))
}

/// One line as JSON, and as text for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Line {
    pub at: Timestamp,
    pub json: String,
    pub text: String,
}

/// The lines of what one step did. `all`: also stages, signals and alarms.
pub fn lines(taken: &Taken, facts: &Facts, all: bool) -> Vec<Line> {
    let line = |event: &Event| {
        let snapshot = taken.snapshot_of(event)?;
        match &event.what {
            EventKind::Shown { node, .. } => Some(shown(event, *node, snapshot, facts)),
            _ if all => other(event, snapshot, facts),
            _ => None,
        }
    };
    taken.events.iter().filter_map(line).collect()
}

/// A line for people between those of changes.
pub fn remark(at: Timestamp, words: &str, facts: &Facts) -> String {
    text(seconds(facts.from, at), facts.wall(at), words)
}

/// Seconds between two instants, also if the second one is earlier.
pub fn seconds(from: Timestamp, to: Timestamp) -> f64 {
    let ns = i128::from(to.as_nanos()) - i128::from(from.as_nanos());
    (ns as f64 / 1e3).round() / 1e6
}

fn shown(event: &Event, node: NodeId, snapshot: &Arc<Snapshot>, facts: &Facts) -> Line {
    let Event { at, what } = event;
    let EventKind::Shown { from, to, own, .. } = what else { unreachable!("the caller looked") };
    let reason = snapshot.shown(node).1.filter(|_| snapshot.shown(node).0 == *to);
    let t_s = seconds(facts.from, *at);
    let line = ShownLine {
        t_s,
        at: facts.wall(*at),
        node: snapshot.node_name(node),
        shown: to.as_str(),
        own: own.as_str(),
        reason: reason.map(|reason| Why::of(reason, snapshot, usize::MAX)),
        roots: snapshot.roots.iter().map(|root| &**snapshot.node_name(root.node)).collect(),
    };
    let mut words = format!("{:<32} {:>7} -> {:<7}", line.node, from.as_str(), to.as_str());
    match reason {
        Some(Reason::Masked { by }) => {
            let by = by.first().map_or("", |&cause| snapshot.node_name(cause));
            let _ = write!(words, "  own {}, masked by {by}", own.as_str());
        }
        Some(Reason::NotRelevant(_)) => {
            if let Some(Why::NotRelevant { because }) = &line.reason {
                let _ = write!(words, "  not relevant: {because}");
            }
        }
        None => {
            if let EventKind::Shown { said: Some(said), .. } = what {
                let _ = write!(words, "  {}", said.words());
            }
        }
    }
    Line { at: *at, json: json(&line), text: text(t_s, line.at, words.trim_end()) }
}

fn other(event: &Event, snapshot: &Arc<Snapshot>, facts: &Facts) -> Option<Line> {
    let record = Record::of(event.clone(), snapshot)?;
    let words = match &record.what {
        Recorded::Stage(stage) => format!("stage {}", stage.as_str()),
        Recorded::Signal { name, value } => match value {
            Some(value) => format!("signal {name} is {value}"),
            None => format!("signal {name} is not known"),
        },
        Recorded::AlarmRaised { id, node } => format!("alarm {id} of {node}"),
        Recorded::AlarmMoved { id, symptom, cause } => format!("alarm {id} moves from {symptom} to {cause}"),
        Recorded::AlarmAcknowledged { id, node } => format!("alarm {id} of {node} is acknowledged"),
        Recorded::AlarmCleared { id, node } => format!("alarm {id} of {node} is over"),
        Recorded::Left { node } => format!("{node} is removed: it was silent for too long"),
        Recorded::Lost(count) => format!("{count} changes are missing"),
        Recorded::Started { .. } | Recorded::Shown { .. } => return None,
    };
    let (t_s, at) = (seconds(facts.from, record.at), facts.wall(record.at));
    let change = Transition::of(&record, 0).change;
    Some(Line { at: record.at, json: json(&OtherLine { t_s, at, change }), text: text(t_s, at, &words) })
}

fn json(line: &impl Serialize) -> String {
    serde_json::to_string(line).unwrap_or_default()
}

fn text(t_s: f64, at: SystemTime, words: &str) -> String {
    let at = format_rfc3339_millis(at).to_string();
    let clock = at.get(11..23).unwrap_or_default();
    format!("{clock} {t_s:>+10.3} s  {words}")
}
