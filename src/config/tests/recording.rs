//! Tests of the settings of the recording.

use super::*;
use crate::config::describe::words;
use crate::config::recording::Recording;

fn parsed(text: &str) -> Loaded {
    parse("c", &format!("{GROUP}{text}")).unwrap_or_else(|problems| panic!("{problems}"))
}

fn of(text: &str) -> String {
    words::recording(parsed(text).recording.as_ref())
}

#[test]
fn incidents_are_recorded_unless_it_is_switched_off() {
    assert_eq!(of(""), "30s before and 10s after, 256MB of memory, 10GB of disk, kept for 30d");
    assert_eq!(parsed("").recording, Some(Recording::default()));
    assert_eq!(of("recording: false\n"), "switched off");
    assert_eq!(
        of("recording: { before: 1m, after: 20s, memory: 1.5 GB, disk: 2TB, keep: 12h }\n"),
        "1m before and 20s after, 1500MB of memory, 2TB of disk, kept for 12h"
    );
}

#[test]
fn what_cannot_be_recorded_is_said_at_its_place() {
    check_beside_group(
        "recording: { before: 3m, after: 10, memory: 1kB, disk: 10, keep: 1m }\n",
        &[
            "2:22: 3m is not between 1s and 2m (the default is 30s)",
            "2:33: expected a duration, found `10` (write a number with one of the units ns, us, ms, s, m, h, d: for example `2s`)",
            "2:45: 1kB is not between 4MB and 16GB (the default is 256MB)",
            "2:56: expected a size, found `10` (write a number with one of the units kB, MB, GB, TB: for example `256MB`)",
            "2:66: 1m is not between 1h and 3650d (the default is 30d)",
        ],
    );
}
