//! Tests of tiles in each state.

use super::*;

#[test]
fn a_tile_that_is_ok_says_so_with_its_count() {
    let calm = Sample::shuttle(true).published();
    check(
        &calm,
        Lang::En,
        "tile-sensors",
        &[r#"data-state="ok""#, "Sensors", "#i-ok", "4/4 OK"],
        &["data-reason"],
    );
    check(&calm, Lang::De, "tile-localization", &["Lokalisierung", "OK", "4/4 OK"], &[]);
}

#[test]
fn a_root_cause_is_an_error_and_what_waits_for_it_says_for_whom() {
    let fault = jump().pass(4).published();
    check(
        &fault,
        Lang::En,
        "tile-localization",
        &[r#"data-state="error""#, "#i-error", "Error", "3/4 OK"],
        &[],
    );
    for tile in ["tile-perception", "tile-prediction", "tile-planning", "tile-execution"] {
        let expect =
            [r#"data-state="ignore" data-reason="masked""#, "#i-masked", ">Waiting for<", ">Localization<"];
        check(&fault, Lang::En, tile, &expect, &["OK", "#i-idle"]);
    }
    check(&fault, Lang::De, "tile-planning", &[">Wartet auf<", ">Lokalisierung<"], &[]);
}

#[test]
fn what_the_stage_puts_aside_looks_and_reads_otherwise() {
    let standby = Sample::shuttle(false).published();
    let expect = [r#"data-state="ignore" data-reason="not_relevant""#, "#i-idle", "Not active"];
    check(&standby, Lang::En, "tile-planning", &expect, &["#i-masked", "Waiting for"]);
    check(&standby, Lang::De, "tile-execution", &["Nicht aktiv"], &[]);
    check(&standby, Lang::De, "detail-execution", &["fährt nicht"], &[]);
}

#[test]
fn a_silent_component_is_unknown_and_never_ok() {
    let silent = Sample::shuttle(false).silence("mission/server").pass(5).published();
    let expect = [r#"data-state="unknown""#, "#i-unknown", "Unknown", "not reporting"];
    check(&silent, Lang::En, "tile-mission", &expect, &["#i-ok", "OK"]);
    check(
        &silent,
        Lang::En,
        "causes",
        &[r#"data-node="mission/server""#, "Mission not reporting"],
        &["causes-calm"],
    );
}

#[test]
fn a_warning_keeps_its_count() {
    let low = Sample::shuttle(false).report("can/battery", 1, "18 %", &[]).pass(2).published();
    check(&low, Lang::En, "tile-can", &[r#"data-state="warning""#, "Warning", "1/2 OK"], &[]);
    check(&low, Lang::De, "tile-can", &["Warnung", "Fahrzeugbus (CAN)"], &[]);
}
