//! A small campaign gives the same figures as on the day when they were written down, and no figure that must be 0 is not.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::program::run;

/// The figures of the first fifty seeds. `BLESS=1` writes them anew.
fn small(machine: &str) {
    // Tests beside it have limits of time.
    let output = run(&["evaluate", "--machine", machine, "--seeds", "1..50", "--threads", "1", "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let figures: Value = serde_json::from_slice(&output.stdout).expect("one object");
    for zero in ["wrong_greens", "wrong_reactions", "wrong_instructions"] {
        assert_eq!(figures["ours"][zero], 0.0, "{machine}: {zero}");
    }
    assert_eq!(figures["ours"]["hidden"]["beyond_within"], 0.0, "{machine}");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("docs/campaign/{machine}-small.json"));
    let text = format!("{}\n", serde_json::to_string_pretty(&figures).expect("values are JSON"));
    if std::env::var_os("BLESS").is_some() {
        fs::write(&path, &text).expect("the folder is there");
    }
    let committed = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        text == committed,
        "{} is old: run this test with BLESS=1, and say why it changed",
        path.display()
    );
}

#[test]
fn a_small_campaign_of_the_shuttle_has_its_figures() {
    small("shuttle");
}

#[test]
fn a_small_campaign_of_the_robot_has_its_figures() {
    small("robot");
}

#[test]
fn seeds_are_a_range() {
    for wrong in ["5", "9..1", "a..b", "1..9999999999"] {
        let output = run(&["evaluate", "--seeds", wrong]);
        assert_eq!(output.status.code(), Some(2), "{wrong}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("seeds"), "{wrong}");
    }
}
