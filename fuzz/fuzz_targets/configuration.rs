//! Any text is a configuration that an engine can run by, or is refused in words.

#![no_main]

use libfuzzer_sys::fuzz_target;
use telltale::config::{difference, parse};
use telltale::engine::Engine;
use telltale::engine::time::Timestamp;

/// Judging every situation of a large one takes long, and fuzzing needs many small ones.
const NODES_MAX: usize = 40;

fuzz_target!(|text: &str| {
    match parse("c", text) {
        Ok(loaded) => {
            assert!(difference(&loaded, &loaded).is_empty());
            if loaded.model.groups.len() + loaded.model.modules.len() <= NODES_MAX {
                let (_, warnings) = loaded.soundness();
                assert!(warnings.is_none_or(|warnings| !warnings.render(false).is_empty()));
            }
            Engine::new(loaded.model, Timestamp::ZERO).snapshot();
        }
        Err(problems) => {
            assert!(!problems.list().is_empty());
            assert!(!problems.render(false).is_empty());
        }
    }
});
