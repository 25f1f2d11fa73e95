//! Tests of texts: at each level, in each stage, of silent modules, and of one status at several places.

use super::*;
use telltale_engine::input::Input;
use telltale_engine::model::output::Output;
use telltale_engine::model::wording::{ByStage, Wording};
use telltale_engine::model::{ModuleMonitor, Policy, Stage};
use telltale_engine::state::State;

/// The module's silence counts as an ERROR.
fn stale_is_error(name: &str) -> ModelParts {
    let mut parts = parts();
    let module = parts.modules.iter_mut().find(|module| &*module.id == name).unwrap();
    module.policy = Policy { stale: State::Error, ..Policy::default() };
    parts
}

fn driving(parts: ModelParts) -> Sample {
    let standing = Sample::of(parts).login().signal("active", false).pass(5).localize("depot");
    standing.pass(5).signal("active", true).pass(5)
}

const CAMERA: &str = "sensors/camera_front";

fn silent_camera() -> Published {
    let sample = driving(stale_is_error(CAMERA)).report(CAMERA, 0, "Images arrive", &[]);
    sample.pass(1).silence(CAMERA).pass(4).published()
}

#[test]
fn a_silent_module_says_so_before_its_last_words() {
    let silent = silent_camera();
    let counts = r#"<time datetime="2026-11-20T12:00:16Z" hx-morph-skip-children></time>"#;
    let english = format!(r#"<span aria-live="off">silent for {counts}</span>; last: Images arrive"#);
    let german = format!(r#"<span aria-live="off">seit {counts} still</span>; zuletzt: Images arrive"#);
    check(&silent, Lang::En, "detail-sensors", &[&english], &[]);
    check(&silent, Lang::De, "detail-sensors", &[&german], &[]);
    check(&silent, Lang::En, "causes", &["silent for <time"], &["Images arrive"]);
    let id = match silent.snapshot.node(CAMERA) {
        Some(telltale_engine::model::NodeId::Module(id)) => id,
        other => panic!("{other:?}"),
    };
    let view = View::new(&silent, Lang::En, false);
    let (_, module) = silent.snapshot.module(id);
    assert_eq!(view.message_text(module), "silent for 4 s; last: Images arrive");
    assert_eq!(module.says(silent.snapshot.now), "silent for 4 s; last: Images arrive");
    let german = View::new(&silent, Lang::De, false).message_text(module);
    assert_eq!(german, "seit 4 s still; zuletzt: Images arrive");
}

#[test]
fn what_is_unknown_while_dds_is_down_says_so_before_its_last_words() {
    let mut sample = driving(parts());
    sample.input(&Input::Dds { fault: Some("killed".into()) });
    let cut = sample.published();
    let english = "nothing received since the connection to the vehicle failed; last: running";
    let german = "nichts empfangen, seit die Verbindung zum Fahrzeug ausfiel; zuletzt: running";
    check(&cut, Lang::En, "detail-sensors", &[english], &[]);
    check(&cut, Lang::De, "detail-sensors", &[german], &[]);
}

#[test]
fn the_developers_filter_finds_the_words_that_are_shown() {
    let silent = silent_camera();
    let found = |lang, text: &str| {
        let asked = crate::developer::tests::query(&[("q", text)]);
        let page = crate::developer::statuses::page(
            &silent,
            &context(lang, Palette::Day),
            &asked,
            &Trends::default(),
        );
        page.contains("Images arrive")
    };
    for (lang, text) in [
        (Lang::En, "SILENT for 4 s"),
        (Lang::De, "seit 4 s still"),
        (Lang::En, "last: images"),
        (Lang::En, "images arrive"),
        (Lang::De, "Fehler"),
    ] {
        assert!(found(lang, text), "{text}");
    }
    assert!(!found(Lang::En, "still") && !found(Lang::En, "Fehler") && !found(Lang::En, "no such words"));
}

#[test]
fn what_is_unknown_for_its_silence_says_so_and_grows_no_fragment() {
    let quiet = Sample::shuttle(true).silence("mission/server").pass(5);
    let expect = ["Mission not reporting", "silent for <time"];
    let early = quiet.published();
    check(&early, Lang::En, "causes", &expect, &[]);
    // The page counts on by itself: seconds make no new fragment.
    let late = Sample::shuttle(true).silence("mission/server").pass(15).published();
    assert_eq!(fragment(&early, Lang::En, "causes"), fragment(&late, Lang::En, "causes"));
    assert_eq!(fragment(&early, Lang::De, "detail-mission"), fragment(&late, Lang::De, "detail-mission"));
}

#[test]
fn what_never_reported_says_that() {
    let mut sample = Sample::of(stale_is_error("sensors/imu")).login().silence("sensors/imu").pass(5);
    let shown = sample.snapshot();
    assert_eq!(shown.shown(shown.node("sensors/imu").unwrap()).0, State::Error);
    check(&sample.published(), Lang::En, "causes", &["has not reported yet"], &["silent"]);
}

#[test]
fn a_warning_has_no_words_of_the_error() {
    let warned = Sample::shuttle(true).report("can/bus", 1, "50 Hz", &[]).pass(1).published();
    let expect = ["No connection to the vehicle", "You may go on. Stay alert."];
    check(&warned, Lang::En, "causes", &expect, &["Take over", "50 Hz"]);
    check(&warned, Lang::En, "detail-can", &["50 Hz"], &[]);
    let mut parts = parts();
    let bus = parts.modules.iter_mut().find(|module| &*module.id == "can/bus").unwrap();
    let always = |text: &str| ByStage::Always(text.into());
    bus.name = Some(
        Wording {
            ok: always("Vehicle data"),
            warning: always("Bus slow"),
            unknown: always("Bus unknown"),
            ..Wording::default()
        }
        .into(),
    );
    let advice = ByStage::Always(Text::plain("Drive on.").into());
    bus.help = Some(Wording { warning: advice, ..Wording::default() }.into());
    let of = |level| driving(parts.clone()).report("can/bus", level, "m", &[]).pass(1).published();
    check(&of(1), Lang::En, "causes", &["Bus slow", "Drive on."], &["You may go on"]);
    check(&of(2), Lang::En, "causes", &["CAN: Error"], &["Bus slow", "Drive on."]);
    check(&of(2), Lang::En, "instruction", &["Be ready to take over.", "CAN: Error."], &["Drive on."]);
    check(&of(3), Lang::De, "causes", &["Bus unknown"], &["Drive on."]);
    check(&of(3), Lang::De, "instruction", &["Zum Übernehmen bereithalten."], &["Drive on."]);
    check(&of(1), Lang::En, "detail-can", &["Bus slow"], &["Vehicle data"]);
    check(&of(0), Lang::En, "detail-can", &[r#"Vehicle data <span class="label">bus</span>"#], &["Bus slow"]);
}

#[test]
fn nobody_is_told_to_take_over_at_a_stop() {
    const DRIVING: [&str; 8] = [
        "Take over",
        "Watch the road",
        "take over",
        "Be ready",
        "Übernehmen",
        "übernehmen",
        "Straße beobachten",
        "Bremsbereit",
    ];
    for level in [1, 2, 3] {
        let standing = Sample::shuttle(false).report("sensors/camera_front", level, "m", &[]).pass(1);
        let published = standing.published();
        assert_eq!(published.snapshot.stage, Stage::Standby);
        for lang in Lang::ALL {
            check(&published, lang, "causes", &[], &DRIVING);
            check(&published, lang, "instruction", &[r#"data-urgency="act""#], &DRIVING);
        }
        let mut localizing = Sample::of(parts()).unlock().report("sensors/imu", level, "m", &[]).pass(5);
        assert_eq!(localizing.snapshot().stage, Stage::Localizing);
        let published = localizing.published();
        for lang in Lang::ALL {
            check(&published, lang, "causes", &[r#"<strong class="help">"#], &DRIVING);
            check(&published, lang, "instruction", &[], &DRIVING);
        }
    }
    let driving = Sample::shuttle(true).report("sensors/camera_front", 2, "m", &[]).pass(1).published();
    let expect = [r#"data-urgency="be_ready""#, "Watch the road. Be ready to stop."];
    check(&driving, Lang::En, "instruction", &expect, &[]);
    check(&driving, Lang::En, "causes", &["Front camera"], &["Watch the road"]);
}

#[test]
fn a_departure_asks_for_nothing_while_components_have_time_to_report() {
    const UNHEARD: &str = "planning/planner_submitted";
    let standing = || Sample::of(parts()).silence(UNHEARD).login().signal("active", false).pass(5);
    let departed = || standing().localize("depot").pass(5).signal("active", true);
    let new = departed().pass(1).published();
    check(&new, Lang::En, "tile-planning", &[r#"data-state="unknown""#], &[]);
    check(&new, Lang::En, "instruction", &[r#"data-urgency="none""#, "hidden"], &["ready to take over"]);
    check(&new, Lang::En, "causes", &[r#"data-node="planning/"#], &["ready to take over"]);
    let late = departed().pass(4).published();
    check(&late, Lang::En, "instruction", &[r#"data-urgency="be_ready""#, "Be ready to take over."], &[]);
}

#[test]
fn a_machine_without_stages_is_not_taken_over() {
    let machine = ModelParts { stages: StageModel::None, ..parts() };
    for (level, words) in
        [(1, "Keep an eye on it."), (2, "Stop. Call the control room."), (3, "Check the machine.")]
    {
        let sample =
            Sample::of(machine.clone()).report("sensors/velodyne_packet_alive", level, "m", &[]).pass(3);
        let part = if level == 1 { "causes" } else { "instruction" };
        check(&sample.published(), Lang::En, part, &[words], &["take over", "Take over", "be_ready"]);
    }
    // With and without somebody who is logged in, it is not said to drive and has no stop.
    for sample in [Sample::of(machine.clone()).pass(2), Sample::of(machine).login().pass(2)] {
        let not = ["drives", "fährt", r#"name="stop""#];
        let shown = sample.published();
        check(&shown, Lang::En, "step", &["Running"], &not);
        check(&shown, Lang::De, "step", &["In Betrieb"], &not);
        check(&shown, Lang::En, "top", &["Running"], &["Driving", "by itself"]);
        let page = operator_page(&shown, &context(Lang::En, Palette::Night));
        assert!(page.contains("Display frozen.") && !page.contains("<b>Take over.</b>"));
    }
}

/// One status that modules of three components take, called as `named` says.
fn three_places(named: bool) -> ModelParts {
    let mut parts = parts();
    for (group, id) in [("sensors", 0), ("can", 4), ("mission", 5)] {
        let mut place = module(group, id, "shared");
        place.monitor = ModuleMonitor::SelfState("shared: status".into());
        place.name = named.then(|| Wording::name("Power unstable".into()).into());
        parts.modules.push(place);
    }
    parts
}

fn entries_of(html: &str) -> usize {
    html.matches("class=\"cause\"").count()
}

#[test]
fn one_status_at_three_places_is_one_entry_one_call_and_one_acknowledgement() {
    for (level, word) in [(2, "Error"), (1, "Warning"), (3, "Unknown")] {
        let sample = || driving(three_places(true)).report("shared: status", level, "12 V", &[]).pass(2);
        let published = sample().published();
        let causes = fragment(&published, Lang::En, "causes");
        assert_eq!(entries_of(&causes), 1, "{causes}");
        assert_eq!(entries_of(&fragment(&published, Lang::En, "all-causes")), 1);
        let places = if level == 3 { "" } else { "Sensors, CAN, Mission<span class=\"lasted\">, " };
        assert!(causes.contains(places) && causes.contains(word), "{causes}");
        let calls = published.snapshot.audible();
        assert_eq!(calls, if level == 2 { vec![1] } else { vec![] }, "{:?}", published.snapshot.alarms);
    }
    let unnamed = driving(three_places(false)).report("shared: status", 2, "12 V", &[]).pass(2).published();
    check(&unnamed, Lang::En, "causes", &["Sensors, CAN, Mission: Error", "shared"], &[]);
    let silent = driving(three_places(false)).pass(1).silence("shared: status").pass(4).published();
    check(&silent, Lang::En, "causes", &[], &[">Mission not reporting"]);
    assert_eq!(entries_of(&fragment(&silent, Lang::En, "causes")), 1);
}

#[test]
fn what_is_known_at_one_place_is_known_at_all() {
    let fault = || driving(three_places(true)).report("shared: status", 2, "12 V", &[]).pass(2);
    let by = |alarm: AlarmRef| fault().act(OperatorAction::Acknowledge { alarm });
    for alarm in [AlarmRef::Number(2), AlarmRef::Node("mission/shared".into())] {
        let known = by(alarm.clone()).published();
        assert!(known.snapshot.alarms.iter().all(|alarm| alarm.acknowledged), "{alarm:?}");
        check(&known, Lang::En, "causes", &[], &[r#"name="acknowledge""#, "data-waiting"]);
    }
    // Over before anybody knew of it: still one entry, and one tap.
    let over = fault().report("shared: status", 0, "fine", &[]).pass(2);
    let published = over.published();
    let causes = fragment(&published, Lang::En, "causes");
    assert_eq!((entries_of(&causes), causes.matches("data-past").count()), (1, 1), "{causes}");
    let gone = fault().report("shared: status", 0, "fine", &[]).pass(2);
    let gone = gone.act(OperatorAction::Acknowledge { alarm: AlarmRef::Number(1) }).published();
    assert!(gone.snapshot.alarms.is_empty(), "{:?}", gone.snapshot.alarms);
}

#[test]
fn a_warning_at_three_places_is_accepted_once() {
    let warned = |parts| {
        let standing = Sample::of(parts).login().signal("active", false).pass(5).localize("depot").pass(5);
        standing.report("shared: status", 1, "12 V", &[]).pass(2)
    };
    let published = warned(three_places(true)).published();
    let step = fragment(&published, Lang::En, "step");
    assert_eq!(step.matches("Acknowledge first: Power unstable").count(), 1, "{step}");
    let sentences = refusals(&published, Lang::En, &published.snapshot.clearance_refusals);
    assert_eq!(sentences.iter().filter(|it| it.contains("Power unstable")).count(), 1, "{sentences:?}");
    let alarm = AlarmRef::Node("can/shared".into());
    let accepted = warned(three_places(true)).act(OperatorAction::Acknowledge { alarm }).published();
    check(&accepted, Lang::En, "step", &[], &["Acknowledge first"]);
    assert_eq!(accepted.snapshot.accepted.len(), 3);
    check(
        &accepted,
        Lang::En,
        "causes",
        &[r#"<p class="seen"><span class="hush">seen</span>"#, "<time"],
        &[],
    );
}

#[test]
fn a_call_keeps_its_number_while_the_fault_leaves_one_place_after_the_other() {
    let mut parts = three_places(true);
    let late = parts.modules.iter_mut().find(|module| &*module.id == "mission/shared").unwrap();
    late.policy.clear_after = telltale_engine::time::Span::from_secs(5);
    let mut fault = driving(parts).report("shared: status", 2, "12 V", &[]).pass(2);
    assert_eq!(fault.snapshot().audible(), [1]);
    let mut leaving = fault.report("shared: status", 0, "fine", &[]).pass(2);
    let snapshot = leaving.snapshot();
    assert_eq!(snapshot.alarms.iter().filter(|alarm| alarm.active).count(), 1);
    assert_eq!(snapshot.audible(), [1], "it would sound anew under another number");
    let mut again = leaving.pass(6).report("shared: status", 2, "12 V", &[]).pass(1);
    assert_eq!(again.snapshot().audible(), [4], "a fault that returns calls anew");
}

#[test]
fn a_stop_that_nobody_hears_is_neither_offered_nor_said_to_be_sent() {
    let stop = r#"name="stop""#;
    check(&Sample::shuttle(true).published(), Lang::En, "step", &[stop], &["No vehicle listens"]);
    let deaf = || Sample::shuttle(true).listeners(Output::ManeuverStop, false);
    check(&deaf().published(), Lang::En, "step", &["No vehicle listens"], &[stop]);
    check(&deaf().published(), Lang::De, "step", &["Kein Fahrzeug hört zu"], &[stop]);
    check(&deaf().published(), Lang::En, "causes", &["All 8"], &["telltale/outputs"]);
    let asked = || deaf().act(OperatorAction::RequestStop).pass(1);
    let expect = [r#"data-node="telltale/outputs""#];
    check(&asked().published(), Lang::En, "causes", &expect, &[]);
    let expect = [
        r#"data-urgency="take_over""#,
        "Take over. Stop.",
        "No vehicle listens. STOP pressed<",
        ". Request to stop not received.",
    ];
    check(&asked().published(), Lang::En, "instruction", &expect, &["Sent to the vehicle", "Asked to"]);
    check(&asked().published(), Lang::En, "step", &[r#"name="release""#, "No vehicle listens"], &[]);
    let heard = asked().listeners(Output::ManeuverStop, true).pass(1).published();
    check(&heard, Lang::En, "instruction", &["Asked to stop safely"], &["not received"]);
    let mut parts = parts();
    parts.driving.unpublished.push(Output::ManeuverStop);
    check(&driving(parts).published(), Lang::En, "step", &["It cannot be stopped from here."], &[stop]);
}

#[test]
fn the_work_can_be_ended_wherever_the_vehicle_stands() {
    let shutdown = r#"name="shutdown""#;
    let standing = Sample::shuttle(false).published();
    check(
        &standing,
        Lang::En,
        "top",
        &[shutdown, "Lock the display", r#"popovertarget="sheet-shutdown""#],
        &[],
    );
    check(&Sample::of(parts()).unlock().published(), Lang::De, "top", &[shutdown, "Anzeige sperren"], &[]);
    check(&Sample::shuttle(true).published(), Lang::En, "top", &[], &[shutdown]);
    let machine = Sample::of(ModelParts { stages: StageModel::None, ..parts() }).login().pass(2);
    check(&machine.published(), Lang::En, "top", &[], &[shutdown]);
    let page = operator_page(&standing, &context(Lang::En, Palette::Night));
    for part in [
        r#"action="/vehicle/shutdown""#,
        "The vehicle is locked and you are logged out.",
        "Das Fahrzeug wird gesperrt",
    ] {
        assert!(page.contains(part), "{part}");
    }
}
