//! Tests of the page in each stage of the vehicle.

use super::*;
use telltale_engine::snapshot::{Layout, NotRelevant};

#[test]
fn a_locked_vehicle_shows_nothing_of_itself() {
    let locked = Sample::of(parts()).report("can/bus", 2, "bus off", &[]).pass(5).published();
    let fragments = fragments(&locked, Lang::En);
    assert_eq!(fragments.len(), 1);
    let page = operator_page(&locked, &context(Lang::En, Palette::Night));
    let developer = crate::developer::tests::pages(&locked, &context(Lang::En, Palette::Night), "");
    // A change that waits in the configuration's file is no diagnosis.
    let developer = developer.iter().filter(|(page, _)| *page != "configuration").map(|(_, html)| html);
    for html in [&fragments[0].html, &page].into_iter().chain(developer) {
        assert!(html.contains(r#"data-stage="locked""#));
        for secret in ["can", "bus", "Sensors", "sensors", "tile", "error"] {
            assert!(!words_of(html).contains(secret), "{secret}: {html}");
        }
    }
    assert!(page.contains(r#"name="name""#) && page.contains(r#"name="secret""#));
}

/// The page without the names of icons and files, which say nothing of the vehicle.
fn words_of(html: &str) -> String {
    let body = html.split("</symbol>").last().unwrap_or_default();
    body.replace("data-overall", "")
}

#[test]
fn the_stage_is_said_in_words_and_only_what_works_has_a_button() {
    let ready = Sample::shuttle(false).published();
    check(&ready, Lang::En, "top", &[r#"data-stage="standby""#, "Ready", "Shuttle 1", "operator"], &[]);
    let expect = [
        r#"name="clearance""#,
        "Give clearance",
        "Destination set",
        "Nothing holds the vehicle",
        r#"name="logout""#,
    ];
    check(&ready, Lang::En, "step", &expect, &["aria-disabled", r#"name="stop""#]);
    let driving = Sample::shuttle(true).published();
    check(&driving, Lang::De, "top", &[r#"data-stage="active""#, "Autonom"], &[]);
    check(&driving, Lang::En, "step", &[r#"name="stop""#, "On the way"], &["logout"]);
    let broken = Sample::shuttle(false).report("can/bus", 2, "bus off", &[]).pass(1).published();
    check(&broken, Lang::En, "top", &["Not ready"], &[]);
    let expect = ["aria-disabled", "CAN: error", r#"data-nodes="can""#, "Destination set"];
    check(&broken, Lang::En, "step", &expect, &["components ready"]);
}

#[test]
fn other_reasons_have_words_of_their_own() {
    let mut parts = parts();
    parts.groups[3].when = Some(When { stages: vec![Stage::Localizing], ..When::default() });
    parts.groups[5].when = Some(When { stages: vec![Stage::Active], ..When::default() });
    let standby = Sample::of(parts).login().signal("active", false).pass(5).published();
    check(&standby, Lang::En, "detail-prediction", &["not driving"], &["Standby", "standby"]);
    check(&standby, Lang::De, "detail-mission", &["fährt nicht"], &[]);
}

#[test]
fn a_signal_is_called_as_the_configuration_says() {
    let named = ("navigating".into(), text("on its way", "unterwegs"));
    let published = Sample::shuttle(false).published();
    let layout = Layout { signal_titles: [named].into(), ..Layout::clone(&published.snapshot.layout) };
    for (name, value, en, de) in [
        ("navigating", false, "not on its way", "nicht unterwegs"),
        ("navigating", true, "on its way", "unterwegs"),
        ("docked", false, "docked is off", "docked ist aus"),
    ] {
        let because = NotRelevant::Signal { name: name.into(), value };
        assert_eq!(Lang::En.not_relevant(&because, &layout), en);
        assert_eq!(Lang::De.not_relevant(&because, &layout), de);
    }
}

#[test]
fn the_way_from_the_login_to_the_drive_has_one_step_at_a_time() {
    let login = Sample::of(parts()).unlock().pass(3).published();
    check(&login, Lang::De, "step", &[r#"value="station""#, "Hauptbahnhof"], &[]);
    let expect = ["Wo steht das Fahrzeug?", r#"data-urgency="act""#];
    check(&login, Lang::De, "instruction", &expect, &[]);
    let locating = Sample::of(parts()).unlock().pass(3).localize("station").pass(1);
    check(
        &locating.published(),
        Lang::En,
        "step",
        &["Checking the position: Main Station", "Choose again"],
        &[],
    );
    let clear = OperatorAction::Clear { display_live: true, storage_ok: true };
    let cleared = Sample::shuttle(false).act(clear).published();
    check(
        &cleared,
        Lang::En,
        "step",
        &["logout", r#"name="stop""#, r#"name="withdraw""#],
        &[r#"name="clearance""#],
    );
    check(&cleared, Lang::En, "instruction", &["It may start at any moment."], &["data-blocked"]);
    let stopping = Sample::shuttle(true).act(OperatorAction::RequestStop).published();
    check(
        &stopping,
        Lang::En,
        "step",
        &[r#"name="release""#, r#"name="stop""#, r#"aria-pressed="true""#],
        &[],
    );
    check(
        &stopping,
        Lang::En,
        "instruction",
        &[r#"data-request="maneuver_stop""#, "Asked to stop safely", "Stop requested"],
        &[],
    );
}

#[test]
fn what_still_has_time_to_report_calls_nobody_at_a_stop() {
    const NEW: &str = "planning/planner_submitted";
    let mut parts = parts();
    parts.groups[6].when = Some(When { stages: vec![Stage::Standby], ..When::default() });
    let standing = || Sample::of(parts.clone()).silence(NEW).unlock().pass(3).localize("depot");
    let entered = (1..20).map(|seconds| standing().pass(seconds));
    let mut entered = entered.map(Sample::published);
    let new = entered.find(|it| it.snapshot.stage == Stage::Standby).expect("it is localized");
    check(&new, Lang::En, "tile-planning", &[r#"data-state="unknown""#], &[]);
    check(
        &new,
        Lang::En,
        "instruction",
        &[r#"data-urgency="none""#, "Wait."],
        &["data-blocked", "control room"],
    );
    check(&new, Lang::En, "causes", &[r#"data-node="planning/"#], &["control room"]);
    let late = entered.nth(4).expect("time passes");
    check(&late, Lang::En, "instruction", &[r#"data-urgency="act""#, "Wait for its report."], &[]);
}

#[test]
fn a_localization_that_measures_nothing_yet_calls_nobody_until_it_is_late() {
    let searching = || {
        let sample =
            Sample::of(parts()).unlock().pass(3).report("localization/tf_quality", 3, "no jump yet", &[]);
        sample.localize("depot")
    };
    let new = searching().pass(2).published();
    check(&new, Lang::En, "tile-localization", &[r#"data-state="unknown""#], &[]);
    check(
        &new,
        Lang::En,
        "instruction",
        &[r#"data-urgency="none""#],
        &["data-blocked", "Wait for its report"],
    );
    let late = searching().pass(12).published();
    check(&late, Lang::En, "instruction", &[r#"data-urgency="act""#, "Wait for its report."], &[]);
    let other = searching().report("sensors/imu", 3, "no rate", &[]).pass(2).published();
    check(&other, Lang::En, "instruction", &[r#"data-urgency="act""#, "Wait for its report."], &[]);
    let silent =
        Sample::of(parts()).unlock().pass(5).localize("depot").pass(1).silence("localization/tf_quality");
    check(&silent.pass(4).published(), Lang::En, "instruction", &[r#"data-urgency="act""#], &[]);
}

#[test]
fn each_fault_has_its_own_acknowledgement() {
    let fault = jump().pass(4);
    let number = r#"/alarms/1/acknowledge"#;
    check(&fault.published(), Lang::En, "causes", &[number, "data-waiting", r#"data-alarms="1""#], &[]);
    let noted = jump().pass(4).act(OperatorAction::Acknowledge { alarm: AlarmRef::Number(1) });
    check(
        &noted.published(),
        Lang::En,
        "causes",
        &["Position jumped", "class=\"seen\"", "class=\"clock\""],
        &["acknowledge", "data-waiting"],
    );
    let over = jump().pass(4).report("localization/tf_quality", 0, "fine", &[]).pass(4);
    check(
        &over.published(),
        Lang::En,
        "causes",
        &["data-past=", "Over", "lasted 4\u{a0}s", number, "All 8"],
        &["data-node", "acknowledge-over"],
    );
    let warned = Sample::shuttle(false).report("can/battery", 1, "18 %", &[]).pass(2);
    check(&warned.published(), Lang::En, "causes", &["/alarms/can/battery/acknowledge"], &[]);
}
