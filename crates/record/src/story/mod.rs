//! The story of an incident by the file of its recording, without a replay: its events with their times, the states of
//! the nodes concerned, and how much of each topic is there.

mod moment;
mod series;
mod strips;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use schemars::JsonSchema;
use serde::Serialize;

use super::file::{Entry, FileError, JOURNAL, Reader, TRANSITIONS};
use super::journal::{Line, Took};
use super::summary::{Summary, TriggerLine, kind};
use super::transition::{Change, Transition};
pub use moment::{Happened, Moment};
pub use series::{Limit, Series};
pub use strips::{NodeStrip, Period};
use strips::{signals, stages, strips};
use telltale_engine::input::{AlarmRef, Input, OperatorAction};

/// Entries that are read of one file; further ones are left out, which is said.
pub(super) const ENTRIES_MAX: u64 = 2_000_000;
/// Bytes of messages that are read of one file.
pub(super) const BYTES_MAX: u64 = 1 << 30;
/// Changes that are kept while a file is read.
const CHANGES_MAX: usize = 50_000;
const TOPICS_MAX: usize = 1024;
const MOMENTS_MAX: usize = 400;
/// Nodes that one moment names.
const NAMED_MAX: usize = 12;

/// Everything that a file tells. Times are milliseconds since 1970.
#[derive(Debug, Clone, Default, PartialEq, Serialize, JsonSchema)]
pub struct Story {
    /// The first and the last instant that is shown.
    pub from_ms: i64,
    pub to_ms: i64,
    /// Oldest first; a fault stands where it began.
    pub moments: Vec<Moment>,
    pub more_moments: u64,
    pub strips: Vec<NodeStrip>,
    /// Periods that the strips lack at their ends.
    pub more_periods: u64,
    pub stages: Vec<Period>,
    /// Signals that changed.
    pub signals: Vec<NodeStrip>,
    pub topics: Vec<ToldTopic>,
    /// Numbers over time, which only a replay finds.
    pub series: Vec<Series>,
    /// A replay still looks for them.
    pub series_pending: bool,
    /// Inputs that the recorder did not keep.
    pub lost: u64,
    /// The file was completed.
    pub complete: bool,
    /// Where an interrupted recording ends; before the first trigger if it was interrupted at once.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interrupted_ms: Option<i64>,
    /// The file is longer than what is read for a page.
    pub cut: bool,
    /// Parts of the file that cannot be used, and why.
    pub left_out: Vec<String>,
    pub more_left_out: u64,
}

/// The messages of one topic in the file.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ToldTopic {
    pub topic: String,
    pub type_name: String,
    pub messages: u64,
    pub bytes: u64,
    /// Messages that the file has by their times and sizes alone, and their bytes.
    pub left_out: u64,
    pub left_out_bytes: u64,
    pub first_ms: i64,
    pub last_ms: i64,
}

/// Reads the file of an incident, also one that is being written or was interrupted.
///
/// # Errors
/// It is no MCAP file, or the disk cannot read it.
pub fn read(path: &Path, summary: &Summary) -> Result<Story, FileError> {
    let mut reader = Reader::open(path)?;
    let mut heard = Heard::default();
    let (mut entries, mut bytes, mut cut) = (0, 0, false);
    while let Some(entry) = reader.next_entry() {
        bytes += heard.take(entry);
        entries += 1;
        if entries >= ENTRIES_MAX || bytes >= BYTES_MAX {
            cut = true;
            break;
        }
    }
    let omissions = reader.omissions();
    let left_out = omissions.list().iter().map(ToString::to_string).collect();
    let (complete, more_left_out) = (reader.is_complete(), omissions.more());
    Ok(Story { complete, cut, left_out, more_left_out, ..heard.tell(summary) })
}

/// The story of these changes, which begin with the states of all nodes.
pub fn of_changes<'a>(changes: impl Iterator<Item = Transition<'a>>, summary: &Summary) -> Story {
    let mut heard = Heard::default();
    changes.for_each(|change| heard.change(change));
    Story { complete: true, ..heard.tell(summary) }
}

/// The story of an incident whose file cannot be read: its triggers.
pub fn known(summary: &Summary) -> Story {
    let alarm = |trigger: &TriggerLine| {
        let frozen = summary.freeze.iter().find(|frozen| frozen.node == trigger.what);
        let (state, message) = frozen.map(|it| (it.state.clone(), it.message.clone())).unwrap_or_default();
        let what = Happened::Fails { node: trigger.what.clone(), state, message, began_ms: None };
        Moment { at_ms: trigger.at_ms, what }
    };
    let alarms = summary.triggers.iter().filter(|trigger| trigger.kind == kind::ROOT).map(alarm);
    let mut moments: Vec<Moment> = alarms.chain(triggers(summary)).collect();
    moments.sort_by_key(|moment| moment.at_ms);
    let from_ms = from_ms(summary);
    Story {
        from_ms,
        to_ms: summary.until_ms.unwrap_or(summary.since_ms).max(from_ms + 1),
        moments,
        more_moments: summary.more_triggers,
        ..Story::default()
    }
}

/// The first instant that is shown.
fn from_ms(summary: &Summary) -> i64 {
    let pre_roll_ms = (summary.recording.pre_roll_s.clamp(0.0, 3600.0) * 1000.0) as i64;
    summary.since_ms.saturating_sub(pre_roll_ms)
}

/// The entries read so far, summed up.
#[derive(Debug, Default)]
struct Heard<'a> {
    topics: BTreeMap<String, ToldTopic>,
    changes: Vec<Transition<'a>>,
    more_changes: u64,
    operator: Vec<Moment>,
    lost: u64,
}

impl<'a> Heard<'a> {
    /// Takes an entry. Returns its bytes.
    fn take(&mut self, entry: Entry) -> u64 {
        match entry {
            Entry::Message { channel, stamps, body } => {
                let bytes = body.map_or(0, |(body, _)| body.len() as u64);
                let at_ms = ms(stamps.log_time_ns);
                if let Some(topic) = self.topic(&channel.topic, at_ms) {
                    topic.type_name = channel.type_name.to_string();
                    topic.messages += 1;
                    topic.bytes += bytes;
                }
                bytes
            }
            Entry::Json { channel, stamps, text } => {
                if *channel.topic == *TRANSITIONS.topic {
                    // A line of another version says nothing.
                    match serde_json::from_slice::<Transition<'static>>(&text) {
                        Ok(change) => self.change(change),
                        Err(_) => self.more_changes += 1,
                    }
                } else if *channel.topic == *JOURNAL.topic {
                    self.journal(ms(stamps.log_time_ns), &text);
                }
                text.len() as u64
            }
            // `left_out` says it.
            Entry::Missing(_) => 0,
        }
    }

    /// The account of a topic that has an entry at this instant.
    fn topic(&mut self, name: &str, at_ms: i64) -> Option<&mut ToldTopic> {
        if self.topics.len() >= TOPICS_MAX && !self.topics.contains_key(name) {
            return None;
        }
        let topic = self.topics.entry(name.to_owned()).or_insert_with(|| ToldTopic {
            topic: name.to_owned(),
            type_name: String::new(),
            messages: 0,
            bytes: 0,
            left_out: 0,
            left_out_bytes: 0,
            first_ms: at_ms,
            last_ms: at_ms,
        });
        topic.last_ms = topic.last_ms.max(at_ms);
        Some(topic)
    }

    fn change(&mut self, change: Transition<'a>) {
        if self.changes.len() < CHANGES_MAX { self.changes.push(change) } else { self.more_changes += 1 }
    }

    /// Takes from the journal the operator's actions, the losses and the sizes of what is left out, and nothing else.
    fn journal(&mut self, at_ms: i64, text: &[u8]) {
        let has = |word: &[u8]| text.windows(word.len()).any(|part| part == word);
        if !has(b"\"operator\"") && !has(b"\"lost\"") && !has(b"\"left_out\"") {
            return;
        }
        let line = serde_json::from_slice::<Line>(text);
        if let Ok(Line { left_out: Some(left_out), .. }) = &line
            && let Some(topic) = self.topic(&left_out.topic, at_ms)
        {
            topic.left_out += 1;
            topic.left_out_bytes = topic.left_out_bytes.saturating_add(left_out.bytes);
        }
        match line.map(|line| line.took) {
            Ok(Took::Lost(count)) => self.lost = self.lost.saturating_add(count),
            Ok(Took::Input(input)) => {
                if let Input::Operator(action) = &*input
                    && let Some(what) = done(action)
                    && self.operator.len() < MOMENTS_MAX
                {
                    self.operator.push(Moment { at_ms, what });
                }
            }
            _ => {}
        }
    }

    fn tell(self, summary: &Summary) -> Story {
        let from_ms = from_ms(summary);
        let last = self.topics.values().map(|topic| topic.last_ms).max();
        let last = last.max(self.changes.iter().map(|change| change.at_ms).max());
        let until_ms = summary.until_ms.or(last).unwrap_or(summary.since_ms);
        // Of an interrupted recording, nothing is known behind its last entry.
        let end_ms = summary.recording.interrupted.then(|| last.map_or(from_ms, |last| last.min(until_ms)));
        let to_ms = end_ms.unwrap_or(until_ms).max(from_ms + 1);
        let mut moments = self.operator;
        moments.extend(happened(&self.changes, summary, from_ms));
        moments.extend(triggers(summary));
        moments.retain(|moment| {
            (from_ms..=to_ms).contains(&moment.at_ms) || end_ms.is_some_and(|end| moment.at_ms > end)
        });
        moments.extend(end_ms.map(|at_ms| Moment { at_ms, what: Happened::Interrupted }));
        // Of one instant first what the operator did, last what followed from the changes.
        moments.sort_by_key(Moment::began_ms);
        let more = moments.len().saturating_sub(MOMENTS_MAX) as u64;
        moments.truncate(MOMENTS_MAX);
        let (strips, more_periods) = strips(&self.changes, summary, (from_ms, to_ms));
        Story {
            from_ms,
            to_ms,
            moments,
            more_moments: more + self.more_changes,
            strips,
            more_periods,
            stages: stages(&self.changes, (from_ms, to_ms)),
            signals: signals(&self.changes, (from_ms, to_ms)),
            topics: self.topics.into_values().collect(),
            lost: self.lost,
            interrupted_ms: end_ms,
            ..Story::default()
        }
    }
}

pub(crate) fn ms(ns: u64) -> i64 {
    (ns / 1_000_000) as i64
}

/// The triggers that no change of a state tells.
fn triggers(summary: &Summary) -> impl Iterator<Item = Moment> {
    summary.triggers.iter().filter_map(|trigger| {
        let what = match &*trigger.kind {
            kind::OWN_ERROR => Happened::FailsBehind { node: trigger.what.clone() },
            kind::LOST_ACTIVE => Happened::LostActive { stage: trigger.what.clone() },
            kind::COUNTERMEASURE => Happened::Request { request: trigger.what.clone() },
            kind::MARK => Happened::Mark { by: trigger.what.clone(), note: trigger.note.clone() },
            _ => return None,
        };
        Some(Moment { at_ms: trigger.at_ms, what })
    })
}

/// A node below a group. Groups follow from them.
fn is_module(node: &str) -> bool {
    node.contains('/')
}

fn is_fault(state: &str) -> bool {
    matches!(state, "warning" | "error" | "unknown")
}

/// The story of the changes from an instant on. Those before it, and the states with which a recording begins, are only
/// known.
fn happened(changes: &[Transition<'_>], summary: &Summary, from_ms: i64) -> Vec<Moment> {
    let mut moments: Vec<Moment> = Vec::new();
    let given_time = given_time(changes);
    let has_alarm = |node: &str| summary.triggers.iter().any(|it| it.kind == kind::ROOT && it.what == node);
    // The last state of each node, and its mask.
    let mut before: BTreeMap<&str, (&str, Option<&str>)> = BTreeMap::new();
    let mut signals: BTreeMap<&str, Option<bool>> = BTreeMap::new();
    let mut stage = None;
    for (index, Transition { at_ms, change }) in changes.iter().enumerate() {
        let (at_ms, is_told) = (*at_ms, *at_ms >= from_ms);
        let mut tell = |what| moments.push(Moment { at_ms, what });
        match change {
            Change::Shown { node, shown, masked_by, message, began_ms, .. } => {
                let cause = masked_by.as_deref();
                let was_ignored = before.get(&**node).is_some_and(|(shown, _)| *shown == "ignore");
                if was_ignored && given_time.contains(&index) && !has_alarm(node) {
                    continue;
                }
                let last = before.insert(node, (shown, cause));
                let last_shown = last.map(|(shown, _)| shown);
                if !is_told {
                    continue;
                }
                match (cause, &**shown) {
                    // Its own state behind the cause changed.
                    (Some(_), _) if last.is_some_and(|(_, last)| last == cause) => {}
                    (Some(by), _) => add(&mut moments, at_ms, Some(by), node),
                    (None, state) if is_module(node) && is_fault(state) && last_shown != Some(state) => {
                        let message = message.as_deref().unwrap_or_default().to_owned();
                        let (node, state) = (node.to_string(), state.to_owned());
                        tell(Happened::Fails { node, state, message, began_ms: *began_ms });
                    }
                    (None, "ok") if is_module(node) && last_shown.is_some_and(is_fault) => {
                        add(&mut moments, at_ms, None, node);
                    }
                    _ => {}
                }
            }
            Change::Stage { stage: next } => {
                let is_new = stage.replace(next).is_some_and(|last| last != next);
                if is_told && is_new {
                    tell(Happened::Stage { stage: next.to_string() });
                }
            }
            Change::Signal { signal, value } => {
                let is_new = signals.insert(signal, *value).is_some_and(|last| last != *value);
                if is_told && is_new {
                    tell(Happened::Signal { signal: signal.to_string(), value: *value });
                }
            }
            Change::AlarmMoved { symptom, node, .. } if is_told => {
                tell(Happened::AlarmMoves { symptom: symptom.to_string(), node: node.to_string() });
            }
            Change::Started { reloaded: true } if is_told => tell(Happened::Reload),
            Change::Lost { count } if is_told => tell(Happened::Lost { count: *count }),
            Change::ClockSet { by_ms } if is_told => tell(Happened::ClockSet { by_ms: *by_ms }),
            Change::Refused { action, on, by, why, why_de } if is_told => {
                let [action, on, by, why, why_de] = [action, on, by, why, why_de].map(ToString::to_string);
                tell(Happened::Refused { action, on, by, why, why_de });
            }
            _ => {}
        }
    }
    moments
}

/// The changes to UNKNOWN that raised no alarm as long as they lasted. Where a node begins to matter, as at a departure,
/// it is given time to report, however long it measures.
fn given_time(changes: &[Transition<'_>]) -> BTreeSet<usize> {
    let (mut alarmed, mut found) = (BTreeSet::new(), BTreeSet::new());
    for (index, Transition { change, .. }) in changes.iter().enumerate().rev() {
        match change {
            Change::AlarmRaised { node, .. } => drop(alarmed.insert(&**node)),
            Change::Shown { node, shown, .. } => {
                let is_alarmed = alarmed.remove(&**node);
                if shown == "unknown" && !is_alarmed {
                    found.insert(index);
                }
            }
            _ => {}
        }
    }
    found
}

/// Names a node in the last moment, if it tells the same of others at the same time, or in a new one.
fn add(moments: &mut Vec<Moment>, at_ms: i64, masked_by: Option<&str>, node: &str) {
    let same = moments.iter_mut().rev().take_while(|moment| moment.at_ms == at_ms);
    let found = same.into_iter().find_map(|moment| match (&mut moment.what, masked_by) {
        (Happened::Masks { by, nodes, more }, Some(cause)) if *by == cause => Some((nodes, more)),
        (Happened::Recovers { nodes, more }, None) => Some((nodes, more)),
        _ => None,
    });
    match found {
        Some((nodes, _)) if nodes.len() < NAMED_MAX => nodes.push(node.to_owned()),
        Some((_, more)) => *more += 1,
        None => {
            let (nodes, more) = (vec![node.to_owned()], 0);
            let what = match masked_by {
                Some(by) => Happened::Masks { by: by.to_owned(), nodes, more },
                None => Happened::Recovers { nodes, more },
            };
            moments.push(Moment { at_ms, what });
        }
    }
}

/// The effect of an action; a first step of two has none.
fn done(action: &OperatorAction) -> Option<Happened> {
    let is_first = matches!(action, OperatorAction::AskClearance { .. } | OperatorAction::AskRelease { .. });
    let (action, on) = operator_word(action);
    (!is_first).then_some(Happened::Operator { action, on })
}

/// The word of an action, and on what it acts. Both steps of one have the same.
pub fn operator_word(action: &OperatorAction) -> (&'static str, String) {
    match action {
        OperatorAction::Login { name } => ("login", name.to_string()),
        OperatorAction::Logout => ("logout", String::new()),
        OperatorAction::Shutdown => ("shutdown", String::new()),
        OperatorAction::Localize { .. } => ("localize", String::new()),
        OperatorAction::AskClearance { .. } | OperatorAction::Clear { .. } => ("clearance", String::new()),
        OperatorAction::RequestStop => ("stop", String::new()),
        OperatorAction::Withdraw => ("withdraw", String::new()),
        OperatorAction::AskRelease { .. } | OperatorAction::Release { .. } => ("release", String::new()),
        OperatorAction::Acknowledge { alarm: AlarmRef::Node(node) } => ("acknowledge", node.to_string()),
        OperatorAction::Acknowledge { alarm: AlarmRef::Number(number) } => {
            ("acknowledge", number.to_string())
        }
        OperatorAction::Acknowledge { alarm: AlarmRef::Over { .. } } => ("acknowledge", String::new()),
        OperatorAction::Reset { module } => ("reset", module.to_string()),
        OperatorAction::Shelve { module, .. } => ("shelve", module.to_string()),
        OperatorAction::Unshelve { module } => ("unshelve", module.to_string()),
    }
}

#[cfg(test)]
mod tests;
