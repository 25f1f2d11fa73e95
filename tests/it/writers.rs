//! One status from several writers, and the nodes that may publish it.

use std::sync::Arc;

use crate::by_hand;
use crate::dds::{Reading, one};
use crate::peer::{Domain, Peer, Vendor};
use crate::publishers::found;
use telltale::config;
use telltale::engine::Engine;
use telltale::engine::input::{Input, NodeOf, StatusArray, WriterId, WriterList};
use telltale::engine::model::NodeId;
use telltale::engine::snapshot::{ModuleView, Snapshot};
use telltale::engine::state::State;
use telltale::engine::time::Timestamp;

const TEXT: &str = "
vehicle: { stages: none }
groups:
- id: a
  modules:
  - { id: lidar, status: lidar }
  - { id: heat, monitor: { value: { status: lidar, key: celsius, error_above: 90 } } }
  - { id: brake, status: brake, writers: [/brake] }
  - { id: disc, monitor: { value: { status: brake, key: celsius, error_above: 90 } } }
  - { id: lens, monitor: { value: { status: /cameras/left, key: celsius, error_above: 90 } } }
- { id: b, match: [{ namespace: /cameras, writers: [/cameras/driver] }] }
";

const OK: u8 = 0;
const WARNING: u8 = 1;
const ERROR: u8 = 2;

struct Vehicle {
    engine: Engine,
    named: Vec<(u8, NodeOf)>,
}

fn id(writer: u8) -> WriterId {
    WriterId([writer; 16])
}

fn named(name: &str) -> NodeOf {
    NodeOf::Named(name.into())
}

impl Vehicle {
    /// Its writers are 1 and 2, of the nodes `/one` and `/two`, and what else is told.
    fn new(others: &[(u8, NodeOf)]) -> Vehicle {
        let loaded = config::parse("test", TEXT).unwrap();
        let mut vehicle = Vehicle { engine: Engine::new(loaded.model, Timestamp::ZERO), named: Vec::new() };
        vehicle.named =
            [(1, named("/one")), (2, named("/two"))].into_iter().chain(others.iter().cloned()).collect();
        vehicle.list(0, &[]);
        vehicle
    }

    /// Discovery knows all writers but these.
    fn list(&mut self, millis: u64, gone: &[u8]) {
        let at = Timestamp::from_millis(millis);
        let there = self.named.iter().filter(|(writer, _)| !gone.contains(writer));
        let writers = there.map(|(writer, node)| (id(*writer), node.clone())).collect();
        let list = WriterList { as_of: at, complete: true, writers };
        self.engine.handle(&Input::Writers(Arc::new(list)), at);
    }

    fn say(&mut self, millis: u64, writer: u8, level: u8, name: &str) {
        let mut array = StatusArray::default();
        array.push_status(level, name, &format!("as {writer} says"), "");
        array.push_value("celsius", &(10 * u32::from(writer)).to_string());
        let input = Input::Diagnostics(array.said_by(id(writer)));
        self.engine.handle(&input, Timestamp::from_millis(millis));
    }

    fn snapshot(&mut self, millis: u64) -> Arc<Snapshot> {
        let now = Timestamp::from_millis(millis);
        while let Some(due) = self.engine.next_deadline().filter(|&due| due <= now) {
            self.engine.handle(&Input::Tick, due);
        }
        self.engine.handle(&Input::Tick, now);
        self.engine.snapshot()
    }

    fn module(&mut self, millis: u64, name: &str) -> ModuleView {
        let snapshot = self.snapshot(millis);
        let id = snapshot.module_ids().find(|&id| *snapshot.module(id).0.id == *name).expect("it is there");
        snapshot.module(id).1.clone()
    }

    fn own(&mut self, millis: u64, name: &str) -> State {
        self.module(millis, name).own
    }

    fn dispute(&mut self, millis: u64) -> Option<String> {
        let view = self.module(millis, "telltale/writers");
        (view.own == State::Warning).then(|| view.report.message.to_string())
    }
}

/// What a group says of names past the limit, after a driver and a stranger said one name in turn.
fn dropped_names(writers: &[&str]) -> Option<String> {
    let text = "
vehicle: { stages: none }
limits: { discovered_modules: 1 }
groups:
- { id: all, match: [{ namespace: /cameras }] }
- { id: own, match: [{ namespace: /cameras, writers: [/driver] }] }
";
    let loaded = config::parse("test", text).unwrap();
    let named = vec![(1, named("/driver")), (2, named("/stranger"))];
    let mut vehicle = Vehicle { engine: Engine::new(loaded.model, Timestamp::ZERO), named };
    vehicle.list(0, &[]);
    for (millis, writer) in (0..).zip(writers) {
        vehicle.say(millis, if *writer == "driver" { 1 } else { 2 }, OK, "/cameras/left");
    }
    let snapshot = vehicle.engine.snapshot();
    let module = snapshot.node("own/(names past the limit)")?;
    let NodeId::Module(id) = module else { panic!("{module:?}") };
    Some(snapshot.module(id).1.report.message.to_string())
}

#[test]
fn a_name_that_a_reload_leaves_to_another_node_counts_once_that_says_it() {
    let own = "- { id: own, match: [{ namespace: /cameras, writers: [/driver] }] }";
    let text = |groups: &str| format!("vehicle: {{ stages: none }}\ngroups:\n{groups}\n");
    let model = |text: &str| config::parse("test", text).unwrap().model;
    let both = model(&text(&format!("- {{ id: all, match: [{{ namespace: /cameras }}] }}\n{own}")));
    let named = vec![(1, named("/driver")), (2, named("/stranger"))];
    let mut vehicle = Vehicle { engine: Engine::new(both, Timestamp::ZERO), named };
    vehicle.list(0, &[]);
    vehicle.say(0, 2, OK, "/cameras/left");
    vehicle.engine.reload(model(&text(own)), Timestamp::from_millis(10));
    assert_eq!(vehicle.snapshot(10).node("own//cameras/left"), None);
    vehicle.say(20, 1, ERROR, "/cameras/left");
    assert_eq!(vehicle.own(20, "own//cameras/left"), State::Error);
}

#[test]
fn a_stranger_does_not_change_how_many_names_are_past_the_limit() {
    let one = Some("1 status with a new name dropped: limits.discovered_modules is 1".to_owned());
    assert_eq!(dropped_names(&["driver", "driver"]), one);
    assert_eq!(dropped_names(&["driver", "stranger", "driver"]), one);
    assert_eq!(dropped_names(&["stranger", "driver", "driver"]), one);
    assert_eq!(dropped_names(&["stranger", "stranger"]), None);
}

#[test]
fn values_of_a_status_that_a_filter_restricts_wait_for_its_node() {
    let mut vehicle = Vehicle::new(&[(3, NodeOf::Pending)]);
    let lens = |vehicle: &mut Vehicle, millis| vehicle.module(millis, "a/lens").steps.reported;
    for (millis, level) in [(0, OK), (10, ERROR)] {
        vehicle.say(millis, 3, level, "/cameras/left");
        assert_eq!(lens(&mut vehicle, millis), None, "nobody knows yet who says it");
    }
    vehicle.say(20, 1, OK, "/cameras/left");
    assert_eq!(lens(&mut vehicle, 20), None, "/one may not say it");
    vehicle.named = vec![(3, named("/cameras/driver"))];
    vehicle.list(30, &[]);
    vehicle.say(40, 3, OK, "/cameras/left");
    assert_eq!(lens(&mut vehicle, 40), Some(State::Ok));
}

#[test]
fn a_flood_of_ok_covers_no_error() {
    let mut vehicle = Vehicle::new(&[]);
    for millis in (0..6000).step_by(10) {
        if millis % 200 == 0 {
            vehicle.say(millis, 1, ERROR, "lidar");
        }
        vehicle.say(millis, 2, OK, "lidar");
        let view = vehicle.module(millis, "a/lidar");
        assert_eq!((view.own, &*view.report.message), (State::Error, "as 1 says"), "at {millis} ms");
    }
    let said = vehicle.dispute(6000).expect("they contradict each other");
    assert_eq!(said, "lidar: /one says ERROR, /two says OK; the worse counts");
    let view = vehicle.module(6000, "telltale/writers");
    assert_eq!(
        view.report.german.as_deref(),
        Some("lidar: /one meldet FEHLER, /two meldet OK; das Schlechtere zählt")
    );
    // The worse one ends. It counts for the module's timeout while the other one speaks, and is named for a
    // while.
    for millis in (6000..20_000).step_by(10) {
        vehicle.say(millis, 2, OK, "lidar");
        let expected = if millis < 7800 { State::Error } else { State::Ok };
        assert_eq!(vehicle.own(millis, "a/lidar"), expected, "at {millis} ms");
    }
    assert_eq!(&*vehicle.module(19_990, "a/lidar").report.message, "as 2 says");
    assert_eq!(vehicle.dispute(19_990), None);
}

#[test]
fn the_order_of_the_writers_means_nothing() {
    for first in [1, 2] {
        let mut vehicle = Vehicle::new(&[]);
        vehicle.say(0, first, if first == 1 { ERROR } else { OK }, "lidar");
        vehicle.say(100, 3 - first, if first == 1 { OK } else { ERROR }, "lidar");
        assert_eq!(vehicle.own(100, "a/lidar"), State::Error);
    }
}

#[test]
fn a_node_that_is_started_again_contradicts_nobody() {
    let mut vehicle = Vehicle::new(&[(3, named("/one"))]);
    for millis in (0..3000).step_by(500) {
        vehicle.say(millis, 1, ERROR, "lidar");
    }
    for millis in (3000..20_000).step_by(500) {
        vehicle.say(millis, 3, OK, "lidar");
        let expected = if millis < 4500 { State::Error } else { State::Ok };
        assert_eq!((vehicle.own(millis, "a/lidar"), vehicle.dispute(millis)), (expected, None), "{millis}");
    }
}

#[test]
fn who_left_counts_no_more_and_the_last_word_stays_the_last() {
    let mut vehicle = Vehicle::new(&[]);
    vehicle.say(0, 1, ERROR, "lidar");
    vehicle.say(400, 2, OK, "lidar");
    vehicle.list(500, &[1]);
    vehicle.say(600, 2, OK, "lidar");
    assert_eq!(vehicle.own(600, "a/lidar"), State::Ok);
    // A status that came after discovery was asked is from an existing writer.
    vehicle.say(700, 1, ERROR, "lidar");
    vehicle.say(800, 2, OK, "lidar");
    assert_eq!(vehicle.own(800, "a/lidar"), State::Error);
    // Both leave: the ERROR is the worse of it and the silence.
    vehicle.list(900, &[1, 2]);
    assert_eq!(vehicle.own(10_000, "a/lidar"), State::Error);
}

#[test]
fn writers_that_agree_but_for_a_moment_are_no_dispute() {
    let mut vehicle = Vehicle::new(&[]);
    for second in 0..30 {
        // Two nodes that measure the same, one of them half a second later.
        let level = if second % 7 < 3 { ERROR } else { OK };
        vehicle.say(1000 * second, 1, level, "lidar");
        vehicle.say(1000 * second + 500, 2, level, "lidar");
        assert_eq!(vehicle.dispute(1000 * second + 500), None);
    }
}

#[test]
fn one_that_changes_its_mind_all_the_time_is_named() {
    let mut vehicle = Vehicle::new(&[]);
    for millis in (0..5000).step_by(100) {
        vehicle.say(millis, 1, OK, "lidar");
        vehicle.say(millis + 50, 2, if millis % 200 == 0 { ERROR } else { OK }, "lidar");
    }
    assert!(vehicle.dispute(5000).is_some_and(|said| said.contains("/one") && said.contains("/two")));
}

#[test]
fn values_are_of_the_writer_that_counts() {
    let mut vehicle = Vehicle::new(&[]);
    let value = |vehicle: &mut Vehicle, millis| {
        let report = vehicle.module(millis, "a/heat").report;
        report.values.iter().find(|(key, _)| &**key == "value").map(|(_, value)| value.to_string())
    };
    for millis in (0..1500).step_by(100) {
        vehicle.say(millis, 1, WARNING, "lidar");
        vehicle.say(millis + 50, 2, OK, "lidar");
        assert_eq!(value(&mut vehicle, millis + 60).as_deref(), Some("10"), "at {millis} ms");
    }
}

#[test]
fn of_more_writers_than_are_told_apart_the_worst_count_and_it_is_said() {
    let mut vehicle = Vehicle::new(&[]);
    vehicle.say(0, 100, ERROR, "lidar");
    for writer in 1..50 {
        vehicle.say(u64::from(writer), writer, OK, "lidar");
        assert_eq!(vehicle.own(u64::from(writer), "a/lidar"), State::Error, "after {writer}");
    }
    assert!(vehicle.dispute(60).expect("that is said").contains("more writers than"));
}

#[test]
fn what_only_one_node_may_say_counts_from_no_other() {
    let mut vehicle = Vehicle::new(&[(3, named("/brake")), (4, NodeOf::Unannounced)]);
    assert_eq!(vehicle.dispute(0), None);
    for (millis, writer) in [(0, 1), (100, 4), (200, 1)] {
        vehicle.say(millis, writer, OK, "brake");
    }
    let view = vehicle.module(300, "a/brake");
    assert_eq!((view.own, view.received), (State::Unknown, None));
    assert_eq!(vehicle.dispute(1300).as_deref(), Some("brake: /one may not say it; statuses not counted: 1"));
    vehicle.say(1400, 3, WARNING, "brake");
    vehicle.say(1450, 1, ERROR, "brake");
    assert_eq!(vehicle.own(1450, "a/brake"), State::Warning, "a stranger makes nothing worse either");
    vehicle.say(1500, 3, OK, "brake");
    assert_eq!(vehicle.own(1500, "a/brake"), State::Ok);
    assert_eq!(vehicle.dispute(20_000), None);
    // The same of what a filter takes.
    vehicle.named.push((5, named("/cameras/driver")));
    vehicle.list(20_000, &[]);
    vehicle.say(20_100, 1, OK, "/cameras/left");
    assert_eq!(vehicle.snapshot(20_100).node("b//cameras/left"), None, "a stranger makes no module");
    vehicle.say(20_200, 5, OK, "/cameras/left");
    assert_eq!(vehicle.own(20_200, "b//cameras/left"), State::Ok);
}

#[test]
fn of_a_node_that_is_not_known_yet_only_what_is_bad_counts() {
    let mut vehicle = Vehicle::new(&[(3, NodeOf::Pending)]);
    vehicle.say(0, 3, OK, "brake");
    let view = vehicle.module(0, "a/brake");
    assert_eq!((view.own, view.received), (State::Unknown, None));
    assert_eq!(
        &*view.report.message,
        "the node that says OK is not known yet: it does not count until it is"
    );
    assert_eq!(vehicle.dispute(0), None, "every start would be a WARNING");
    vehicle.say(100, 3, ERROR, "brake");
    assert_eq!(vehicle.own(100, "a/brake"), State::Error);
    assert_eq!(vehicle.own(100, "a/disc"), State::Unknown, "its values may be good ones");
    vehicle.named[2] = (3, named("/brake"));
    vehicle.list(200, &[]);
    vehicle.say(300, 3, OK, "brake");
    assert_eq!(vehicle.own(300, "a/brake"), State::Ok);
    assert_eq!(vehicle.own(300, "a/disc"), State::Ok);
}

#[test]
fn a_list_of_a_discovery_that_has_only_begun_takes_no_name_away() {
    let mut vehicle = Vehicle::new(&[(3, named("/brake"))]);
    let list = WriterList { as_of: Timestamp::from_millis(100), ..WriterList::default() };
    vehicle.engine.handle(&Input::Writers(Arc::new(list)), Timestamp::from_millis(100));
    vehicle.say(200, 3, OK, "brake");
    assert_eq!(vehicle.own(200, "a/brake"), State::Ok);
}

#[test]
fn what_is_in_dispute_is_listed_up_to_a_bound() {
    let mut vehicle = Vehicle::new(&[]);
    for millis in (0..4000).step_by(1000) {
        for (writer, level) in [(1, ERROR), (2, OK)] {
            for number in 0..500 {
                vehicle.say(millis, writer, level, &format!("s{number:03}"));
            }
        }
    }
    let view = vehicle.module(4000, "telltale/writers");
    assert_eq!(view.report.values.len(), 64);
    assert!(view.report.message.ends_with("the worse counts (and 64+ more)"), "{}", view.report.message);
}

#[test]
fn a_reload_forgets_nobody() {
    let mut vehicle = Vehicle::new(&[(3, named("/brake"))]);
    for millis in (0..3000).step_by(500) {
        vehicle.say(millis, 1, ERROR, "lidar");
        vehicle.say(millis + 1, 2, OK, "lidar");
    }
    let before = vehicle.dispute(3000);
    assert!(before.is_some());
    let model = by_hand::model(TEXT);
    vehicle.engine.reload(model, Timestamp::from_millis(3000));
    vehicle.say(3001, 2, OK, "lidar");
    vehicle.say(3002, 3, OK, "brake");
    assert_eq!(vehicle.own(3002, "a/lidar"), State::Error);
    assert_eq!(vehicle.own(3002, "a/brake"), State::Ok);
    assert_eq!(vehicle.dispute(3002), before);
    assert_eq!(vehicle.dispute(30_000), None);
}

async fn each_status_has_its_writer_and_discovery_knows_them(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut reading = Reading::start(&domain).await;
    let mut peers = [Peer::start(&domain, "pub"), Peer::start(&domain, "pub")];
    let mut writers = Vec::new();
    for (name, peer) in ["first", "second"].into_iter().zip(&mut peers) {
        peer.wait_matched(1);
        found(&reading, "/diagnostics", 2).await;
        peer.write(&one(name));
        writers.push(reading.status(name).await.writer());
    }
    assert_ne!(writers[0], writers[1]);
    writers.sort_unstable();
    let listed = |input: &Input, wanted: &[WriterId]| match input {
        Input::Writers(list) => {
            list.writers.keys().copied().eq(wanted.iter().copied()).then_some(list.complete)
        }
        _ => None,
    };
    reading.until("a list of both", |input| listed(input, &writers)).await;
    peers.into_iter().for_each(Peer::end);
    // In the first seconds others may be found still: then nobody is gone for good.
    reading.until("that both are gone", |input| listed(input, &[]).filter(|complete| *complete)).await;
    reading.bridge.shutdown().await;
}

with_each_peer!(each_status_has_its_writer_and_discovery_knows_them);
