//! Any bytes are read as a database of rosbag2, to an end, and what cannot be used is said.

#![no_main]

use libfuzzer_sys::fuzz_target;
use telltale::replay::bag::Bag;

fuzz_target!(|bytes: &[u8]| {
    let path = std::env::temp_dir().join(format!("telltale-fuzz-{}.db3", std::process::id()));
    std::fs::write(&path, bytes).expect("the temporary folder can be written");
    if let Ok(mut bag) = Bag::open(&path) {
        // A page of a damaged tree can be reached more than once, but no row is shorter than a few bytes.
        for found in 0.. {
            if bag.next_entry().is_none() {
                break;
            }
            assert!(found < 1_000 + 100 * bytes.len(), "it has no end");
        }
    }
});
