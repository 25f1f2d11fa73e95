//! Any text is a line, a transition or a state of a recording that the engine takes, or is refused.

#![no_main]

use std::sync::{Arc, LazyLock};

use libfuzzer_sys::fuzz_target;
use telltale::config::parse;
use telltale::engine::Engine;
use telltale::engine::input::{Input, StatusArray};
use telltale::engine::keyframe::Keyframe;
use telltale::engine::model::Model;
use telltale::engine::time::{Span, Timestamp};
use telltale::record::journal::{Line, Took};
use telltale::record::transition::Transition;

const CONFIGURATION: &str = "limits: { discovered_modules: 8 }
signals: { doors: { topic: /doors, type: std_msgs/msg/Bool, timeout: 1s } }
groups:
- { id: a, match: [{ contains: a }], modules: [{ id: m, status: m }] }
- id: b
  depends_on: [a]
  match: [{ contains: b }]
  modules: [{ id: rate, monitor: { frequency: { topic: /c, type: std_msgs/msg/Bool, window: 1s, error_below: 5 } } }]
";

/// A clock that leaps by years has as many deadlines.
const STEP_MAX: Span = Span::from_secs(60);

const LINES: [&str; 6] = [
    r#"{"at_ns":9,"took":{"input":{"diagnostics":{"writer":"00000000000000000000000000000001","statuses":[{"level":2,"name":"b","message":"x","hardware_id":"","values":[["k","v"]]}]}}}}"#,
    r#"{"at_ns":9,"took":{"input":{"operator":{"login":{"name":"o"}}}}}"#,
    r#"{"at_ns":9,"took":"statuses","message":{"topic":"/d","writer":"00","sequence":-1,"received_ns":5}}"#,
    r#"{"at_ns":9,"took":{"reload":[{"name":"a.yaml","text":"groups: []"}]}}"#,
    r#"{"at_ms":1,"kind":"shown","node":"a/m","shown":"error","own":"error","masked_by":"b","message":"x"}"#,
    "",
];

static MODEL: LazyLock<Arc<Model>> =
    LazyLock::new(|| parse("c", CONFIGURATION).expect("it stands above").model);

fn engine() -> Engine {
    let mut engine = Engine::new(MODEL.clone(), Timestamp::ZERO);
    let mut array = StatusArray::default();
    array.push_status(1, "a new one", "it is new", "");
    array.push_value("rate", "9.5");
    engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(5));
    engine
}

static STATE: LazyLock<String> =
    LazyLock::new(|| serde_json::to_string(&engine().keyframe()).expect("every keyframe can be written"));

// A text, and what is changed in it: where, how much goes, what comes.
fuzz_target!(|input: (u8, Vec<(u16, u8, &str)>)| {
    let (which, edits) = input;
    let mut text = LINES.get(which as usize % (LINES.len() + 1)).map_or(&**STATE, |line| line).to_owned();
    for (at, gone, new) in edits {
        let start = text.floor_char_boundary(at as usize % (text.len() + 1));
        let end = text.floor_char_boundary((start + gone as usize).min(text.len())).max(start);
        text.replace_range(start..end, new);
    }
    if let Ok(line) = serde_json::from_str::<Line>(&text)
        && let Took::Input(input) = &line.took
    {
        let mut engine = engine();
        engine.handle(input, line.at_ns.min(engine.now() + STEP_MAX));
        engine.snapshot();
        serde_json::to_string(&line).expect("every line can be written");
    }
    if let Ok(transition) = serde_json::from_str::<Transition>(&text) {
        serde_json::to_string(&transition).expect("every transition can be written");
    }
    if let Ok(keyframe) = serde_json::from_str::<Keyframe>(&text)
        && let Ok(mut engine) = Engine::from_keyframe(MODEL.clone(), &keyframe)
    {
        engine.handle(&Input::Tick, engine.now() + STEP_MAX);
        engine.snapshot();
        serde_json::to_string(&engine.keyframe()).expect("every keyframe can be written");
    }
});
