//! A small campaign gives the same figures as on the day when they were written down, and no figure that must be 0 is not.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use crate::peer::Domain;
use crate::program::{run, said};

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

/// The fault of this seed in real time over DDS is judged as in virtual time.
fn live(machine: &str, seed: &str) {
    let domain = Domain::take();
    let id = domain.id.to_string();
    let trial = ["evaluate", "--machine", machine, "--seeds", seed, "--threads", "1", "--json"];
    let output = run([&trial[..], &["--live", "1", "--domain", &id]].concat());
    let (out, log, code) = said(&output);
    assert_eq!(code, Some(0), "{log}");
    let figures: Value = serde_json::from_str(&out).expect("one object");
    let live = &figures["live"];
    assert_eq!((&live["trials"], &live["faults"]), (&json!(1), &json!(1)), "{log}");
    for (name, value) in [
        ("first_right", 1.0),
        ("precision", 1.0),
        ("recall", 1.0),
        ("wrong_greens", 0.0),
        ("wrong_reactions", 0.0),
        ("wrong_instructions", 0.0),
    ] {
        assert_eq!(
            (&live["ours"][name], &live["in_virtual_time"][name]),
            (&json!(value), &json!(value)),
            "{name}"
        );
    }
}

#[test]
fn a_fault_of_the_shuttle_over_dds_is_judged_as_in_virtual_time() {
    live("shuttle", "3..3");
}

#[test]
fn a_fault_of_the_robot_over_dds_is_judged_as_in_virtual_time() {
    live("robot", "3..3");
}

/// In a network with its loopback interface down.
#[test]
fn where_dds_is_not_heard_a_live_campaign_says_so() {
    let words = ["evaluate", "--seeds", "2..2", "--live", "1"];
    let output = Command::new("unshare")
        .args(["--user", "--map-root-user", "--net", env!("CARGO_BIN_EXE_telltale")])
        .args(words)
        .output()
        .expect("unshare is installed");
    let (_, log, code) = said(&output);
    assert!(code == Some(2) && log.contains("DDS is not heard here"), "{log}");
}

#[test]
fn seeds_are_a_range() {
    for wrong in ["5", "9..1", "a..b", "1..9999999999"] {
        let output = run(&["evaluate", "--seeds", wrong]);
        assert_eq!(output.status.code(), Some(2), "{wrong}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("seeds"), "{wrong}");
    }
    let (_, log, code) = said(&run(["evaluate", "--seeds", "1..3", "--live", "100"]));
    assert!(code == Some(2) && log.contains("take more seeds"), "{log}");
}
