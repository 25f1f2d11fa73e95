//! Tests of the motion in words and numbers.

use super::*;
use crate::engine::model::countermeasure::Request;
use crate::engine::snapshot::{Countermeasure, CountermeasureCause, CountermeasureState, Motion, Moving};

/// The sample as if this were known of its motion; `destination` is the Main Station.
fn moved(sample: Sample, moving: Moving, speed_kmh: u32) -> Published {
    let published = sample.published();
    let speed_kmh = (moving != Moving::Unknown).then_some(speed_kmh);
    let motion = Motion { moving, speed_kmh, has_source: true, destination: Some(1) };
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
    check_motion(&moved(active(), Moving::Yes, 18), Lang::En, "yes", "Driving · 18 km/h · Main Station");
    check_motion(&moved(active(), Moving::Yes, 18), Lang::De, "yes", "Fährt · 18 km/h · Hauptbahnhof");
    check_motion(&moved(active(), Moving::No, 0), Lang::En, "no", "Standing · next: Main Station");
    check_motion(&moved(active(), Moving::No, 0), Lang::De, "no", "Steht · Ziel: Hauptbahnhof");
    check_motion(&moved(active(), Moving::Unknown, 0), Lang::En, "unknown", "Speed unknown");
    let ready = || Sample::shuttle(false);
    check_motion(&moved(ready(), Moving::Yes, 4), Lang::En, "yes", "Moving · 4 km/h");
    check_motion(&moved(ready(), Moving::Yes, 4), Lang::De, "yes", "In Bewegung · 4 km/h");
    check_motion(&moved(ready(), Moving::Unknown, 0), Lang::De, "unknown", "Geschwindigkeit unbekannt");
}

#[test]
fn a_request_says_what_the_vehicle_does_while_it_moves() {
    let stopping = || Sample::shuttle(true).act(OperatorAction::RequestStop);
    check_motion(&moved(stopping(), Moving::Yes, 9), Lang::En, "yes", "Stopping · 9 km/h · Main Station");
    check_motion(&moved(stopping(), Moving::Yes, 9), Lang::De, "yes", "Hält an · 9 km/h · Hauptbahnhof");
    check_motion(&moved(stopping(), Moving::No, 0), Lang::En, "no", "Standing · next: Main Station");
    let slowing = Countermeasure {
        request: Request::Decelerate { mps2: 1.0 },
        by_operator: false,
        causes: [].into(),
        since: Timestamp::ZERO,
        state: CountermeasureState::Requested,
        latched: false,
    };
    let driving = moved(Sample::shuttle(true), Moving::Yes, 9);
    let snapshot = Snapshot { countermeasures: [slowing].into(), ..(*driving.snapshot).clone() };
    let slowing = Published { snapshot: snapshot.into(), ..driving };
    check_motion(&slowing, Lang::En, "yes", "Slowing down · 9 km/h · Main Station");
    check_motion(&slowing, Lang::De, "yes", "Bremst · 9 km/h · Hauptbahnhof");
}

#[test]
fn without_a_source_nothing_is_said_of_driving() {
    check_motion(&Sample::shuttle(true).published(), Lang::En, "unknown", "No speed signal");
    check_motion(&Sample::shuttle(true).published(), Lang::De, "unknown", "Kein Tempo-Signal");
    let machine = || Sample::of(ModelParts { stages: StageModel::None, ..parts() }).pass(2);
    check_motion(&machine().published(), Lang::En, "unknown", "Running");
    check_motion(&machine().published(), Lang::De, "unknown", "In Betrieb");
    check_motion(&moved(machine(), Moving::Yes, 4), Lang::En, "yes", "Moving · 4 km/h · Main Station");
    check_motion(&moved(machine(), Moving::Unknown, 0), Lang::En, "unknown", "Speed unknown");
}

#[test]
fn a_vehicle_that_was_stopped_and_stands_is_asked_whether_it_goes_on() {
    let cause = |published: &Published| CountermeasureCause {
        node: published.snapshot.node("sensors/imu").expect("it is there"),
        present: false,
        acknowledged: true,
    };
    let held = |moving| {
        let stopped = moved(Sample::shuttle(true), moving, 9);
        let held = Countermeasure {
            request: Request::ManeuverStop,
            by_operator: false,
            causes: [cause(&stopped)].into(),
            since: Timestamp::ZERO,
            state: CountermeasureState::Engaged,
            latched: true,
        };
        let snapshot = Snapshot {
            countermeasures: [held].into(),
            release_refusals: [].into(),
            ..(*stopped.snapshot).clone()
        };
        Published { snapshot: snapshot.into(), ..stopped }
    };
    let act = r#"data-urgency="act""#;
    let expect = [act, ">Steht. Ursache behoben. Weiterfahren?<", ">Gehalten. Bewegungssensor gestört.<"];
    check(&held(Moving::No), Lang::De, "instruction", &expect, &[]);
    let expect = [act, ">Cause gone. Continue?<", ">Stopping safely. Motion sensor disturbed.<"];
    check(&held(Moving::Yes), Lang::En, "instruction", &expect, &[]);
}
