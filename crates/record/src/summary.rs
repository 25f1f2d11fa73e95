//! The summary of an incident, without its recording: what lists and the head of its page show.

use serde::{Deserialize, Serialize};

use super::incident::Trigger;

/// An incident as the store keeps it and programs read it. Times are milliseconds since 1970, UTC.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    pub id: u64,
    /// The first trigger.
    pub since_ms: i64,
    /// The end of the recording; `None` while it lasts.
    pub until_ms: Option<i64>,
    /// The stage at the first trigger; empty if it is not known.
    pub stage: String,
    /// Oldest first; at most 256.
    pub triggers: Vec<TriggerLine>,
    /// Further triggers, which are only counted.
    pub more_triggers: u64,
    /// The nodes that explain the alarms, as known at the end.
    pub roots: Vec<String>,
    /// It followed at once on an incident that reached its greatest length.
    pub storm: bool,
    /// The id of the vehicle.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub vehicle: String,
    /// SHA-256 of the configuration's files, in hexadecimal digits.
    pub configuration: String,
    /// The version of Telltale.
    pub version: String,
    /// The modules that failed at the first trigger with those that belong to them, with their values at that time;
    /// then those that failed later.
    pub freeze: Vec<FrozenNode>,
    pub recording: Recording,
}

/// The kinds of a [`TriggerLine`].
pub mod kind {
    pub const ROOT: &str = "root";
    pub const OWN_ERROR: &str = "own_error";
    pub const LOST_ACTIVE: &str = "lost_active";
    pub const COUNTERMEASURE: &str = "countermeasure";
    pub const MARK: &str = "mark";
}

impl Summary {
    /// Whether this instant lies between its first trigger and its end, in milliseconds since 1970.
    pub fn lasts_at(&self, at_ms: i64) -> bool {
        self.since_ms <= at_ms && self.until_ms.is_none_or(|until_ms| at_ms <= until_ms)
    }

    /// Somebody marked it.
    pub fn is_marked(&self) -> bool {
        self.marks().next().is_some()
    }

    /// The marks, oldest first.
    pub fn marks(&self) -> impl Iterator<Item = &TriggerLine> {
        self.triggers.iter().filter(|trigger| trigger.kind == kind::MARK)
    }

    /// All triggers.
    pub fn trigger_count(&self) -> u64 {
        self.triggers.len() as u64 + self.more_triggers
    }

    /// The nodes that it is about: the roots, and modules that showed a WARNING which no root explained later. The roots
    /// are known later than the alarms: until then the nodes with alarms take their place. Without a new fault that was
    /// shown, it is about those that were hidden.
    pub fn causes(&self) -> Vec<&str> {
        let mut causes: Vec<&str> = self.roots.iter().map(String::as_str).collect();
        let is_shown = self.triggers.iter().any(|trigger| trigger.kind == kind::ROOT);
        let is_explained = |node: &str| {
            let mut hidden = self.triggers.iter().filter(|it| it.kind == kind::OWN_ERROR);
            !self.roots.is_empty() && hidden.any(|it| it.what == node)
        };
        let shown = self.triggers.iter().filter(|trigger| match &*trigger.kind {
            kind::ROOT if trigger.alarm.is_none() => !is_explained(&trigger.what),
            kind::ROOT => self.roots.is_empty(),
            kind::OWN_ERROR => !is_shown,
            _ => false,
        });
        for trigger in shown {
            if !causes.contains(&&*trigger.what) {
                causes.push(&trigger.what);
            }
        }
        causes
    }
}

/// A reason of an incident.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerLine {
    pub at_ms: i64,
    /// One of [`kind`].
    pub kind: String,
    /// The node of a root or of an ERROR behind one, the request of a countermeasure, the stage after `active`, or who marked.
    pub what: String,
    /// The number of the alarm of a root.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alarm: Option<u64>,
    /// The note of a mark.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
}

impl TriggerLine {
    pub fn of(at_ms: i64, trigger: &Trigger) -> TriggerLine {
        let (kind, what) = match trigger {
            Trigger::Root { node, .. } => (kind::ROOT, node.to_string()),
            Trigger::OwnError { node } => (kind::OWN_ERROR, node.to_string()),
            Trigger::LostActive { stage } => (kind::LOST_ACTIVE, stage.as_str().to_owned()),
            Trigger::Countermeasure { kind: request } => (kind::COUNTERMEASURE, request.as_str().to_owned()),
            Trigger::Mark { by, .. } => (kind::MARK, by.to_string()),
        };
        let alarm = if let Trigger::Root { alarm, .. } = trigger { *alarm } else { None };
        let note = if let Trigger::Mark { note, .. } = trigger { note.to_string() } else { String::new() };
        TriggerLine { at_ms, kind: kind.to_owned(), what, alarm, note }
    }
}

/// A module as it was at the first trigger, or at a later one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrozenNode {
    pub node: String,
    /// The shown state.
    pub state: String,
    pub message: String,
    pub values: Vec<(String, String)>,
    /// The time of the later trigger.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_ms: Option<i64>,
}

/// The file of a recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Recording {
    /// The name in the folder `incidents`.
    pub file: String,
    pub bytes: u64,
    /// Seconds before the first trigger that can be shown.
    pub pre_roll_s: f64,
    /// The file will not change.
    pub finished: bool,
    /// SHA-256 of the finished file, in hexadecimal digits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Messages in the file.
    pub messages: u64,
    /// Messages and inputs that are missing in the file: the disk or the memory had no room for them, or they
    /// were too large for its readers.
    pub missing: u64,
    /// The program ended while it was recorded.
    pub interrupted: bool,
    /// Messages that had no room, by `recording.disk` or on the disk, and their bytes.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub left_out: u64,
    #[serde(default, skip_serializing_if = "is_zero")]
    pub left_out_bytes: u64,
    /// The file was not there any more when it should have been completed: the recording is lost.
    pub gone: bool,
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

impl Recording {
    /// The file is still written.
    pub fn is_open(&self) -> bool {
        !self.finished && !self.interrupted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hidden_faults_are_what_an_incident_is_about_only_without_another_new_one() {
        let trigger = |kind: &str, what: &str, alarm| TriggerLine {
            at_ms: 0,
            kind: kind.into(),
            what: what.into(),
            alarm,
            note: String::new(),
        };
        let hidden = trigger(kind::OWN_ERROR, "base/brake", None);
        let mut summary =
            Summary { triggers: vec![hidden], roots: vec!["gnss/fix".into()], ..Summary::default() };
        assert_eq!(summary.causes(), ["gnss/fix", "base/brake"]);
        summary.triggers.push(trigger(kind::ROOT, "gnss/fix", Some(3)));
        assert_eq!(summary.causes(), ["gnss/fix"]);
        // The brake warned before its error was explained, the battery has nothing to do with it.
        summary.triggers.push(trigger(kind::ROOT, "base/brake", None));
        summary.triggers.push(trigger(kind::ROOT, "base/battery", None));
        assert_eq!(summary.causes(), ["gnss/fix", "base/battery"]);
    }
}
