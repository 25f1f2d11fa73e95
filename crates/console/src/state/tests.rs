//! The console's state over virtual time, with messages that are as they should be, and hostile ones.

use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::time::{Since, Span, Timestamp};
use telltale_fleet::hub::VEHICLES_MAX;
use telltale_fleet::message::{
    Alarm, AuditHead, Batch, Cause, Content, Epoch, Gap, GapReason, Head, Incident, Malformed, Message, Node,
    NodeStates, VehicleId,
};
use telltale_fleet::reading::Stream;

use super::contact::{Contact, Counts, Urgency};
use super::incidents::{GroupBy, grouped};
use super::{Arrived, Fleet, Row, counts};

const AT: i64 = 1_780_000_000_000;

/// A fleet in virtual time.
struct World {
    fleet: Fleet,
    now: Timestamp,
}

fn id(text: &str) -> VehicleId {
    VehicleId::new(text).unwrap()
}

fn head(state: State) -> Head {
    Head {
        name: "Shuttle".into(),
        state,
        cause: None,
        since: AT,
        stage: Stage::Standby,
        drives: false,
        speed_kmh: None,
        unacknowledged: 0,
        version: "0.1.0".into(),
        config: "c0ffee".into(),
        last: 1,
        ending: false,
    }
}

fn message(run: u32, n: u64, content: Content) -> Message {
    Message { epoch: Epoch { start: run, nonce: 0 }, n, at: AT, content }
}

impl World {
    fn new() -> World {
        let start = Timestamp::from_millis(1_000_000);
        let mut fleet = Fleet::new([], 0, Since::of_age(Span::ZERO, start));
        fleet.line_opened(start);
        World { fleet, now: start }
    }

    fn after(&mut self, seconds: u64) -> &mut World {
        self.now = self.now + Span::from_secs(seconds);
        self
    }

    fn tell(&mut self, stream: Stream, of: &str, messages: Vec<Message>) -> &mut World {
        let batch = Batch { id: id(of), key: "UA".into(), sent: AT, messages };
        self.arrive(stream, of, Ok(batch))
    }

    fn arrive(&mut self, stream: Stream, of: &str, batch: Result<Batch, Malformed>) -> &mut World {
        let arrived = Arrived { stream, id: id(of), batch, stored_ms: AT, age: Span::ZERO };
        self.fleet.take(arrived, self.now);
        self
    }

    fn head(&mut self, of: &str, run: u32, n: u64, head: Head) -> &mut World {
        self.tell(Stream::Head, of, vec![message(run, n, Content::Head(head))])
    }

    fn row(&self, of: &str) -> Row {
        self.fleet.row(self.fleet.vehicle(&id(of)).unwrap(), self.now)
    }

    fn contact(&self, of: &str) -> Contact {
        self.row(of).contact
    }

    fn order(&self) -> Vec<String> {
        self.fleet.rows(self.now).into_iter().map(|row| row.id).collect()
    }
}

#[test]
fn a_vehicle_is_live_late_and_lost_by_the_age_of_its_head_alone() {
    let mut world = World::new();
    world.head("a", 1, 1, head(State::Ok));
    for (after_s, contact) in [
        (0, Contact::Live),
        (35, Contact::Live),
        (1, Contact::Late),
        (29, Contact::Late),
        (86_400, Contact::Lost),
    ] {
        assert_eq!(world.after(after_s).contact("a"), contact, "{after_s}");
    }
    assert_eq!(world.head("a", 1, 1, head(State::Ok)).contact("a"), Contact::Live);
}

#[test]
fn a_head_that_lay_at_the_hub_is_as_old_as_it_is() {
    let mut world = World::new();
    let messages = vec![message(1, 1, Content::Head(head(State::Ok)))];
    let batch = Ok(Batch { id: id("a"), key: "UA".into(), sent: AT, messages });
    let age = Span::from_secs(86_400 * 3);
    world.fleet.take(Arrived { stream: Stream::Head, id: id("a"), batch, stored_ms: AT, age }, world.now);
    let row = world.row("a");
    assert_eq!((row.contact, row.age_s), (Contact::Lost, Some(259_200.0)));
}

#[test]
fn a_vehicle_is_off_after_a_goodbye_only_and_until_it_tells_again() {
    let mut world = World::new();
    world.head("a", 1, 3, head(State::Ok)).tell(Stream::Log, "a", vec![message(1, 4, Content::Goodbye)]);
    assert_eq!(world.after(1000).contact("a"), Contact::Off);
    assert_eq!(world.row("a").urgency, Urgency::Off);
    world.head("a", 2, 1, head(State::Ok));
    assert_eq!(world.contact("a"), Contact::Live);
    let ending = Head { ending: true, stage: Stage::Active, drives: true, ..head(State::Ok) };
    world.head("a", 2, 2, ending);
    // Telltale ended while the vehicle drove.
    assert_eq!((world.contact("a"), world.row("a").urgency), (Contact::Off, Urgency::LostDriving));
}

#[test]
fn without_the_hub_nothing_is_live_and_after_it_vehicles_have_time_to_come_back() {
    let mut world = World::new();
    world.head("gone", 1, 1, head(State::Ok)).after(600).head("a", 1, 1, head(State::Ok));
    world.head("off", 1, 1, Head { ending: true, ..head(State::Ok) });
    world.fleet.line_ended("cut", world.now);
    for vehicle in ["a", "gone", "off"] {
        assert_eq!(world.contact(vehicle), Contact::HubDown);
    }
    assert_eq!(counts(&world.fleet.rows(world.now)).ok, 0);
    world.after(300);
    world.fleet.line_opened(world.now);
    assert_eq!(world.contact("a"), Contact::Late, "it was not heard, and is not lost yet");
    assert_eq!(world.contact("gone"), Contact::Lost, "it was lost before");
    assert_eq!(world.contact("off"), Contact::Off);
    assert_eq!(world.after(150).contact("a"), Contact::Late);
    assert_eq!(world.after(1).contact("a"), Contact::Lost);
    assert_eq!(world.head("a", 1, 2, head(State::Ok)).contact("a"), Contact::Live);
}

#[test]
fn the_worst_comes_first_and_each_vehicle_is_counted_once() {
    let mut world = World::new();
    world.head("lost-driving", 1, 1, Head { stage: Stage::Active, drives: true, ..head(State::Ok) });
    world.head("lost", 1, 1, head(State::Ok));
    world.after(40).head("late", 1, 1, head(State::Ok)).after(36);
    world.head("ok", 1, 1, head(State::Ok)).head("error", 1, 1, head(State::Error));
    world.head("warning", 1, 1, head(State::Warning)).head("unknown", 1, 1, head(State::Unknown));
    world.head("unacknowledged", 1, 1, Head { unacknowledged: 2, ..head(State::Ok) });
    world.head("off", 1, 1, Head { ending: true, ..head(State::Error) });
    world.head("parked", 1, 1, head(State::Ignore));
    world.tell(Stream::Log, "never", vec![message(1, 1, Content::Goodbye)]);
    let expected = [
        "lost-driving",
        "error",
        "unacknowledged",
        "unknown",
        "warning",
        "lost",
        "late",
        "never",
        "ok",
        "parked",
        "off",
    ];
    assert_eq!(world.order(), expected);
    let expected = Counts { error: 1, warning: 2, ok: 2, lost: 3, never_heard: 1, off: 2 };
    assert_eq!(counts(&world.fleet.rows(world.now)), expected);
}

#[test]
fn messages_are_ordered_by_their_place_and_never_by_a_clock() {
    let mut world = World::new();
    world.head("a", 1, 5, head(State::Error)).head("a", 1, 4, head(State::Ok));
    assert_eq!(world.row("a").state, State::Error, "an older place, told later");
    // A clock that is four years behind, and two hours ahead.
    for (sent, skew_s) in [(AT - 126_230_400_000, -126_230_400.0), (AT + 7_200_000, 7200.0)] {
        let told = Head { since: sent - 60_000, ..head(State::Warning) };
        let messages = vec![Message { at: sent, ..message(2, 1, Content::Head(told)) }];
        world.arrive(Stream::Head, "a", Ok(Batch { id: id("a"), key: "UA".into(), sent, messages }));
        let row = world.row("a");
        assert_eq!((row.state, row.contact, row.clock_skew_s), (State::Warning, Contact::Live, Some(skew_s)));
        assert_eq!(row.since_ms, Some(AT - 60_000), "by the hub's clock it is a minute");
    }
    world.head("a", 2, 2, head(State::Ok));
    assert_eq!(world.row("a").clock_skew_s, None);
}

#[test]
fn two_vehicles_with_one_name_are_shown_and_the_one_that_goes_on_counts() {
    let mut world = World::new();
    world.head("a", 1, 9, head(State::Error)).head("a", 2, 1, head(State::Ok));
    assert!(!world.row("a").two_vehicles, "a restart");
    world.after(15).head("a", 1, 9, head(State::Error));
    assert!(world.row("a").two_vehicles);
    assert_eq!(world.row("a").state, State::Ok, "the newer run is live");
    world.after(30).head("a", 1, 9, head(State::Error));
    let row = world.row("a");
    assert_eq!((row.state, row.contact, row.two_vehicles), (State::Error, Contact::Live, true));
    assert!(!world.after(601).row("a").two_vehicles);
    // A vehicle that was enrolled again has a new key.
    let messages = vec![message(0, 1, Content::Head(head(State::Warning)))];
    world.arrive(Stream::Head, "a", Ok(Batch { id: id("a"), key: "UB".into(), sent: AT, messages }));
    assert_eq!((world.row("a").state, world.row("a").two_vehicles), (State::Warning, false));
}

#[test]
fn what_is_hostile_is_counted_at_its_vehicle_and_changes_nothing_else() {
    let mut world = World::new();
    world.head("good", 1, 1, head(State::Ok)).head("bad", 1, 1, head(State::Ok));
    let before = format!("{:?}", world.row("good"));
    let reasons = [
        Malformed::TooLarge(1 << 30),
        Malformed::TooLargeUnpacked,
        Malformed::NotPacked,
        Malformed::NoMessage(1),
        Malformed::Format(2),
        Malformed::ForeignId,
        Malformed::Time,
        Malformed::Empty,
        Malformed::TooMany,
        Malformed::Order,
    ];
    for (count, reason) in (1..).zip(&reasons) {
        let stream = if count % 2 == 0 { Stream::Head } else { Stream::Log };
        let row = world.arrive(stream, "bad", Err(reason.clone())).row("bad");
        assert_eq!((row.refused, row.refused_why), (count, Some(reason.to_string())));
        assert_eq!(row.state, State::Ok);
    }
    // Another kind where heads belong, and two of them.
    let two = vec![
        message(3, 1, Content::Head(head(State::Error))),
        message(3, 2, Content::Head(head(State::Error))),
    ];
    world.tell(Stream::Head, "bad", vec![message(3, 1, Content::Goodbye)]).tell(Stream::Head, "bad", two);
    assert_eq!((world.row("bad").refused, world.row("bad").state), (12, State::Ok));
    assert_eq!(format!("{:?}", world.row("good")), before);
    assert_eq!(world.fleet.refused, 12);
}

#[test]
fn a_vehicle_that_tells_many_heads_of_its_audit_log_takes_no_place_of_others() {
    let mut world = World::new();
    let told = |from: u64| {
        let of = |number| {
            let head = AuditHead { record: number, hash: format!("{number:064x}") };
            message(1, number, Content::AuditHead(head))
        };
        (from..from + 4000).map(of).collect::<Vec<_>>()
    };
    for batch in 0..20 {
        world.tell(Stream::Log, "many", told(1 + batch * 4000));
    }
    world.tell(Stream::Log, "one", told(1)[..1].to_vec());
    let waiting = world.fleet.take_unwritten();
    let numbers = |id: &str| -> Vec<u64> {
        waiting.heads[&VehicleId::new(id).unwrap()].iter().map(|(head, _)| head.number).collect()
    };
    let first = |batch: u64| batch * 4000;
    assert_eq!(numbers("many"), [1, 2, 3, 4, 5, 6, 7, 20].map(first));
    assert_eq!(numbers("one"), [1]);
    // The disk did not take them.
    world.tell(Stream::Log, "many", told(90_001));
    world.fleet.put_back(waiting);
    let waiting = world.fleet.take_unwritten();
    assert_eq!(waiting.heads[&VehicleId::new("many").unwrap()].last().map(|it| it.0.number), Some(94_000));
}

#[test]
fn texts_have_bounds_and_no_letters_that_act() {
    let mut world = World::new();
    let hostile = format!("\u{202e}<script>alert(1)</script>\u{1b}[2J{}", "x".repeat(100_000));
    let told = Head {
        name: hostile.clone(),
        cause: Some(Cause { node: hostile.clone(), words: hostile.clone() }),
        since: i64::MIN,
        version: hostile.clone(),
        config: hostile.clone(),
        speed_kmh: Some(u32::MAX),
        unacknowledged: u32::MAX,
        ..head(State::Error)
    };
    world.head("a", 1, 1, told);
    let row = world.row("a");
    let cause = row.cause.clone().unwrap();
    for text in [&row.name, &cause.node, &cause.words, &row.version, &row.config] {
        assert!(text.chars().count() <= 301, "{}", text.len());
        assert!(!text.contains(|letter: char| letter.is_control() || letter == '\u{202e}'), "{text}");
    }
    let words = NodeStates {
        stage: Stage::Active,
        nodes: vec![Node {
            node: hostile.clone(),
            state: State::Error,
            own: State::Error,
            cause: Some(hostile.clone()),
            words: hostile,
            gone: false,
        }],
    };
    world.tell(Stream::Log, "a", vec![message(1, 1, Content::Keyframe(words))]);
    let picture = &world.fleet.vehicle(&id("a")).unwrap().picture;
    assert!(picture.nodes.iter().all(|(name, shown)| name.len() < 400 && shown.words.len() < 400));
}

#[test]
fn nodes_that_differ_in_what_is_not_shown_stay_two() {
    let mut world = World::new();
    world.head("a", 1, 1, head(State::Error));
    let node = |name: &str, state| Node {
        node: name.into(),
        state,
        own: state,
        cause: None,
        words: String::new(),
        gone: false,
    };
    let nodes =
        vec![node("/brake", State::Error), node("/brake ", State::Ok), node("/bra\u{200b}ke", State::Ok)];
    let all = NodeStates { stage: Stage::Active, nodes };
    world.tell(Stream::Log, "a", vec![message(1, 1, Content::Keyframe(all))]);
    let picture = &world.fleet.vehicle(&id("a")).unwrap().picture;
    assert_eq!((picture.nodes.len(), picture.nodes["/brake"].state), (3, State::Error));
}

#[test]
fn more_vehicles_than_a_hub_admits_are_not_taken() {
    let mut world = World::new();
    for number in 0..VEHICLES_MAX {
        world.head(&format!("v{number}"), 1, 1, head(State::Ok));
    }
    world.head("one-more", 1, 1, head(State::Error)).head("v0", 1, 2, head(State::Warning));
    assert!(world.fleet.vehicle(&id("one-more")).is_none());
    assert_eq!((world.row("v0").state, world.fleet.refused), (State::Warning, 1));
}

#[test]
fn the_picture_follows_keyframes_and_changes_and_says_when_something_is_missing() {
    let node = |name: &str, state, gone| Node {
        node: name.into(),
        state,
        own: state,
        cause: None,
        words: String::new(),
        gone,
    };
    let stage = Stage::Standby;
    let mut world = World::new();
    let all = NodeStates { stage, nodes: vec![node("a", State::Ok, false), node("b", State::Ok, false)] };
    let alarm =
        Alarm { number: 7, node: "a".into(), active: true, acknowledged: false, words: String::new() };
    world.tell(
        Stream::Log,
        "v",
        vec![
            message(1, 1, Content::Keyframe(all.clone())),
            message(1, 2, Content::Delta(NodeStates { stage, nodes: vec![node("a", State::Error, false)] })),
            message(1, 3, Content::Alarm(alarm.clone())),
        ],
    );
    let picture = |world: &World| {
        let picture = &world.fleet.vehicle(&id("v")).unwrap().picture;
        let states: Vec<(String, State)> =
            picture.nodes.iter().map(|(name, shown)| (name.clone(), shown.state)).collect();
        (states, picture.alarms.len(), picture.is_whole)
    };
    let both = |a| vec![("a".to_owned(), a), ("b".to_owned(), State::Ok)];
    assert_eq!(picture(&world), (both(State::Error), 1, true));
    // The same batch again, as after a line that was cut.
    world.tell(Stream::Log, "v", vec![message(1, 1, Content::Keyframe(all.clone()))]);
    assert_eq!(picture(&world), (both(State::Error), 1, true));
    let over = Alarm { active: false, acknowledged: true, ..alarm };
    world.tell(
        Stream::Log,
        "v",
        vec![
            message(1, 4, Content::Gap(Gap { to: 8, why: GapReason::Overflow })),
            message(1, 9, Content::Alarm(over)),
        ],
    );
    assert_eq!(picture(&world), (both(State::Error), 0, false));
    world.tell(
        Stream::Log,
        "v",
        vec![
            message(1, 10, Content::Keyframe(all)),
            message(
                1,
                11,
                Content::Delta(NodeStates { stage, nodes: vec![node("b", State::Unknown, true)] }),
            ),
        ],
    );
    assert_eq!(picture(&world), (vec![("a".to_owned(), State::Ok)], 0, true));
}

#[test]
fn the_picture_follows_a_run_with_an_older_number() {
    let keyframe = |run, state| {
        let node =
            Node { node: "a".into(), state, own: state, cause: None, words: String::new(), gone: false };
        message(run, 1, Content::Keyframe(NodeStates { stage: Stage::Standby, nodes: vec![node] }))
    };
    let shown = |world: &World| {
        let picture = &world.fleet.vehicle(&id("v")).unwrap().picture;
        (picture.nodes["a"].state, picture.is_whole)
    };
    let mut world = World::new();
    world.head("v", 400, 1, head(State::Ok)).tell(Stream::Log, "v", vec![keyframe(400, State::Ok)]);
    // Its outbox is lost, and its clock is right again.
    world.after(60).head("v", 2, 1, head(State::Error));
    assert_eq!(shown(&world), (State::Ok, false), "of another run");
    world.tell(Stream::Log, "v", vec![keyframe(2, State::Error)]);
    assert_eq!(shown(&world), (State::Error, true));
    // It is enrolled again.
    let batch =
        Batch { id: id("v"), key: "UB".into(), sent: AT, messages: vec![keyframe(1, State::Warning)] };
    world.arrive(Stream::Log, "v", Ok(batch));
    assert_eq!(shown(&world), (State::Warning, true));
}

#[test]
fn incidents_are_grouped_over_the_fleet() {
    let incident = |number, cause: &str, version: &str| {
        Content::Incident(Incident {
            number,
            since: AT + number as i64,
            until: None,
            stage: "active".into(),
            causes: vec![cause.into()],
            triggers: 1,
            version: version.into(),
            config: "c0ffee".into(),
            bytes: 0,
            sha256: None,
        })
    };
    let mut world = World::new();
    world.tell(
        Stream::Log,
        "a",
        vec![
            message(1, 1, incident(1, "lidar", "0.1")),
            message(1, 2, incident(2, "gnss", "0.2")),
            // The same one with its end.
            message(1, 3, incident(2, "gnss", "0.2")),
        ],
    );
    world.tell(Stream::Log, "b", vec![message(1, 1, incident(1, "gnss", "0.2"))]);
    let groups = |by| -> Vec<(String, usize, usize)> {
        let groups = grouped(world.fleet.incidents(), by);
        groups.into_iter().map(|it| (it.group, it.count, it.vehicles.len())).collect()
    };
    assert_eq!(groups(GroupBy::Cause), [("gnss".to_owned(), 2, 2), ("lidar".to_owned(), 1, 1)]);
    assert_eq!(groups(GroupBy::Version), [("0.2".to_owned(), 2, 2), ("0.1".to_owned(), 1, 1)]);
    assert_eq!(groups(GroupBy::Config), [("c0ffee".to_owned(), 3, 2)]);
}

#[test]
fn the_log_is_read_from_a_keyframe_before_its_known_end_on() {
    let now = Timestamp::from_millis(1_000_000);
    let from = |log_ms| Fleet::new([], log_ms, Since::of_age(Span::ZERO, now)).log_from_ms(AT);
    assert_eq!((from(0), from(AT - 1000)), (0, AT - 901_000));
    assert_eq!(from(AT * 2), AT - 900_000, "the hub's clock was decades ahead");
}

#[test]
fn a_vehicle_that_tells_too_much_is_not_read_for_a_while_and_the_others_are() {
    let mut world = World::new();
    world.head("loud", 1, 1, head(State::Ok));
    world.head("other", 1, 1, head(State::Ok));
    for _ in 0..4 {
        assert!(world.fleet.reads(&id("loud"), world.now));
        world.fleet.has_read(&id("loud"), 4 << 20, world.now);
    }
    assert!(!world.fleet.reads(&id("loud"), world.now));
    assert!(world.fleet.reads(&id("other"), world.now));
    assert!(world.fleet.reads(&id("new"), world.now));
    let soon = world.now + Span::from_secs(1);
    assert!(world.fleet.reads(&id("loud"), soon));
    world.fleet.has_read(&id("loud"), 4 << 20, soon);
    // What was too much is made up for first.
    assert!(!world.fleet.reads(&id("loud"), soon + Span::from_millis(900)));
    assert!(world.fleet.reads(&id("loud"), soon + Span::from_millis(1_100)));
}

#[test]
fn a_vehicle_is_asked_for_live_data_twice_a_minute_while_somebody_looks() {
    let mut world = World::new();
    assert!(!world.fleet.look(&id("a"), world.now), "it was never heard");
    world.head("a", 1, 1, head(State::Ok));
    let asked: Vec<bool> = (0..4)
        .map(|_| {
            let now = world.now;
            world.after(15);
            world.fleet.look(&id("a"), now)
        })
        .collect();
    assert_eq!(asked, [true, false, true, false]);
}
