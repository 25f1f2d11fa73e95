use super::*;

#[test]
fn a_tile_that_is_okay_says_so_with_its_count() {
    let calm = Sample::shuttle(true).published();
    check(
        &calm,
        Lang::En,
        "tile-sensors",
        &[r#"data-state="ok""#, "Sensors", "#i-ok", "4 of 4 okay"],
        &["data-reason"],
    );
    check(&calm, Lang::De, "tile-localization", &["Lokalisierung", "Okay", "4 von 4 okay"], &[]);
}

#[test]
fn a_root_cause_is_an_error_and_what_waits_for_it_says_for_whom() {
    let fault = jump().pass(4).published();
    check(
        &fault,
        Lang::En,
        "tile-localization",
        &[r#"data-state="error""#, "#i-error", "Error", "3 of 4 okay"],
        &[],
    );
    for tile in ["tile-perception", "tile-prediction", "tile-planning", "tile-execution"] {
        let expect =
            [r#"data-state="ignore" data-reason="masked""#, "#i-masked", "Ignored", "waits for Localization"];
        check(&fault, Lang::En, tile, &expect, &["okay", "#i-idle"]);
    }
    check(&fault, Lang::De, "tile-planning", &["Ignoriert", "wartet auf Lokalisierung"], &[]);
}

#[test]
fn what_the_stage_puts_aside_looks_and_reads_otherwise() {
    let standby = Sample::shuttle(false).published();
    let expect = [r#"data-state="ignore" data-reason="not_relevant""#, "#i-idle", "not driving"];
    check(&standby, Lang::En, "tile-planning", &expect, &["#i-masked", "waits for"]);
    check(&standby, Lang::De, "tile-execution", &["Ignoriert", "fährt nicht"], &[]);
}

#[test]
fn a_silent_component_is_unknown_and_never_okay() {
    let silent = Sample::shuttle(false).silence("mission/server").pass(5).published();
    let expect = [r#"data-state="unknown""#, "#i-unknown", "Unknown", "no news"];
    check(&silent, Lang::En, "tile-mission", &expect, &["#i-ok", "okay"]);
    check(&silent, Lang::En, "causes", &[r#"data-node="mission/server""#, "No news: Mission"], &["All"]);
}

#[test]
fn a_warning_keeps_its_count() {
    let low = Sample::shuttle(false).report("can/battery", 1, "18 %", &[]).pass(2).published();
    check(&low, Lang::En, "tile-can", &[r#"data-state="warning""#, "Warning", "1 of 2 okay"], &[]);
    check(&low, Lang::De, "tile-can", &["Warnung", "Fahrzeugbus (CAN)"], &[]);
}

#[test]
fn every_tile_carries_its_cover_in_its_language() {
    let calm = Sample::shuttle(true).published();
    for (lang, word) in [(Lang::En, "Unknown"), (Lang::De, "Unbekannt")] {
        for tile in ["tile-sensors", "tile-execution"] {
            check(&calm, lang, tile, &[r#"class="cover""#, word], &[]);
        }
    }
}
