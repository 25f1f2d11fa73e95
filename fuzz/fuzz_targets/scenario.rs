//! Any text is a scenario, or is refused in words.

#![no_main]

use libfuzzer_sys::fuzz_target;
use telltale::sim::scenario_file::parse;

fuzz_target!(|text: &str| {
    if let Err(problems) = parse("s", text) {
        assert!(!problems.list().is_empty());
        assert!(!problems.render(false).is_empty());
    }
});
