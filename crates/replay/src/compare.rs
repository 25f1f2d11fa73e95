//! The comparison of two configurations over one recording: where they part, and how much each of them shows.
//!
//! Both take the same inputs at the same times, so there is no tolerance: the smallest difference comes from the
//! configuration. A node that only one side has counts where it shows something.

use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::time::SystemTime;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::line::seconds;
use super::trace::{Changes, Counts, Shown, Totals, Trace};
use super::{Facts, Recording, ReplayError, Run};
use telltale_config::{Loaded, difference};
use telltale_engine::model::Stage;
use telltale_engine::model::wording::Urgency;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::fields::Definitions;

/// Nodes whose differences are kept, those that part first.
const NODES_MAX: usize = 100;
/// Sentences on what could not be used.
const NOTES_MAX: usize = 20;

/// The changes of the second configuration.
#[derive(Debug)]
pub struct Comparison {
    pub facts: Facts,
    /// The last instant.
    pub to: Timestamp,
    pub first: Option<Parting>,
    /// Nodes that differ, the first one first.
    pub nodes: Vec<NodeDifference>,
    pub more_nodes: usize,
    pub recorded: Totals,
    pub new: Totals,
    counts: [Counts; 2],
    /// The nodes of alarms that one of the two alone raises.
    pub alarms_gone: Vec<Arc<str>>,
    pub alarms_new: Vec<Arc<str>>,
    /// Nodes that only one of the two has.
    pub only_recorded: Vec<Arc<str>>,
    pub only_new: Vec<Arc<str>>,
    /// The unusable parts, in sentences.
    pub notes: Vec<String>,
}

/// The first instant at which both differ, and in what.
#[derive(Debug, Clone, PartialEq)]
pub struct Parting {
    pub at: Timestamp,
    pub of: PartingOf,
}

#[derive(Debug, Clone, PartialEq)]
pub enum PartingOf {
    /// The node shows this in one and that in the other; `None` where it is not there.
    Node {
        node: Arc<str>,
        recorded: Option<Shown>,
        new: Option<Shown>,
    },
    Stage {
        recorded: &'static str,
        new: &'static str,
    },
    Requests {
        recorded: Vec<String>,
        new: Vec<String>,
    },
    /// The urgency of the instruction, by its word in a configuration.
    Instruction {
        recorded: Option<&'static str>,
        new: Option<&'static str>,
    },
    Alarms {
        recorded: Vec<Arc<str>>,
        new: Vec<Arc<str>>,
    },
}

/// A node that differs, with what it showed in both.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeDifference {
    pub node: Arc<str>,
    pub first: Timestamp,
    /// How long it differs, all in all.
    pub long: Span,
    /// It shows another state, not only another cause or another state behind it.
    pub is_seen: bool,
    pub recorded: Changes<Option<Shown>>,
    pub new: Changes<Option<Shown>>,
}

/// A configuration that recordings are to be judged by, for those who know nothing of configurations.
#[derive(Debug)]
pub struct Candidate {
    pub loaded: Loaded,
    pub definitions: Definitions,
}

/// The faults of a configuration: lines and columns from 1.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mistake {
    pub file: String,
    pub line: Option<usize>,
    pub column: Option<usize>,
    pub message: String,
    pub help: String,
}

impl Mistake {
    /// Its file with the line and the column.
    pub fn place(&self) -> String {
        match (self.line, self.column) {
            (Some(line), Some(column)) => format!("{}:{line}:{column}", self.file),
            _ => self.file.clone(),
        }
    }
}

impl Candidate {
    /// Its differences in meaning from the recorded configuration, in sentences.
    ///
    /// # Errors
    /// The recording has no configuration, or this version cannot read it.
    pub fn differences(&self, facts: &Facts) -> Result<Vec<String>, ReplayError> {
        let recorded = facts.recorded()?;
        let found = difference(&recorded, &facts.as_counted(self.loaded.clone()));
        Ok(found.iter().map(ToString::to_string).collect())
    }

    /// Runs a recording as it was judged and by this configuration. `go_on` is asked before each step.
    ///
    /// # Errors
    /// The recording cannot be used, or it was stopped.
    pub fn compare(&self, path: &Path, go_on: &dyn Fn() -> bool) -> Result<Comparison, ReplayError> {
        let mut recorded = Run::recorded(Recording::open(path)?)?;
        let mut new = judged(path, &self.loaded, &self.definitions, None)?;
        compare(&mut recorded, &mut new, go_on)
    }
}

/// A recording that is judged by a configuration, with the patience that counted when it was recorded.
///
/// # Errors
/// The recording or the configuration cannot be used.
pub fn judged(
    path: &Path,
    loaded: &Loaded,
    definitions: &Definitions,
    stage: Option<Stage>,
) -> Result<Run, ReplayError> {
    let recording = Recording::open(path)?;
    let definitions = recording.define(definitions.clone());
    let loaded = recording.facts().as_counted(loaded.clone());
    Run::judged_by(recording, loaded.model, &definitions, stage)
}

/// Compares two runs of one recording.
///
/// # Errors
/// One of them cannot be run, or it was stopped.
pub fn compare(
    recorded: &mut Run,
    new: &mut Run,
    go_on: &dyn Fn() -> bool,
) -> Result<Comparison, ReplayError> {
    let facts = recorded.facts().clone();
    // Only one side has recorded states: behind a gap they would look like differences of the configurations.
    recorded.leave_recorded_states();
    let (mut left, mut right) = (Trace::of(recorded, go_on)?, Trace::of(new, go_on)?);
    let cut = [left.cut, right.cut].into_iter().flatten().min();
    let to = cut.unwrap_or(left.to.max(right.to));
    let mut notes = notes(recorded, new);
    if let Some(cut) = cut {
        notes.push(format!(
            "only the first {:.0} s are compared: there are too many changes",
            seconds(facts.from, cut)
        ));
    }
    let symptom = left.symptom.into_iter().chain(right.symptom).min().unwrap_or(facts.from);
    let counts = [&mut left, &mut right].map(Trace::take_counts);
    let totals = |side: &Trace, counts: &Counts| Totals {
        to_root_s: side.root.map(|root| seconds(symptom, root.max(symptom))),
        ..counts.since(facts.from)
    };
    let [recorded, new] = [totals(&left, &counts[0]), totals(&right, &counts[1])];
    let first_of_whole = whole_parting(&left, &right, to);
    let (only_recorded, only_new) = (only(&left, &right), only(&right, &left));
    let (alarms_gone, alarms_new) = (left.alarms_beyond(&right), right.alarms_beyond(&left));
    let mut nodes = node_differences(left, right, to);
    // Of several at one instant, another state goes before another cause, the worst first, and modules before
    // their groups.
    nodes.sort_by_cached_key(|it| {
        let (was, is) = (at(&it.recorded, it.first), at(&it.new, it.first));
        let is_state = was.map(|it| it.state) != is.map(|it| it.state);
        let worst = was.into_iter().chain(is).map(|it| it.state).max();
        let is_cause = was.map(|it| &it.cause) != is.map(|it| &it.cause);
        let depth = it.node.matches('/').count();
        (it.first, Reverse(is_state), Reverse(worst), Reverse(is_cause), Reverse(depth), it.node.clone())
    });
    let first_node = nodes.first().map(|it| {
        let (recorded, new) = (at(&it.recorded, it.first).cloned(), at(&it.new, it.first).cloned());
        Parting { at: it.first, of: PartingOf::Node { node: it.node.clone(), recorded, new } }
    });
    let first = [first_node, first_of_whole].into_iter().flatten().min_by_key(|parting| parting.at);
    let more_nodes = nodes.len().saturating_sub(NODES_MAX);
    nodes.truncate(NODES_MAX);
    Ok(Comparison {
        facts,
        to,
        first,
        nodes,
        more_nodes,
        recorded,
        new,
        counts,
        alarms_gone,
        alarms_new,
        only_recorded,
        only_new,
        notes,
    })
}

fn notes(recorded: &Run, new: &Run) -> Vec<String> {
    let mut all = Vec::new();
    let lost = recorded.notes().lost.max(new.notes().lost) + recorded.notes().unreadable;
    if lost > 0 {
        all.push(format!(
            "{lost} inputs are missing in the recording: what differs behind them may come from that"
        ));
    }
    let damages = new.gaps().list().iter().filter(|gap| gap.is_damage);
    all.extend(damages.map(|gap| gap.sentence(new.facts())));
    for run in [recorded, new] {
        let (omissions, more) = run.omissions();
        all.extend(run.notes().said.iter().cloned().chain(omissions));
        all.extend((more > 0).then(|| format!("{more} more parts of the file cannot be used")));
    }
    all.extend(new.unheard_anew());
    let mut seen = BTreeSet::new();
    all.retain(|note| seen.insert(note.clone()));
    all.truncate(NOTES_MAX);
    all
}

/// Nodes of one side that the other never has.
fn only(of: &Trace, other: &Trace) -> Vec<Arc<str>> {
    of.nodes.keys().filter(|name| !other.nodes.contains_key(*name)).cloned().collect()
}

fn node_differences(mut left: Trace, mut right: Trace, to: Timestamp) -> Vec<NodeDifference> {
    let names: BTreeSet<Arc<str>> = left.nodes.keys().chain(right.nodes.keys()).cloned().collect();
    let mut found = Vec::new();
    for node in names {
        let (recorded, new) =
            (left.nodes.remove(&node).unwrap_or_default(), right.nodes.remove(&node).unwrap_or_default());
        let is_same =
            |was: Option<&Option<Shown>>, is: Option<&Option<Shown>>| same(was, is, |it| it.clone());
        let looks_same =
            |was: Option<&Option<Shown>>, is: Option<&Option<Shown>>| same(was, is, |it| it.state);
        if let (Some(first), long) = parting(&recorded, &new, to, is_same) {
            let is_seen = parting(&recorded, &new, to, looks_same).0.is_some();
            found.push(NodeDifference { node, first, long, is_seen, recorded, new });
        }
    }
    found
}

/// Whether both are alike in something. A node that is not there looks as a quiet one.
fn same<T: PartialEq>(
    was: Option<&Option<Shown>>,
    is: Option<&Option<Shown>>,
    of: impl Fn(&Shown) -> T,
) -> bool {
    match (was.and_then(Option::as_ref), is.and_then(Option::as_ref)) {
        (Some(was), Some(is)) => of(was) == of(is),
        (Some(alone), None) | (None, Some(alone)) => alone.is_quiet(),
        (None, None) => true,
    }
}

fn whole_parting(left: &Trace, right: &Trace, to: Timestamp) -> Option<Parting> {
    let at = parting(&left.whole, &right.whole, to, |was, is| was == is).0?;
    let (was, is) = (held(&left.whole, at).cloned(), held(&right.whole, at).cloned());
    let (was, is) = (was.unwrap_or_default(), is.unwrap_or_default());
    let of = if was.stage != is.stage {
        PartingOf::Stage { recorded: was.stage, new: is.stage }
    } else if was.requests != is.requests {
        PartingOf::Requests { recorded: was.requests, new: is.requests }
    } else if was.asked != is.asked {
        let [recorded, new] = [was.asked, is.asked].map(|it| it.map(Urgency::as_str));
        PartingOf::Instruction { recorded, new }
    } else {
        PartingOf::Alarms { recorded: was.alarms, new: is.alarms }
    };
    Some(Parting { at, of })
}

/// The state at an instant.
fn held<T>(changes: &Changes<T>, at: Timestamp) -> Option<&T> {
    changes.iter().rev().find(|(from, _)| *from <= at).map(|(_, value)| value)
}

fn at(changes: &Changes<Option<Shown>>, at: Timestamp) -> Option<&Shown> {
    held(changes, at).and_then(Option::as_ref)
}

/// The first instant before `to` at which two histories differ, and how long they do.
fn parting<T>(
    left: &Changes<T>,
    right: &Changes<T>,
    to: Timestamp,
    is_same: impl Fn(Option<&T>, Option<&T>) -> bool,
) -> (Option<Timestamp>, Span) {
    let (mut first, mut long) = (None, 0);
    let (mut was, mut is) = (left.iter().peekable(), right.iter().peekable());
    let (mut left, mut right) = (None, None);
    loop {
        let next = [was.peek(), is.peek()].into_iter().flatten().map(|(at, _)| *at).min();
        let Some(now) = next.filter(|now| *now <= to) else { break };
        left = was.next_if(|(at, _)| *at == now).map(|(_, value)| value).or(left);
        right = is.next_if(|(at, _)| *at == now).map(|(_, value)| value).or(right);
        if !is_same(left, right) {
            first = first.or(Some(now));
            let until = [was.peek(), is.peek()].into_iter().flatten().map(|(at, _)| *at).min();
            long += until.unwrap_or(to).min(to).since(now).as_nanos();
        }
    }
    (first, Span::from_nanos(long))
}

impl Comparison {
    /// Whether anything that was shown or asked for differs.
    pub fn differs(&self) -> bool {
        self.first.is_some()
    }

    /// How much both sides show without what an earlier recording has too, which ends at `covered`.
    pub fn alone(&self, covered: Option<SystemTime>) -> [Totals; 2] {
        let since = covered.map_or(self.facts.from, |it| self.facts.at_wall(it).max(self.facts.from));
        let [recorded, new] = &self.counts;
        [
            Totals { to_root_s: self.recorded.to_root_s, ..recorded.since(since) },
            Totals { to_root_s: self.new.to_root_s, ..new.since(since) },
        ]
    }

    /// Everything but what the nodes showed, for programs.
    pub fn json(&self) -> Value {
        let first = self.first.as_ref().map(|Parting { at, of }| {
            let mut value = of.json();
            value["t_s"] = json!(seconds(self.facts.from, *at));
            value["at"] = json!(self.wall(*at));
            value
        });
        let node = |it: &NodeDifference| {
            json!({
                "node": it.node, "is_seen": it.is_seen, "t_s": seconds(self.facts.from, it.first),
                "differs_s": seconds(Timestamp::ZERO, Timestamp::ZERO + it.long),
            })
        };
        json!({
            "incident": self.facts.incident, "differs": self.differs(), "first": first,
            "nodes": self.nodes.iter().map(node).collect::<Vec<_>>(), "more_nodes": self.more_nodes,
            "recorded": self.recorded, "new": self.new,
            "alarms_gone": self.alarms_gone, "alarms_new": self.alarms_new,
            "only_recorded": self.only_recorded, "only_new": self.only_new, "notes": self.notes,
        })
    }

    /// From when to when it was recorded, in wall time.
    pub fn period(&self) -> (SystemTime, SystemTime) {
        (self.facts.wall(self.facts.from), self.facts.wall(self.to))
    }

    /// The wall time of an instant, in UTC.
    fn wall(&self, at: Timestamp) -> String {
        humantime::format_rfc3339_millis(self.facts.wall(at)).to_string()
    }
}

impl PartingOf {
    fn json(&self) -> Value {
        let node = |shown: &Option<Shown>| {
            let Some(Shown { state, own, cause }) = shown else { return Value::Null };
            json!({ "shown": state.as_str(), "own": own.as_str(), "masked_by": cause })
        };
        match self {
            PartingOf::Node { node: name, recorded, new } => {
                json!({ "of": "node", "node": name, "recorded": node(recorded), "new": node(new) })
            }
            PartingOf::Stage { recorded, new } => json!({ "of": "stage", "recorded": recorded, "new": new }),
            PartingOf::Requests { recorded, new } => {
                json!({ "of": "countermeasures", "recorded": recorded, "new": new })
            }
            PartingOf::Instruction { recorded, new } => {
                json!({ "of": "instruction", "recorded": recorded, "new": new })
            }
            PartingOf::Alarms { recorded, new } => {
                json!({ "of": "alarms", "recorded": recorded, "new": new })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_engine::state::State;

    /// Letters with the seconds from which they hold.
    fn changes(text: &str) -> Changes<char> {
        let pair = |pair: &str| {
            let value = pair.chars().next().expect("a letter");
            (Timestamp::from_millis(1000 * pair[1..].parse::<u64>().expect("seconds")), value)
        };
        text.split_whitespace().map(pair).collect()
    }

    #[test]
    fn two_histories_part_at_the_first_instant_at_which_they_differ() {
        for (left, right, first_s, long_s) in [
            ("a0 b3", "a0 b3", None, 0),
            ("a0 b3", "a0 b4", Some(3), 1),
            ("a0", "a0 b2 a3 c7", Some(2), 4),
            ("a0 b2", "b0 a2", Some(0), 10),
            ("", "a4", Some(4), 6),
            // Behind the end nothing is compared.
            ("a0 b11", "a0", None, 0),
        ] {
            let (left, right) = (changes(left), changes(right));
            let (first, long) = parting(&left, &right, Timestamp::from_millis(10_000), |was, is| was == is);
            assert_eq!(first, first_s.map(|s| Timestamp::from_millis(1000 * s)), "{left:?} {right:?}");
            assert_eq!(long, Span::from_secs(long_s), "{left:?} {right:?}");
        }
    }

    #[test]
    fn a_node_that_is_not_there_looks_as_one_that_is_quiet() {
        let shown =
            |state, cause: Option<&str>| Some(Shown { state, own: state, cause: cause.map(Arc::from) });
        for (alone, is_same) in [
            (shown(State::Ok, None), true),
            (shown(State::Ignore, None), true),
            (shown(State::Ignore, Some("a/b")), false),
            (shown(State::Unknown, None), false),
            (None, true),
        ] {
            for (was, is) in [(Some(&alone), None), (Some(&None), Some(&alone))] {
                assert_eq!(same(was, is, Shown::clone), is_same, "{alone:?}");
            }
        }
        assert!(!same(Some(&shown(State::Ok, None)), Some(&shown(State::Ignore, None)), Shown::clone));
    }
}
