//! Tests of when an incident begins and ends.

use super::*;
use crate::noticed::Watch;
use telltale_engine::Engine;
use telltale_engine::input::{Input, StatusArray, Upkeep};
use telltale_engine::model::{Model, Parts, StageModel};
use telltale_engine::text::Text;

fn s(seconds: u64) -> Timestamp {
    Timestamp::from_nanos(seconds * 1_000_000_000)
}

fn mark() -> Trigger {
    Trigger::Mark { by: "anna".into(), note: "".into() }
}

fn engine() -> Engine {
    let parts =
        Parts { other: telltale_engine::model::Other::Counted, ..Parts::empty("v", StageModel::None) };
    Engine::begin(Arc::new(Model::new(parts).unwrap()), s(0))
}

/// A tracker, and the watch over the events of its engine.
type Both = (Tracker, Watch);

fn say(both: &mut Both, engine: &mut Engine, name: &str, level: u8, at: Timestamp) -> Vec<Change> {
    let mut array = StatusArray::default();
    array.push_status(level, name, "", "");
    engine.handle(&Input::Diagnostics(array), at);
    follow(both, engine)
}

fn keep_up(both: &mut Both, engine: &mut Engine, recording: Option<&str>, at: Timestamp) -> Vec<Change> {
    let upkeep = Upkeep { recording: recording.map(Text::plain), ..Upkeep::default() };
    engine.handle(&Input::Upkeep(upkeep), at);
    follow(both, engine)
}

fn follow((tracker, watch): &mut Both, engine: &mut Engine) -> Vec<Change> {
    let (snapshot, events) = (engine.snapshot(), engine.take_events());
    let noticed: Vec<_> = events.iter().flat_map(|event| watch.take(event, &snapshot)).collect();
    tracker.follow(&snapshot, &noticed)
}

#[test]
fn a_root_cause_opens_an_incident_and_a_warning_extends_it() {
    let mut engine = engine();
    engine.keep_events();
    let mut both = (Tracker::new(Margins::default(), &engine.snapshot()), Watch::default());
    let mut said = |name, level, at| say(&mut both, &mut engine, name, level, at);
    assert_eq!(said("a", 0, s(1)), []);
    assert_eq!(said("b", 0, s(1)), []);
    let opened = said("a", 2, s(2));
    let [Change::Opened(open)] = &*opened else { panic!("{opened:?}") };
    assert_eq!((open.since, open.until), (s(2), s(12)));
    let is_a = |node: &Arc<str>| &**node == "other/a";
    assert!(matches!(&open.triggers[..], [(_, Trigger::Root { alarm: Some(1), node })] if is_a(node)));
    assert_eq!(said("a", 2, s(3)), [], "it is the same alarm");
    let extended = said("b", 1, s(3));
    let [Change::Extended(open)] = &*extended else { panic!("{extended:?}") };
    assert_eq!((open.until, open.triggers.len()), (s(13), 2));
    assert_eq!(said("b", 1, s(4)), [], "it is the same warning");
    assert_eq!(both.0.due(s(12)), []);
    assert!(matches!(&both.0.due(s(13))[..], [Change::Closed(_)]));
    assert_eq!(roots(&engine.snapshot(), s(2)), ["other/a".into()]);
}

#[test]
fn a_storm_opens_one_a_minute_and_says_so() {
    let engine = engine().snapshot();
    let mut tracker = Tracker::new(Margins::default(), &engine);
    let mut opened = Vec::new();
    for second in 0..200 {
        for change in tracker.trigger(s(second), mark()) {
            if let Change::Opened(open) = change {
                opened.push((second, open.storm));
            }
        }
    }
    assert_eq!(opened, [(0, false), (60, true), (120, true), (180, true)]);
    tracker.due(s(500));
    let quiet = tracker.trigger(s(1000), mark());
    assert!(matches!(&quiet[..], [Change::Opened(open)] if !open.storm), "{quiet:?}");
}

#[test]
fn the_end_of_autonomous_driving_is_an_incident_unless_the_vehicle_stands() {
    let snapshot = |stage, moving| {
        let mut snapshot = Snapshot::clone(&engine().snapshot());
        (snapshot.stage, snapshot.motion.moving) = (stage, moving);
        snapshot
    };
    for moving in Moving::ALL {
        let mut tracker = Tracker::new(Margins::default(), &snapshot(Stage::Active, moving));
        assert_eq!(tracker.follow(&snapshot(Stage::Active, moving), &[]), []);
        let changes = tracker.follow(&snapshot(Stage::Standby, moving), &[]);
        let opened = changes.iter().any(|change| {
            let Change::Opened(open) = change else { return false };
            matches!(open.triggers[..], [(_, Trigger::LostActive { stage: Stage::Standby })])
        });
        assert_eq!(opened, moving != Moving::No, "{moving:?}: {changes:?}");
    }
}

#[test]
fn an_arrival_that_is_known_a_moment_later_is_no_incident() {
    let snapshot = |ms, stage, moving, speed_kmh| {
        let mut snapshot = Snapshot::clone(&engine().snapshot());
        (snapshot.now, snapshot.stage) = (Timestamp::from_millis(ms), stage);
        (snapshot.motion.moving, snapshot.motion.speed_kmh) = (moving, speed_kmh);
        snapshot
    };
    let drives = snapshot(0, Stage::Active, Moving::Yes, Some(1));
    let ends = |speed| snapshot(100, Stage::Standby, Moving::Yes, Some(speed));
    let tracker = || Tracker::new(Margins::default(), &drives);
    let mut arrives = tracker();
    assert_eq!(arrives.follow(&ends(1), &[]), []);
    assert_eq!(arrives.follow(&snapshot(600, Stage::Standby, Moving::No, Some(0)), &[]), []);
    assert_eq!(arrives.due(s(5)), []);
    let mut creeps = tracker();
    assert_eq!(creeps.follow(&ends(1), &[]), []);
    assert_eq!(creeps.due(Timestamp::from_millis(799)), []);
    assert!(matches!(creeps.due(Timestamp::from_millis(800))[..], [Change::Opened(_)]));
    assert_eq!(creeps.due(Timestamp::from_millis(900)), [], "once");
    assert!(matches!(tracker().follow(&ends(2), &[])[..], [Change::Opened(_)]), "at once");
}

#[test]
fn triggers_are_bounded_and_counted_and_marks_take_no_place_of_them() {
    let mut tracker = Tracker::new(Margins::default(), &engine().snapshot());
    let root = || Trigger::Root { alarm: None, node: "a/b".into() };
    let marked = |tracker: &mut Tracker| {
        let by = |user: &str, tracker: &mut Tracker| {
            (0..100).filter(|_| tracker.mark(s(1), user, "a strange noise", true).1).count()
        };
        let of_one = by("a program", tracker);
        assert_eq!(of_one, MARKS_OF_ONE_MAX, "the operator has room yet");
        of_one + by("anna", tracker) + by("dora", tracker) + by("otto", tracker)
    };
    assert_eq!(marked(&mut tracker), MARKS_MAX);
    for _ in 0..1000 {
        tracker.trigger(s(1), root());
    }
    let open = tracker.end().unwrap();
    let others = TRIGGERS_MAX - MARKS_MAX;
    assert_eq!((open.triggers.len(), open.more), (TRIGGERS_MAX, 1000 - others as u64));
    // The other way round there is room for marks too.
    for _ in 0..1000 {
        tracker.trigger(s(2), root());
    }
    assert_eq!((tracker.open().unwrap().triggers.len(), marked(&mut tracker)), (others, MARKS_MAX));
    // It lasts longer with a mark that has no place.
    assert!(tracker.mark(s(8), "anna", "", true).0.iter().any(|it| matches!(it, Change::Extended(_))));
    assert_eq!(tracker.open().unwrap().until, s(18));
    assert!(tracker.mark(s(100), "anna", "", true).1, "the next incident has its own");
}

#[test]
fn marks_that_the_disk_refused_leave_places_for_those_after_it() {
    let mut tracker = Tracker::new(Margins::default(), &engine().snapshot());
    for tap in 0..100 {
        let (_, has_place) = tracker.mark(s(1), ["anna", "otto"][tap % 2], &format!("tap {tap}"), false);
        assert!(has_place, "it is not refused because of marks that nobody has");
    }
    let open = tracker.open().unwrap();
    assert_eq!((open.marks_of("anna"), open.count()), (MARKS_OF_ONE_MAX / 2, 100));
    let last =
        |(_, it): &(Timestamp, Trigger)| matches!(it, Trigger::Mark { note, .. } if &**note == "tap 99");
    assert!(open.triggers.iter().any(last), "the newest stays");
    let on_disk = (0..100).filter(|_| tracker.mark(s(2), "anna", "", true).1).count();
    assert_eq!(on_disk, MARKS_OF_ONE_MAX / 2);
}

#[test]
fn a_status_of_telltale_opens_an_incident_where_nothing_else_fails_and_once_an_hour() {
    let mut engine = engine();
    engine.keep_events();
    let mut both = (Tracker::new(Margins::default(), &engine.snapshot()), Watch::default());
    let mut opened = Vec::new();
    for minute in 0..150 {
        keep_up(&mut both, &mut engine, None, s(60 * minute + 1));
        let changes = keep_up(&mut both, &mut engine, Some("recording off"), s(60 * minute + 30));
        if changes.iter().any(|it| matches!(it, Change::Opened(_))) {
            opened.push(minute);
        }
    }
    assert_eq!(opened, [0, 60, 120]);
    // Beside a fault of the vehicle it opens none, and makes none longer.
    say(&mut both, &mut engine, "pump", 2, s(20_000));
    let until = both.0.open().unwrap().until;
    keep_up(&mut both, &mut engine, None, s(20_001));
    assert_eq!(keep_up(&mut both, &mut engine, Some("recording off"), s(20_002)), []);
    assert_eq!(both.0.open().unwrap().until, until);
}

#[test]
fn incidents_with_a_long_end_are_no_storm() {
    let margins = Margins { after: LENGTH_MAX, ..Margins::default() };
    let mut tracker = Tracker::new(margins, &engine().snapshot());
    for at in [0, 62, 200] {
        let changes = tracker.trigger(s(at), mark());
        assert!(matches!(&changes[..], [.., Change::Opened(open)] if !open.storm), "{changes:?}");
    }
}
