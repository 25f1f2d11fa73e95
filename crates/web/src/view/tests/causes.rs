//! Tests of the list of faults.

use super::*;
use telltale_engine::input::Input;

#[test]
fn a_root_cause_stands_with_what_to_do_and_how_many_wait() {
    let fault = jump().pass(4).published();
    let expect = [
        r#"data-node="localization/tf_quality""#,
        r#"data-state="error""#,
        "Position jumped",
        r#"Localization<span class="lasted">, </span>"#,
        "4 parts wait.",
        r#"<time datetime="2026-11-20T12:01:01Z""#,
    ];
    check(&fault, Lang::En, "causes", &expect, &["causes-calm", "costmap", "1.2 m", "Watch the road"]);
    check(&fault, Lang::De, "causes", &["Position ist gesprungen", "4 Teile warten."], &[]);
    let expect = ["Watch the road. Be ready to stop.", "Position jumped."];
    check(&fault, Lang::En, "instruction", &expect, &[]);
    let expect = ["Straße beobachten. Bremsbereit sein.", "Position ist gesprungen."];
    check(&fault, Lang::De, "instruction", &expect, &[]);
}

#[test]
fn roots_come_first_and_all_are_counted() {
    let many = jump()
        .report("can/battery", 1, "18 %", &[])
        .report("sensors/gnss", 1, "4 satellites", &[])
        .silence("mission/server")
        .pass(5)
        .published();
    let html = fragment(&many, Lang::En, "causes");
    let order: Vec<_> =
        html.split("data-node=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    assert_eq!(order, ["localization/tf_quality", "mission/server", "sensors/gnss", "can/battery"]);
    assert!(html.contains(r#"data-fit="causes-more" data-count="4""#), "{html}");
}

#[test]
fn all_ok_is_said_only_when_it_is_true() {
    let calm = Sample::shuttle(true).published();
    check(&calm, Lang::En, "causes", &["All 8 components OK", r#"data-good="true""#], &["data-node"]);
    let standby = Sample::shuttle(false).published();
    check(&standby, Lang::De, "causes", &["Alle 6 aktiven Komponenten OK"], &[]);
    let start = Sample::of(parts()).login().published();
    check(&start, Lang::En, "causes", &["data-node"], &["OK"]);
}

#[test]
fn what_the_diagnosis_says_of_itself_is_heard() {
    let trouble = Sample::shuttle(true)
        .trouble("/diagnostics", TroubleKind::Malformed, 1, "string runs past the end")
        .published();
    let expect = [r#"data-node="telltale/reception""#, "Messages get lost"];
    check(&trouble, Lang::En, "causes", &expect, &["causes-calm", "panel-"]);
    assert!(!operator_page(&trouble, &context(Lang::En, Palette::Night)).contains("tile-telltale"));
}

#[test]
fn an_operator_reads_no_topics_and_settings() {
    let mut doubled = Sample::of(parts()).login().pass(5);
    doubled.input(&Input::Aggregator { other: Some("/diagnostics_agg: /other_aggregator".into()) });
    let doubled = doubled.pass(1).published();
    check(&doubled, Lang::En, "causes", &["Diagnosis is published twice"], &["diagnostics_agg"]);
    check(&doubled, Lang::De, "causes", &["Diagnose wird doppelt veröffentlicht"], &["diagnostics_agg"]);
}

#[test]
fn many_of_one_kind_in_one_component_are_one_entry() {
    let start = Sample::of(parts()).login().published();
    check(&start, Lang::En, "causes", &[r#"data-node="sensors""#, "4 × Unknown"], &["gnss"]);
}

#[test]
fn an_empty_component_is_named_because_nothing_inside_explains_it() {
    let parts = ModelParts {
        groups: vec![group("a", Text::plain("Alpha")), group("b", Text::plain("Beta"))],
        modules: vec![module("a", 0, "x")],
        signals: Vec::new(),
        stages: StageModel::None,
        ..parts()
    };
    let empty = Sample::of(parts).pass(3).published();
    check(&empty, Lang::En, "causes", &[r#"data-node="b""#, "Beta"], &["causes-calm"]);
    check(&empty, Lang::En, "tile-b", &[r#"data-state="unknown""#, "nothing to watch"], &[]);
}

#[test]
fn what_is_outside_of_the_configuration_is_one_quiet_line_or_a_component() {
    use telltale_engine::model::Other;
    let stray = |other| {
        let standing = Sample::of(ModelParts { other, ..parts() }).login().signal("active", false).pass(5);
        standing.localize("depot").pass(5).report("stray", 2, "gone mad", &[]).pass(3).published()
    };
    let line = r#"class="aside">1 error outside of the configuration<"#;
    check(
        &stray(Other::Shown),
        Lang::En,
        "causes",
        &[line, "active components OK", "alarms=\"\""],
        &["data-node"],
    );
    let line = "1 Fehler außerhalb der Konfiguration";
    check(&stray(Other::Shown), Lang::De, "causes", &[line], &[]);
    check(&stray(Other::Hidden), Lang::En, "causes", &["active components OK"], &["outside", "stray"]);
    let counted = stray(Other::Counted);
    check(&counted, Lang::En, "causes", &[r#"data-node="other/stray""#, r#"alarms="1""#], &["outside"]);
    check(&counted, Lang::En, "tile-other", &[r#"data-state="error""#], &[]);
    // The others stay where the configuration puts them.
    let places = |published: &Published| Board::of(&published.snapshot.layout).places;
    let (without, with) = (places(&stray(Other::Shown)), places(&counted));
    assert_eq!(with[..without.len()], without);
    assert!(!without.contains(with.last().expect("there are some")));
    let quiet = Sample::of(ModelParts { other: Other::Counted, ..parts() }).login().pass(5).published();
    check(&quiet, Lang::En, "tile-other", &[r#"data-state="ok""#, "none there"], &[]);
}
