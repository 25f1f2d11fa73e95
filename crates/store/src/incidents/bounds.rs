//! The bounds of a summary in the store.

use telltale_record::incident::NOTE_BYTES_MAX;
use telltale_record::summary::{FrozenNode, Summary, TriggerLine};
use telltale_yaml::plain;

/// All texts of a summary together.
const SUMMARY_BYTES_MAX: usize = 64 * 1024;
const TRIGGERS_MAX: usize = 256;
const ROOTS_MAX: usize = 256;
const FROZEN_MAX: usize = 256;
const VALUES_MAX: usize = 256;
const NAME_BYTES_MAX: usize = 1024;
const MESSAGE_BYTES_MAX: usize = 4096;

/// Bytes that are left for texts. Texts beyond it are cut.
struct Budget(usize);

impl Budget {
    fn cut(&mut self, text: &mut String, bytes_max: usize) {
        cut(text, bytes_max.min(self.0));
        self.0 -= text.len();
    }
}

/// Cuts a text to so many bytes, between two letters.
fn cut(text: &mut String, bytes_max: usize) {
    text.truncate(text.floor_char_boundary(bytes_max));
}

/// A note within its bound, without characters that move a cursor or turn the reading direction.
pub fn note(text: &str) -> String {
    let seen = |&letter: &char| letter == '\n' || letter != '\t' && !plain::acts(letter);
    let mut note: String = text.trim().chars().filter(seen).collect();
    cut(&mut note, NOTE_BYTES_MAX);
    note
}

/// The same summary within the bounds. The first triggers and roots are whole before the rest is.
pub(super) fn bounded(summary: &Summary) -> Summary {
    let mut summary = summary.clone();
    let mut budget = Budget(SUMMARY_BYTES_MAX);
    let Summary {
        triggers,
        more_triggers,
        roots,
        freeze,
        recording,
        stage,
        vehicle,
        configuration,
        version,
        ..
    } = &mut summary;
    *more_triggers += triggers.len().saturating_sub(TRIGGERS_MAX) as u64;
    triggers.truncate(TRIGGERS_MAX);
    roots.truncate(ROOTS_MAX);
    freeze.truncate(FROZEN_MAX);
    budget.cut(&mut recording.file, NAME_BYTES_MAX);
    if let Some(sha256) = &mut recording.sha256 {
        budget.cut(sha256, NAME_BYTES_MAX);
    }
    for text in [stage, vehicle, configuration, version] {
        budget.cut(text, NAME_BYTES_MAX);
    }
    roots.iter_mut().for_each(|root| budget.cut(root, NAME_BYTES_MAX));
    for TriggerLine { kind, what, note, .. } in triggers.iter_mut() {
        budget.cut(kind, NAME_BYTES_MAX);
        budget.cut(what, NAME_BYTES_MAX);
        budget.cut(note, NOTE_BYTES_MAX);
    }
    for FrozenNode { node, state, message, values, at_ms: _ } in freeze.iter_mut() {
        budget.cut(node, NAME_BYTES_MAX);
        budget.cut(state, NAME_BYTES_MAX);
        budget.cut(message, MESSAGE_BYTES_MAX);
        values.truncate(VALUES_MAX);
        for (key, value) in values.iter_mut() {
            budget.cut(key, NAME_BYTES_MAX);
            budget.cut(value, MESSAGE_BYTES_MAX);
        }
        values.retain(|(key, _)| !key.is_empty());
    }
    let left = triggers.len();
    triggers.retain(|trigger| !trigger.kind.is_empty());
    *more_triggers += (left - triggers.len()) as u64;
    roots.retain(|root| !root.is_empty());
    freeze.retain(|frozen| !frozen.node.is_empty());
    summary
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summary_of_any_size_is_kept_within_its_bounds() {
        let long = "ä".repeat(5_000);
        let trigger = TriggerLine {
            at_ms: 0,
            kind: "mark".into(),
            what: long.clone(),
            alarm: None,
            note: long.clone(),
        };
        let values = vec![(long.clone(), "value".to_owned()); 10];
        let frozen = FrozenNode {
            node: long.clone(),
            state: "error".into(),
            message: long.clone(),
            values,
            at_ms: None,
        };
        let summary = Summary {
            triggers: vec![trigger; 1000],
            more_triggers: 5,
            roots: vec![long.clone(); 1000],
            freeze: vec![frozen; 300],
            configuration: long.clone(),
            ..Summary::default()
        };
        let kept = bounded(&summary);
        assert_eq!(kept.triggers.len() as u64 + kept.more_triggers, 1005);
        assert!(kept.roots.len() < ROOTS_MAX && kept.roots[0].len() == NAME_BYTES_MAX);
        let json = serde_json::to_string(&kept).unwrap();
        assert!(json.len() < 8 * SUMMARY_BYTES_MAX, "{}", json.len());
        assert_eq!(bounded(&kept), kept);
        assert_eq!(note(&long).len(), NOTE_BYTES_MAX);
        assert_eq!(note(" a\u{1b}[2J\0\u{202e}\nb\t "), "a[2J\nb");
        assert_eq!(note("Grüße 日本 🚌"), "Grüße 日本 🚌");
    }
}
