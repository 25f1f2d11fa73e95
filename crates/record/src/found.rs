//! Makes the summary of an incident from its recording, if the database has no row for it.

use std::collections::BTreeMap;
use std::path::Path;

use super::file::{ABOUT, BEGUN, Entry, FileError, JOURNAL, REPAIRED, Reader, TRANSITIONS};
use super::folder::file_name;
use super::incident::TRIGGERS_MAX;
use super::journal::{Line, Took};
use super::story::{BYTES_MAX, ENTRIES_MAX, ms};
use super::summary::{Recording, Summary, TriggerLine};
use super::transition::{Change, Transition};
use super::writer::VEHICLE;

/// A recording does not begin longer before its first trigger.
const PRE_ROLL_MS_MAX: i64 = 3_600_000;

/// Alarms whose causes are followed.
const ALARMS_MAX: usize = 1024;

/// The summary of an incident by its file alone: what was known when it began, and what followed. Notes that were
/// written about it later are not in it. Without a trigger in it, the incident begins with the first instant that is
/// shown. `None`: the file is no recording of this program.
///
/// # Errors
/// It is no MCAP file, or the disk cannot read it.
pub fn summary(path: &Path, id: u64) -> Result<Option<Summary>, FileError> {
    let mut reader = Reader::open(path)?;
    let Some(about) = reader.metadata().find(|(name, _)| *name == ABOUT).map(|(_, about)| about.clone())
    else {
        return Ok(None);
    };
    let interrupted = !reader.is_complete() || reader.metadata().any(|(name, _)| name == REPAIRED);
    let begun = reader.metadata().find(|(name, _)| *name == BEGUN);
    let begun = begun.and_then(|(_, it)| serde_json::from_str::<Summary>(it.get("summary")?).ok());
    let version = reader.library().strip_prefix("telltale ").unwrap_or_default().to_owned();
    let text = |key: &str| about.get(key).cloned().unwrap_or_default();
    let ns = |key: &str| text(key).parse::<u64>().unwrap_or_default();
    let (first, last) = reader.span_ns().unwrap_or_default();
    // The times that the file gives cannot be beyond its messages.
    let from_ms = ms(ns("start_of_clock_ns").saturating_add(ns("shown_from_ns")).clamp(first, last));
    let mut heard = Heard { from_ms, ..Heard::default() };
    let (mut entries, mut bytes) = (0, 0);
    while let Some(entry) = reader.next_entry() {
        bytes += heard.take(entry);
        entries += 1;
        if entries >= ENTRIES_MAX || bytes >= BYTES_MAX {
            break;
        }
    }
    let Heard { told, alarms, stage, messages, missing, .. } = heard;
    let begun = begun.unwrap_or_default();
    let mut triggers = begun.triggers;
    for line in told {
        if triggers.len() < TRIGGERS_MAX && !triggers.contains(&line) {
            triggers.push(line);
        }
    }
    let since_ms = triggers.first().map_or(from_ms, |trigger| trigger.at_ms);
    let mut roots: Vec<String> = Vec::new();
    for root in alarms.into_values() {
        if !roots.contains(&root) {
            roots.push(root);
        }
    }
    let recording = Recording {
        file: file_name(id),
        pre_roll_s: since_ms.saturating_sub(from_ms).clamp(0, PRE_ROLL_MS_MAX) as f64 / 1000.0,
        messages,
        missing,
        interrupted,
        ..Recording::default()
    };
    Ok(Some(Summary {
        id,
        since_ms,
        until_ms: Some(ms(last).max(since_ms)),
        stage: if begun.stage.is_empty() { stage } else { begun.stage },
        storm: begun.storm,
        freeze: begun.freeze,
        triggers,
        more_triggers: begun.more_triggers,
        roots,
        vehicle: text(VEHICLE),
        configuration: text("configuration_sha256"),
        version,
        recording,
    }))
}

/// The entries read so far, summed up.
#[derive(Debug, Default)]
struct Heard {
    from_ms: i64,
    /// The triggers.
    told: Vec<TriggerLine>,
    /// The present cause of each alarm.
    alarms: BTreeMap<u64, String>,
    /// At the first trigger, or at the end if there is none.
    stage: String,
    messages: u64,
    missing: u64,
}

impl Heard {
    /// Takes an entry. Returns its bytes.
    fn take(&mut self, entry: Entry) -> u64 {
        match entry {
            Entry::Message { body, .. } => {
                self.messages += 1;
                body.map_or(0, |(body, _)| body.len() as u64)
            }
            Entry::Json { channel, text, .. } => {
                if *channel.topic == *TRANSITIONS.topic {
                    // A line of another version says nothing.
                    if let Ok(transition) = serde_json::from_slice::<Transition>(&text) {
                        self.change(&transition);
                    }
                } else if *channel.topic == *JOURNAL.topic
                    && text.windows(6).any(|word| word == b"\"lost\"")
                    && let Ok(Line { took: Took::Lost(count), .. }) = serde_json::from_slice::<Line>(&text)
                {
                    self.missing = self.missing.saturating_add(count);
                }
                text.len() as u64
            }
            Entry::Missing(_) => 0,
        }
    }

    fn change(&mut self, Transition { at_ms, change }: &Transition<'_>) {
        match change {
            Change::Trigger { of, what, alarm, note } if self.told.len() < TRIGGERS_MAX => {
                let line = TriggerLine {
                    at_ms: *at_ms,
                    kind: of.to_string(),
                    what: what.to_string(),
                    alarm: *alarm,
                    note: note.to_string(),
                };
                self.told.push(line);
            }
            Change::Stage { stage } if self.told.is_empty() => self.stage = stage.to_string(),
            Change::AlarmRaised { alarm, node }
                if *at_ms >= self.from_ms && self.alarms.len() < ALARMS_MAX =>
            {
                self.alarms.insert(*alarm, node.to_string());
            }
            Change::AlarmMoved { alarm, node, .. } => {
                if let Some(root) = self.alarms.get_mut(alarm) {
                    *root = node.to_string();
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::file::{IncidentFile, MessageStamps};
    use crate::summary::kind;
    use telltale_msg::cdr::Endian;

    const START_MS: i64 = 1_790_000_000_000;

    fn trigger(at_ms: i64, node: &str, alarm: Option<u64>) -> Value {
        json!({ "at_ms": START_MS + at_ms, "kind": "trigger", "of": kind::ROOT, "what": node, "alarm": alarm })
    }

    #[test]
    fn a_file_tells_when_and_why_as_far_as_it_has_it() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let path = folder.join("a.mcap");
        let facts = [
            ("incident", "7"),
            ("configuration_sha256", "abc"),
            ("start_of_clock_ns", "1790000000000000000"),
            ("shown_from_ns", "10000000000"),
            (VEHICLE, "shuttle-1"),
        ];
        let about = facts.map(|(key, value)| (key.to_owned(), value.to_owned()));
        let mut file = IncidentFile::create(&path, about.into()).unwrap();
        let stage = |stage: &str| json!({ "at_ms": START_MS, "kind": "stage", "stage": stage });
        let alarm = |at_ms: i64, number: u64, node: &str| json!({ "at_ms": START_MS + at_ms, "kind": "alarm_raised", "alarm": number, "node": node });
        let changes = [
            stage("active"),
            alarm(5_000, 3, "a/earlier"),
            trigger(40_000, "a/rate", None),
            stage("locked"),
            alarm(41_000, 4, "a/symptom"),
            trigger(41_000, "a/symptom", Some(4)),
            json!({ "at_ms": START_MS + 41_500, "kind": "alarm_moved", "alarm": 4, "symptom": "a/symptom", "node": "b/root" }),
            json!({ "kind": "of another version" }),
        ];
        let ns = |ms: i64| (START_MS + ms) as u64 * 1_000_000;
        for change in changes {
            file.json(&TRANSITIONS, ns(change["at_ms"].as_i64().unwrap_or(START_MS) - START_MS), &change)
                .unwrap();
        }
        file.json(&JOURNAL, ns(42_000), &json!({ "at_ns": 42, "took": { "lost": 5 } })).unwrap();
        let topic = file.topic("/a", "std_msgs/msg/Empty", || Some(String::new())).unwrap();
        let stamps = MessageStamps { log_time_ns: ns(50_000), publish_time_ns: 0, sequence: 0 };
        file.message(topic, stamps, (&[0], Endian::Little)).unwrap();
        file.finish().unwrap();
        let found = summary(&path, 9).unwrap().unwrap();
        let triggers: Vec<_> =
            found.triggers.iter().map(|it| (it.at_ms - START_MS, &*it.what, it.alarm)).collect();
        assert_eq!(triggers, [(40_000, "a/rate", None), (41_000, "a/symptom", Some(4))]);
        assert_eq!((found.since_ms, found.until_ms), (START_MS + 40_000, Some(START_MS + 50_000)));
        assert_eq!((&*found.stage, found.roots), ("active", vec!["b/root".to_owned()]));
        assert_eq!((&*found.vehicle, &*found.configuration), ("shuttle-1", "abc"));
        assert_eq!(found.version, crate::VERSION);
        let recording = found.recording;
        assert_eq!((&*recording.file, recording.pre_roll_s), ("incident-9.mcap", 30.0));
        assert_eq!((recording.messages, recording.missing, recording.interrupted), (1, 5, false));
    }

    #[test]
    fn a_file_that_tells_nothing_has_times_that_can_be_and_one_of_others_is_none() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let (path, other) = (folder.join("a.mcap"), folder.join("b.mcap"));
        let lies = [("start_of_clock_ns", u64::MAX.to_string()), ("shown_from_ns", "-1".to_owned())];
        let mut file =
            IncidentFile::create(&path, lies.map(|(key, value)| (key.to_owned(), value)).into()).unwrap();
        file.json(&TRANSITIONS, 5_000_000, &json!("nothing")).unwrap();
        file.end_chunk().unwrap();
        drop(file);
        let found = summary(&path, 9).unwrap().unwrap();
        assert_eq!((found.since_ms, found.until_ms, found.recording.pre_roll_s), (5, Some(5), 0.0));
        assert!(found.recording.interrupted && found.triggers.is_empty());
        let mut bag = mcap::Writer::new(std::fs::File::create(&other).unwrap()).unwrap();
        bag.finish().unwrap();
        assert_eq!(summary(&other, 9).unwrap(), None);
        std::fs::write(&other, "no recording").unwrap();
        assert!(summary(&other, 9).is_err());
    }
}
