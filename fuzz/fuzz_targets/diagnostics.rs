//! Any bytes are a DiagnosticArray, whole or cut, whose statuses the engine takes.

#![no_main]

use libfuzzer_sys::fuzz_target;
use telltale::config::parse;
use telltale::engine::Engine;
use telltale::engine::input::Input;
use telltale::engine::model::Limits;
use telltale::engine::time::Timestamp;
use telltale::msg::cdr::Endian;
use telltale::msg::messages::diagnostic_array;

const CONFIGURATION: &str = "limits: { discovered_modules: 8 }
groups: [{ id: a, match: [{ contains: a }], modules: [{ id: m, status: m }] }, { id: b, depends_on: [a], match: [{ contains: b }] }]
";

fuzz_target!(|input: (bool, &[u8])| {
    let (little, body) = input;
    let endian = if little { Endian::Little } else { Endian::Big };
    let (array, _) = diagnostic_array(body, endian, &Limits::default());
    let loaded = parse("c", CONFIGURATION).expect("it stands above");
    let mut engine = Engine::new(loaded.model, Timestamp::ZERO);
    engine.handle(&Input::Diagnostics(array), Timestamp::ZERO);
    assert!(engine.snapshot().modules.iter().count() <= 8 + 3 + 3 + 1);
});
