//! Any file is read, or refused with a message.

use proptest::prelude::*;

use telltale::config::{difference, parse};
use telltale::sim::scenario_file;

const SHUTTLE: &str = include_str!("../../config/shuttle.yaml");
const SCENARIO: &str = include_str!("../../config/scenarios/2-sensor-outage.yaml");

/// Characters that break YAML and columns.
const PIECES: &[&str] = &[
    "", ":", ": ", "- ", "[", "]", "{", "}", "'", "\"", "\n", "\r\n", "\t", "  ", "#", "&a ", "*a", "!x ",
    "|", ">", "~", "ä", "漢", "🚌", "\u{feff}", "\u{200b}", "\u{7}", "%", "?", ",", "---\n", "0", "-1",
    "1e9", "null", "other",
];

/// Replaces a few ranges of a text by pieces.
fn broken(text: &str, edits: &[(prop::sample::Index, usize, usize)]) -> String {
    let mut text = text.to_owned();
    for (at, length, piece) in edits {
        let start = text.floor_char_boundary(at.index(text.len() + 1));
        let end = text.floor_char_boundary((start + length).min(text.len())).max(start);
        text.replace_range(start..end, PIECES[piece % PIECES.len()]);
    }
    text
}

fn edits() -> impl Strategy<Value = Vec<(prop::sample::Index, usize, usize)>> {
    prop::collection::vec((any::<prop::sample::Index>(), 0..40usize, any::<usize>()), 1..6)
}

proptest! {
    #[test]
    fn a_broken_configuration_is_refused_in_words(edits in edits()) {
        match parse("c", &broken(SHUTTLE, &edits)) {
            Ok(loaded) => {
                prop_assert_eq!(difference(&loaded, &loaded), []);
                let (_, warnings) = loaded.soundness();
                prop_assert!(warnings.is_none_or(|warnings| !warnings.render(false).is_empty()));
            }
            Err(problems) => {
                prop_assert!(!problems.list().is_empty());
                prop_assert!(!problems.render(false).is_empty());
            }
        }
    }

    #[test]
    fn a_broken_scenario_is_refused_in_words(edits in edits()) {
        if let Err(problems) = scenario_file::parse("s", &broken(SCENARIO, &edits)) {
            prop_assert!(!problems.list().is_empty());
            prop_assert!(!problems.render(false).is_empty());
        }
    }
}
