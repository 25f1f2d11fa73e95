//! Tests of the motion in words and numbers.

use super::*;
use telltale_engine::input::Refusal;
use telltale_engine::model::countermeasure::{Request, RequestKind};
use telltale_engine::model::output::Output;
use telltale_engine::snapshot::{Countermeasure, CountermeasureCause, CountermeasureState, Motion, Moving};
use telltale_engine::state::State;
use telltale_engine::time::{Since, Span};

const SINCE: Since = Since { at: Timestamp::ZERO, before: Span::ZERO };

/// The sample as if this were known of its motion; `destination` is the Main Station.
fn moved(sample: Sample, moving: Moving, speed_kmh: u32) -> Published {
    let published = sample.published();
    let speed_kmh = (moving != Moving::Unknown).then_some(speed_kmh);
    let motion = Motion { moving, speed_kmh, has_source: true, destination: Some(1), ..Motion::default() };
    let snapshot = Snapshot { motion, ..(*published.snapshot).clone() };
    Published { snapshot: snapshot.into(), ..published }
}

#[track_caller]
fn check_motion(published: &Published, lang: Lang, attribute: &str, words: &str) {
    let html = fragment(published, lang, "motion");
    assert!(html.contains(&format!("data-moving=\"{attribute}\"")) && !html.contains("aria-live"), "{html}");
    let text = html.split_once('>').map_or("", |(_, rest)| rest);
    let text: String =
        text.split('<').map(|part| part.split_once('>').map_or(part, |(_, text)| text)).collect();
    assert_eq!(text.trim(), words);
}

#[test]
fn a_vehicle_drives_only_while_it_moves_by_itself() {
    let active = || Sample::shuttle(true);
    check_motion(
        &moved(active(), Moving::Yes, 18),
        Lang::En,
        "yes",
        "Driving · 18\u{a0}km/h · to Main Station",
    );
    check_motion(
        &moved(active(), Moving::Yes, 18),
        Lang::De,
        "yes",
        "Fährt · 18\u{a0}km/h · Ziel: Hauptbahnhof",
    );
    check_motion(&moved(active(), Moving::No, 0), Lang::En, "no", "Standing · next: Main Station");
    check_motion(&moved(active(), Moving::No, 0), Lang::De, "no", "Steht · Ziel: Hauptbahnhof");
    check_motion(&moved(active(), Moving::Unknown, 0), Lang::En, "unknown", "Speed unknown");
    let ready = || Sample::shuttle(false);
    check_motion(&moved(ready(), Moving::Yes, 4), Lang::En, "yes", "Moving · 4\u{a0}km/h");
    check_motion(&moved(ready(), Moving::Yes, 4), Lang::De, "yes", "In Bewegung · 4\u{a0}km/h");
    check_motion(&moved(ready(), Moving::Unknown, 0), Lang::De, "unknown", "Geschwindigkeit unbekannt");
}

#[test]
fn nobody_is_offered_to_log_out_while_the_vehicle_moves() {
    let ready = || Sample::shuttle(false);
    let logout = r#"name="logout""#;
    check(&moved(ready(), Moving::Yes, 4), Lang::En, "step", &[r#"name="stop""#], &[logout]);
    check(&moved(ready(), Moving::No, 0), Lang::En, "step", &[logout], &[]);
    check(&moved(ready(), Moving::Unknown, 0), Lang::En, "step", &[logout], &[]);
}

#[test]
fn a_request_says_what_the_vehicle_does_while_it_moves() {
    let stopping = || Sample::shuttle(true).act(OperatorAction::RequestStop);
    check_motion(&moved(stopping(), Moving::Yes, 9), Lang::En, "yes", "Stopping · 9\u{a0}km/h");
    check_motion(&moved(stopping(), Moving::Yes, 9), Lang::De, "yes", "Hält an · 9\u{a0}km/h");
    check_motion(&moved(stopping(), Moving::No, 0), Lang::En, "no", "Standing · next: Main Station");
    let slowing = Countermeasure {
        request: Request::Decelerate { mps2: 1.0 },
        by_operator: None,
        causes: [].into(),
        about: [].into(),
        since: SINCE,
        state: CountermeasureState::Requested,
        latched: false,
    };
    let driving = moved(Sample::shuttle(true), Moving::Yes, 9);
    let snapshot = Snapshot { countermeasures: [slowing].into(), ..(*driving.snapshot).clone() };
    let slowing = Published { snapshot: snapshot.into(), ..driving };
    check_motion(&slowing, Lang::En, "yes", "Slowing down · 9\u{a0}km/h");
    check_motion(&slowing, Lang::De, "yes", "Bremst · 9\u{a0}km/h");
}

#[test]
fn on_the_way_it_is_said_how_far_the_stop_is_and_how_long_it_takes_as_far_as_that_is_known() {
    let away = |lang, goal_m, goal_min, expect: &str| {
        let driving = moved(Sample::shuttle(true), Moving::Yes, 18);
        let motion = Motion { goal_m, goal_min, ..driving.snapshot.motion };
        let snapshot = Snapshot { motion, ..(*driving.snapshot).clone() };
        let expect = format!("<span class=\"text way\">{expect}</span>");
        let there = if expect.contains("><") { (vec![], vec!["text way"]) } else { (vec![&*expect], vec![]) };
        check(&Published { snapshot: snapshot.into(), ..driving }, lang, "step", &there.0, &there.1);
    };
    away(Lang::En, Some(240), None, "About 240\u{a0}m to go");
    away(Lang::De, Some(240), Some(2), "Noch etwa 240\u{a0}m, 2\u{a0}min");
    away(Lang::De, Some(1200), Some(4), "Noch etwa 1,2\u{a0}km, 4\u{a0}min");
    away(Lang::En, Some(1200), Some(4), "About 1.2\u{a0}km, 4\u{a0}min to go");
    away(Lang::En, None, None, "");
    away(Lang::En, Some(0), None, "");
}

#[test]
fn without_a_source_nothing_is_said_of_driving() {
    check_motion(&Sample::shuttle(true).published(), Lang::En, "unknown", "No speed signal");
    check_motion(&Sample::shuttle(true).published(), Lang::De, "unknown", "Kein Tempo-Signal");
    let machine = || Sample::of(ModelParts { stages: StageModel::None, ..parts() }).pass(2);
    check_motion(&machine().published(), Lang::En, "unknown", "Running");
    check_motion(&machine().published(), Lang::De, "unknown", "In Betrieb");
    check_motion(
        &moved(machine(), Moving::Yes, 4),
        Lang::En,
        "yes",
        "Moving · 4\u{a0}km/h · to Main Station",
    );
    check_motion(&moved(machine(), Moving::Unknown, 0), Lang::En, "unknown", "Speed unknown");
}

/// The shuttle with a request to stop: by the operator, or by a cause that is there still or over.
fn asked_to_stop(moving: Moving, cause_is_there: Option<bool>) -> Published {
    let sample = Sample::shuttle(true);
    asked_to_stop_from(sample, moving, cause_is_there)
}

fn asked_to_stop_from(sample: Sample, moving: Moving, cause_is_there: Option<bool>) -> Published {
    let stopped = moved(sample, moving, 9);
    let node = stopped.snapshot.node("sensors/imu").expect("it is there");
    let cause = |present| CountermeasureCause { node, present, acknowledged: true };
    let held = Countermeasure {
        request: Request::ManeuverStop,
        by_operator: cause_is_there.is_none().then_some(SINCE),
        causes: cause_is_there.map(cause).into_iter().collect(),
        about: [].into(),
        since: SINCE,
        state: CountermeasureState::Engaged,
        latched: true,
    };
    let remains = cause_is_there == Some(true);
    let refusals = remains.then(|| Refusal::CauseRemains { node: "sensors/imu".into() });
    let snapshot = Snapshot {
        countermeasures: [held].into(),
        release_refusals: refusals.into_iter().collect(),
        ..(*stopped.snapshot).clone()
    };
    Published { snapshot: snapshot.into(), ..stopped }
}

#[test]
fn a_vehicle_that_was_stopped_and_stands_is_asked_whether_it_goes_on() {
    let over = |moving| asked_to_stop(moving, Some(false));
    let act = r#"data-urgency="act""#;
    let expect = [
        act,
        ">Steht. Störung vorbei. Weiterfahren?<",
        ">Gehalten<span class=\"since\"> seit <time ",
        "</span>. Vorbei: Bewegungssensor gestört.<",
    ];
    check(&over(Moving::No), Lang::De, "instruction", &expect, &[]);
    let expect = [act, ">Cause gone. Continue?<", ">Stopping for a fault. Over: Motion sensor disturbed.<"];
    check(&over(Moving::Yes), Lang::En, "instruction", &expect, &[]);
}

#[test]
fn only_causes_that_the_list_shows_are_counted() {
    let held = asked_to_stop(Moving::No, Some(true));
    let with = |first: bool, other: bool| {
        let mut measure = held.snapshot.countermeasures[0].clone();
        let node = held.snapshot.node("can/bus").expect("it is there");
        let first = CountermeasureCause { present: first, ..measure.causes[0] };
        measure.causes = [first, CountermeasureCause { node, present: other, ..first }].into();
        let snapshot = Snapshot { countermeasures: [measure].into(), ..(*held.snapshot).clone() };
        Published { snapshot: snapshot.into(), ..held.clone() }
    };
    let of =
        |first, other, lang, expect: &str| check(&with(first, other), lang, "instruction", &[expect], &[]);
    // Two requests have the same component as their cause; it has no status of its own.
    let mut slowed = held.snapshot.countermeasures[0].clone();
    let node = held.snapshot.node("can").expect("it is there");
    slowed.causes = [CountermeasureCause { node, ..slowed.causes[0] }].into();
    let stopped = Countermeasure { request: Request::Decelerate { mps2: 1.0 }, ..slowed.clone() };
    let snapshot = Snapshot { countermeasures: [slowed, stopped].into(), ..(*held.snapshot).clone() };
    let both = Published { snapshot: snapshot.into(), ..held.clone() };
    check(&both, Lang::En, "instruction", &["</span>. CAN.<"], &["more"]);
    of(true, true, Lang::En, ". Motion sensor disturbed (and 1 more).<");
    of(true, true, Lang::De, ". Bewegungssensor gestört (und 1 weitere Störung).<");
    of(true, false, Lang::En, ". Motion sensor disturbed.<");
    of(false, false, Lang::De, ". Vorbei: Bewegungssensor gestört.<");
}

#[test]
fn a_vehicle_that_stands_is_not_said_to_be_on_its_way() {
    let watched = |published: Published| {
        let snapshot = Snapshot { operator: None, ..(*published.snapshot).clone() };
        Published { snapshot: snapshot.into(), ..published }
    };
    let on_its_way = ["On the way", "#i-drive"];
    for seen in [|it| it, watched as fn(Published) -> Published] {
        check(&seen(moved(Sample::shuttle(true), Moving::Yes, 18)), Lang::En, "step", &on_its_way, &[]);
        check(&seen(moved(Sample::shuttle(true), Moving::No, 0)), Lang::En, "step", &[], &on_its_way);
        let held = seen(asked_to_stop(Moving::No, Some(true)));
        check(&held, Lang::En, "step", &[">Held<"], &on_its_way);
    }
}

#[test]
fn to_let_the_vehicle_go_on_is_no_first_step_while_it_still_moves() {
    for (moving, look) in [(Moving::Yes, "side"), (Moving::No, "primary")] {
        let button = format!(r#"class="{look}" name="release""#);
        check(&asked_to_stop(moving, None), Lang::En, "step", &[&button], &[]);
    }
}

#[test]
fn a_vehicle_that_stands_does_not_respond_any_more_it_is_held() {
    let there = |moving| asked_to_stop(moving, Some(true));
    check(&there(Moving::No), Lang::En, "step", &[">Held<", ">until the cause is gone<"], &["responds"]);
    check(&there(Moving::Yes), Lang::En, "step", &[">The vehicle responds<"], &["Held", "until the cause"]);
}

#[test]
fn a_stop_of_the_operator_has_no_cause_to_wait_for() {
    for moving in [Moving::Yes, Moving::No] {
        let stop = asked_to_stop(moving, None);
        check(&stop, Lang::En, "causes", &[r#"data-good="true""#, "components OK"], &["Held until"]);
        check(&stop, Lang::En, "step", &[r#"name="release""#], &["until the cause"]);
    }
}

#[test]
fn no_warning_says_that_one_may_go_on_while_the_vehicle_is_stopped() {
    let warned = || Sample::shuttle(true).report("can/battery", 1, "18 %", &[]).pass(3);
    let advice = "You may go on. Stay alert.";
    check(&moved(warned(), Moving::Yes, 9), Lang::En, "causes", &["Battery is low", advice], &[]);
    for moving in [Moving::Yes, Moving::No] {
        for cause_is_there in [true, false] {
            let stopping = asked_to_stop_from(warned(), moving, Some(cause_is_there));
            check(&stopping, Lang::En, "causes", &["Battery is low"], &[advice]);
        }
    }
}

#[test]
fn an_error_that_is_over_keeps_its_name_while_a_warning_is_left_of_it() {
    let left = || Sample::shuttle(true).report("sensors/imu", 1, "noisy", &[]).pass(3);
    for (moving, question) in [(Moving::Yes, ">Continue?<"), (Moving::No, ">Stopped. Continue?<")] {
        let over = asked_to_stop_from(left(), moving, Some(false));
        let expect = [question, "Over: Motion sensor disturbed."];
        check(&over, Lang::En, "instruction", &expect, &["Cause gone"]);
    }
}

#[test]
fn a_stop_of_the_operator_is_no_fault_that_is_gone() {
    let over = asked_to_stop(Moving::No, Some(false));
    let held = Countermeasure { by_operator: Some(SINCE), ..over.snapshot.countermeasures[0].clone() };
    let snapshot = Snapshot { countermeasures: [held].into(), ..(*over.snapshot).clone() };
    let stopped = Published { snapshot: snapshot.into(), ..over };
    check(&stopped, Lang::En, "instruction", &[">Stopped. Continue?<", ">STOP pressed"], &["Cause gone"]);
}

#[test]
fn two_requests_that_hold_the_vehicle_are_one_check() {
    let ready = Sample::shuttle(false).published();
    let held = [RequestKind::ManeuverStop, RequestKind::Decelerate].map(Refusal::Countermeasure);
    let snapshot = Snapshot { clearance_refusals: held.into(), ..(*ready.snapshot).clone() };
    let html = fragment(&Published { snapshot: snapshot.into(), ..ready }, Lang::En, "step");
    assert_eq!(html.matches("The vehicle is still held").count(), 1, "{html}");
}

#[test]
fn what_holds_the_vehicle_is_one_sentence_and_the_operators_own_stop_another() {
    let held = asked_to_stop(Moving::No, Some(true));
    let mut slowed = held.snapshot.countermeasures[0].clone();
    slowed.request = Request::Decelerate { mps2: 1.0 };
    slowed.causes = [CountermeasureCause {
        node: held.snapshot.node("can/bus").expect("it is there"),
        ..slowed.causes[0]
    }]
    .into();
    let mut own = held.snapshot.countermeasures[0].clone();
    (own.by_operator, own.causes) = (Some(SINCE), [].into());
    let of = |all: Vec<Countermeasure>| {
        let snapshot = Snapshot { countermeasures: all.into(), ..(*held.snapshot).clone() };
        let published = Published { snapshot: snapshot.into(), ..held.clone() };
        fragment(&published, Lang::En, "instruction").matches("Held<span").count()
    };
    assert_eq!(of(vec![held.snapshot.countermeasures[0].clone(), slowed.clone()]), 1);
    assert_eq!(of(vec![own.clone(), slowed]), 1);
    assert_eq!(of(vec![own]), 0, "its own sentence says it");
}

#[test]
fn a_stop_is_offered_in_every_stage_as_long_as_the_vehicle_moves_or_may() {
    let stop = r#"name="stop""#;
    let localizing = || Sample::of(parts()).login().signal("active", false).pass(5);
    for (name, sample) in
        [("localizing", localizing as fn() -> Sample), ("standby", || Sample::shuttle(false))]
    {
        for moving in [Moving::Yes, Moving::Unknown] {
            let step = fragment(&moved(sample(), moving, 1), Lang::En, "step");
            assert!(step.contains(stop), "{name} {moving:?}: {step}");
        }
        let stands = fragment(&moved(sample(), Moving::No, 0), Lang::En, "step");
        assert!(!stands.contains(stop), "{name}: {stands}");
        let deaf = sample().listeners(Output::ManeuverStop, false);
        check(&moved(deaf, Moving::Yes, 1), Lang::En, "step", &[], &[stop]);
    }
    // Beside the step of the stage.
    check(&moved(Sample::shuttle(false), Moving::Yes, 1), Lang::En, "step", &[r#"name="clearance""#], &[]);
    check(&Sample::shuttle(false).published(), Lang::En, "step", &[], &[stop]);
}

#[test]
fn the_operators_own_stop_is_named_first_and_its_button_is_latched_with_its_time() {
    let both = asked_to_stop(Moving::Yes, Some(true));
    let mut measure = both.snapshot.countermeasures[0].clone();
    measure.by_operator = Some(SINCE);
    let snapshot = Snapshot { countermeasures: [measure].into(), ..(*both.snapshot).clone() };
    let both = Published { snapshot: snapshot.into(), ..both };
    let instruction = fragment(&both, Lang::En, "instruction");
    let place = |text: &str| instruction.find(text).unwrap_or_else(|| panic!("{text}: {instruction}"));
    assert!(
        place(">STOP pressed<span class=\"since\"> <time ")
            < place("Stopping for a fault. Motion sensor disturbed.")
    );
    let latched = [r#"aria-pressed="true""#, r#"if-asked">gedrückt <time class="clock""#];
    check(&both, Lang::De, "step", &latched, &[]);
}

#[test]
fn after_a_restart_it_is_said_since_when_and_why_before_anything_is_heard() {
    let held = |moving| {
        let slowing = asked_to_stop(moving, Some(true));
        let node = slowing.snapshot.node("sensors/imu").expect("it is there");
        let telltale_engine::model::NodeId::Module(id) = node else { panic!("it is a module") };
        let mut modules = slowing.snapshot.modules.clone();
        let module = modules.get_mut(id.0 as usize).expect("it is there");
        (module.received, module.silent, module.own) = (None, false, State::Unknown);
        let mut measure = slowing.snapshot.countermeasures[0].clone();
        measure.since.before = Span::from_secs(90);
        let snapshot = Snapshot { countermeasures: [measure].into(), modules, ..(*slowing.snapshot).clone() };
        Published { snapshot: snapshot.into(), ..slowing }
    };
    let why = ". Motion sensor disturbed, not heard again yet.";
    check(
        &held(Moving::No),
        Lang::En,
        "instruction",
        &[">Held<span class=\"since\"> since <time ", why],
        &[],
    );
    check(
        &held(Moving::Unknown),
        Lang::En,
        "instruction",
        &[">Stopping for a fault<span", "since <time ", why],
        &[],
    );
}
