//! Tests of the panels behind tiles.

use std::sync::Arc;

use super::*;
use telltale_engine::input::Input;
use telltale_engine::model::MonitorSpec;
use telltale_engine::model::filter::Filter;
use telltale_engine::model::monitors::{
    Bands, FieldKind, FieldSpec, TopicId, TopicSpec, ValueRule, ValueSource,
};
use telltale_engine::model::sample::{FieldValue, Sample as Message};
use telltale_engine::time::Span;

#[test]
fn behind_a_masked_tile_stand_its_own_errors_and_the_way_to_the_cause() {
    let fault = jump()
        .report("perception/costmap_delay", 2, "350 ms", &[("delay_ms", "350")])
        .report("perception/object_tracking", 2, "0 tracks", &[])
        .pass(4)
        .published();
    let expect = [
        "Waiting for Localization",
        "Localization",
        "Position jumped",
        "350 ms",
        "itself: Error",
        "delay_ms",
    ];
    check(&fault, Lang::En, "detail-perception", &expect, &[]);
    check(&fault, Lang::De, "detail-perception", &["selbst: Fehler"], &[]);
}

#[test]
fn the_name_of_a_fault_never_stands_beside_ok() {
    let calm = Sample::shuttle(true).published();
    check(&calm, Lang::En, "detail-execution", &["steering", "brake"], &["does not follow"]);
}

#[test]
fn the_worst_stands_first_and_the_list_is_bounded() {
    let mut parts = parts();
    parts.modules.extend((0..100).map(|index| module("can", 4, &format!("extra_{index}"))));
    let many = Sample::of(parts).login().report("can/extra_99", 2, "broken", &[]).pass(3).published();
    let html = fragment(&many, Lang::En, "detail-can");
    let first = html.split("data-module=\"").nth(1).unwrap_or_default();
    assert!(first.starts_with("can/extra_99"), "{first}");
    assert_eq!(html.matches("data-module").count(), 40);
    assert!(html.contains("and 62 more"));
}

#[test]
fn an_error_that_is_held_offers_its_reset_and_says_when_it_is_refused() {
    let mut parts = parts();
    let held = parts.modules.iter_mut().find(|module| &*module.id == "can/bus").expect("it is there");
    held.policy.latch = Some(Span::from_secs(1));
    let standing = Sample::of(parts).login().signal("active", false).pass(5);
    let fault = standing.report("can/bus", 2, "no frames", &[]).pass(6);
    let over = Sample::of(self::parts()).login().pass(5);
    check(&over.published(), Lang::En, "detail-can", &[], &["Held", "/reset"]);

    let mut fault = fault;
    let during = Published::recorded(fault.snapshot(), SystemTime::UNIX_EPOCH + Duration::from_secs(86_400));
    let expect = ["Held until reset", r#"action="/modules/can/bus/reset""#, r#"aria-disabled="true""#];
    check(&during, Lang::En, "detail-can", &expect, &[]);

    let mut over = fault.report("can/bus", 0, "fine", &[]).pass(6);
    let after = Published::recorded(over.snapshot(), SystemTime::UNIX_EPOCH + Duration::from_secs(86_400));
    check(&after, Lang::De, "detail-can", &["Gehalten bis zum Zurücksetzen", "/reset"], &["aria-disabled"]);
    check(&after, Lang::En, "instruction", &["Over.", "Held until reset: touch here."], &["Take over."]);
    let reset = OperatorAction::Reset { module: "can/bus".into() };
    check(&over.act(reset).pass(1).published(), Lang::En, "detail-can", &[], &["Held", "/reset"]);
}

#[test]
fn numbers_of_the_last_minutes_are_drawn_within_bounds() {
    let mut parts = parts();
    parts.modules.extend((0..100).map(|index| module("can", 4, &format!("extra_{index}"))));
    let trends = Trends::default();
    let mut sample = Sample::of(parts).login();
    for value in ["1.5", "2.5", "4.0"] {
        let values: Vec<(&str, &str)> = ["a", "b", "c", "d", "word"]
            .map(|key| (key, if key == "word" { "high" } else { value }))
            .to_vec();
        sample = sample.report("can/battery", 2, "low", &values).pass(3);
        trends.sample(&Published::recorded(sample.snapshot(), SystemTime::UNIX_EPOCH));
    }
    let published = sample.published();
    let seen = Versions::default().observe(&published);
    let all = super::super::fragments(&published, &seen, Lang::En, &trends);
    let html = all.into_iter().find(|it| it.id == "detail-can").expect("it is there").html;
    assert!(html.contains(r#"aria-label="a: 1.5 – 4, last 5 minutes""#), "{html}");
    let battery = html.split("</li>").next().unwrap_or_default();
    assert_eq!(battery.matches("class=\"spark\"").count(), 3, "{battery}");
    assert!(html.matches("class=\"spark\"").count() <= 36, "{html}");
}

#[test]
fn measured_values_have_the_units_of_their_messages() {
    let mut parts = parts();
    let battery = Arc::new(TopicSpec {
        topic: "/battery".into(),
        type_name: "sensor_msgs/msg/BatteryState".into(),
        stamp: false,
        fields: vec![FieldSpec::new("percentage", FieldKind::Scalar)],
    });
    parts.watched.topics.push(battery.clone());
    let source = ValueSource::Field { topic: TopicId(0), field: 0 };
    let bands = Bands { warning_below: Some(0.2), ..Bands::default() };
    let module = parts.modules.iter_mut().find(|module| &*module.id == "can/battery").expect("it is there");
    module.monitor = MonitorSpec::Value { source, rule: ValueRule::Bands(bands), empty: None }.into();
    let mut sample = Sample::of(parts).login().pass(5);
    let values = [FieldValue::Number(0.1746)].into();
    let (stamp_ns, received_wall_ns, late) = (None, 0, false);
    sample.input(&Input::Sample(Message {
        stamp_ns,
        received_wall_ns,
        late,
        ..Message::of(battery, values)
    }));
    let low = sample.pass(1).published();
    check(
        &low,
        Lang::En,
        "detail-can",
        &["17.5 %, at least 20 % wanted"],
        &["0.17", "<span>value</span> 17.5 %"],
    );
    check(
        &low,
        Lang::De,
        "detail-can",
        &["17,5 %, erwartet mindestens 20 %"],
        &["0.17", "0,17", "<span>Wert</span>"],
    );
}

#[test]
fn an_empty_tile_says_which_name_looks_as_if_it_should_match() {
    let mut parts = parts();
    let can = parts.groups.iter().position(|group| &*group.path == "can").expect("it is there");
    parts.modules.retain(|module| module.group != GroupId(can as u32));
    parts.groups[can].filters = vec![Filter::Contains("kamera".into()).into()];
    let found = Sample::of(parts).login().report("Kamara: rate", 0, "fine", &[]).pass(3).published();
    let said = "nothing matches; `Kamara: rate` in other looks alike";
    check(&found, Lang::En, "tile-can", &[said], &["nothing to watch"]);
    check(&found, Lang::De, "detail-can", &["nichts passt; `Kamara: rate`"], &[]);
}
