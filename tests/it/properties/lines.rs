//! Lines and states of recordings that strangers hand over: cut, spliced, changed. Each is refused, or does no harm.

use std::sync::Arc;

use proptest::collection::vec;
use proptest::prelude::*;
use serde_json::json;
use telltale::engine::Engine;
use telltale::engine::input::Input;
use telltale::engine::keyframe::Keyframe;
use telltale::engine::model::Model;
use telltale::engine::time::{Span, Timestamp};
use telltale::record::journal::{Line, Took};
use telltale::record::transition::Transition;

use super::cases::{Choices, model};
use super::files::history_of_all;
use super::{config, numbers};

/// Later inputs count as this much later: a clock that leaps by years has that many deadlines.
const STEP_MAX: Span = Span::from_secs(60);

/// Pieces that have a meaning in JSON or in a line.
const PIECES: &[&str] = &[
    "",
    "{",
    "}",
    "[",
    "]",
    "\"",
    ",",
    ":",
    "null",
    "true",
    "-1",
    "0",
    "1e999",
    "18446744073709551615",
    "[[[[[[[[",
    "\\ud800",
    "\\u0000",
    "\u{1F68C}",
    "\"nan\"",
    "\"took\":",
    "\"at_ns\":",
    "\"input\":\"tick\"",
    "\"lost\":1",
];

/// Replaces a few ranges of a text by pieces, some of another text; some end too early.
fn damaged(text: &str, other: &str, choices: &mut Choices<'_>) -> String {
    let mut text = text.to_owned();
    for _ in 0..1 + choices.below(4) {
        let start = text.floor_char_boundary(choices.below(text.len() + 1));
        let end = text.floor_char_boundary((start + choices.below(20)).min(text.len())).max(start);
        match choices.below(8) {
            0 => text.truncate(start),
            1 | 2 => {
                let from = other.floor_char_boundary(choices.below(other.len() + 1));
                let to = other.floor_char_boundary((from + choices.below(80)).min(other.len())).max(from);
                text.replace_range(start..end, &other[from..to]);
            }
            _ => text.replace_range(start..end, PIECES[choices.below(PIECES.len())]),
        }
    }
    text
}

/// The lines of a recording of these inputs, and others.
fn lines(history: &[(Timestamp, Input)]) -> Vec<String> {
    let message = json!({ "topic": "/diagnostics", "writer": "ab", "sequence": -1, "received_ns": u64::MAX });
    let line = |(at, input): &(Timestamp, Input)| {
        json!({ "at_ns": at.as_nanos(), "took": { "input": input }, "message": message }).to_string()
    };
    let mut lines: Vec<String> = history.iter().map(line).collect();
    lines.push(json!({ "at_ns": 7, "took": "statuses", "message": message }).to_string());
    lines.push(json!({ "at_ns": 8, "took": { "lost": 3 } }).to_string());
    let text = json!({ "name": "vehicle.yaml", "text": "groups: []\n" });
    lines.push(json!({ "at_ns": 9, "took": { "reload": [text] } }).to_string());
    lines
}

/// Takes whatever a line says.
fn take(engine: &mut Engine, line: &Line<'_>) {
    let at = line.at_ns.max(engine.now()).min(engine.now() + STEP_MAX);
    if let Took::Input(input) = &line.took {
        engine.handle(input, at);
        engine.snapshot();
    }
}

/// Takes whatever a state says.
fn go_on(model: &Arc<Model>, text: &str) {
    if let Ok(keyframe) = serde_json::from_str::<Keyframe>(text)
        && let Ok(mut engine) = Engine::from_keyframe(model.clone(), &keyframe)
    {
        engine.snapshot();
        engine.handle(&Input::Tick, engine.now() + STEP_MAX);
        engine.snapshot();
        serde_json::to_string(&engine.keyframe()).expect("every keyframe can be written");
    }
}

proptest! {
    #![proptest_config(config())]

    /// The same as the fuzz target `journal`.
    #[test]
    fn a_damaged_line_or_state_is_refused_or_does_no_harm(numbers in numbers(), damage in vec(any::<u32>(), 60..200)) {
        let mut choices = Choices::new(&numbers);
        let model = model(&mut choices);
        let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
        let history = history_of_all(&mut choices);
        let lines = lines(&history);
        for line in &lines {
            take(&mut engine, &serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}")));
        }
        let state = serde_json::to_string(&engine.keyframe()).expect("every keyframe can be written");
        let mut choices = Choices::new(&damage);
        while !choices.is_empty() {
            let (line, other) = (&lines[choices.below(lines.len())], &lines[choices.below(lines.len())]);
            let text = damaged(line, other, &mut choices);
            if let Ok(line) = serde_json::from_str::<Line>(&text) {
                let written = serde_json::to_string(&line).expect("every line can be written");
                let again: Line = serde_json::from_str(&written).unwrap_or_else(|error| panic!("{error}: {written}"));
                // Not a number differs from itself, but not from its name.
                prop_assert_eq!(format!("{again:?}"), format!("{line:?}"), "{}", text);
                take(&mut engine, &line);
            }
            go_on(&model, &damaged(&state, line, &mut choices));
        }
    }

    #[test]
    fn a_damaged_transition_is_refused_or_is_one(damage in vec(any::<u32>(), 20..80)) {
        let shown = r#"{"at_ms":-5,"kind":"shown","node":"a/b","shown":"error","own":"ok","masked_by":"a/c","message":"\u00e4"}"#;
        let lines = [
            shown,
            r#"{"at_ms":1,"kind":"signal","signal":"doors","value":null}"#,
            r#"{"at_ms":1,"kind":"alarm_moved","alarm":7,"symptom":"a/b","node":"a/c"}"#,
            r#"{"at_ms":1,"kind":"started","reloaded":true}"#,
            r#"{"at_ms":1,"kind":"lost","count":3}"#,
        ];
        for line in lines {
            prop_assert_eq!(serde_json::to_value(serde_json::from_str::<Transition>(line).unwrap()).unwrap(),
                serde_json::from_str::<serde_json::Value>(line).unwrap());
        }
        let mut choices = Choices::new(&damage);
        while !choices.is_empty() {
            let text = damaged(lines[choices.below(lines.len())], shown, &mut choices);
            if let Ok(transition) = serde_json::from_str::<Transition>(&text) {
                let written = serde_json::to_string(&transition).expect("every transition can be written");
                let again: Transition = serde_json::from_str(&written).unwrap_or_else(|error| panic!("{error}: {written}"));
                prop_assert_eq!(again, transition, "{}", text);
            }
        }
    }
}
