//! Whatever goes wrong between a vehicle and a console, the console's history is the vehicle's, with its gaps declared.

use std::collections::BTreeMap;

use proptest::prelude::*;
use rusqlite::Connection;
use telltale_engine::model::Stage;
use telltale_engine::time::{Span, Timestamp};

use crate::delivery::{Answer, Delivery, Last, Learned, Order, Said};
use crate::history::History;
use crate::message::{
    Alarm, AuditHead, Batch, Content, Epoch, Gap, GapReason, Incident, Mark, Message, NodeStates, VehicleId,
    possible_ms,
};
use crate::outbox::{Limits, Outbox, Seed};

const KEY: &str = "UA";
const AT_MS: i64 = 1_780_000_000_000;

/// What happens next.
#[derive(Debug, Clone)]
enum Step {
    /// The vehicle tells something; the number says what.
    Tell(u8),
    /// The vehicle does what its delivery orders, and the line does this to it.
    Work(Line),
    /// A batch that was held up on the way arrives.
    Late,
    Cut,
    /// The hub goes on from a copy of its store that is this many messages old.
    RollBack(usize),
    Restart,
    /// Time passes, in seconds.
    Pass(u64),
    /// Somebody sets the vehicle's wall clock.
    SetClock(i64),
    /// The console reads what is new.
    Read,
}

/// What the line does to a request.
#[derive(Debug, Clone, Copy)]
enum Line {
    Good,
    /// The hub takes it, and its answer is lost.
    AnswerLost,
    /// It never arrives.
    Lost,
    /// It arrives later, when nobody waits for its answer any more.
    HeldUp,
    /// It arrives twice.
    Twice,
    Refused,
}

fn step() -> impl Strategy<Value = Step> {
    let line = prop_oneof![
        8 => Just(Line::Good),
        2 => Just(Line::AnswerLost),
        1 => Just(Line::Lost),
        1 => Just(Line::HeldUp),
        1 => Just(Line::Twice),
        1 => Just(Line::Refused),
    ];
    prop_oneof![
        12 => (0..12_u8).prop_map(Step::Tell),
        12 => line.prop_map(Step::Work),
        1 => Just(Step::Late),
        1 => Just(Step::Cut),
        1 => (0..6_usize).prop_map(Step::RollBack),
        1 => Just(Step::Restart),
        2 => (1..900_u64).prop_map(Step::Pass),
        1 => (-100_000_000..100_000_000_i64).prop_map(Step::SetClock),
        2 => Just(Step::Read),
    ]
}

/// The subject of the vehicle at the hub.
#[derive(Debug, Default)]
struct Hub {
    /// With their numbers, which go back when the store does.
    stored: Vec<(u64, Vec<u8>)>,
}

impl Hub {
    fn last(&self) -> u64 {
        self.stored.last().map_or(0, |(number, _)| *number)
    }

    fn publish(&mut self, after: u64, batch: &[u8]) -> Answer {
        if after != self.last() {
            return Answer::WrongLast;
        }
        // Other vehicles publish meanwhile.
        let number = self.last() + 3;
        self.stored.push((number, batch.to_vec()));
        Answer::Stored(number)
    }
}

struct World {
    id: VehicleId,
    outbox: Option<Outbox>,
    limits: Limits,
    delivery: Delivery,
    hub: Hub,
    held_up: Option<(u64, Vec<u8>)>,
    console: History,
    /// How many of the hub's messages the console has read.
    read: usize,
    now: Timestamp,
    wall_ms: i64,
    /// What the vehicle told.
    told: BTreeMap<Mark, Content>,
    starts: u32,
    /// Nothing ever made a gap necessary.
    is_whole: bool,
}

impl World {
    fn new(bytes: u64) -> World {
        let limits = Limits { bytes, ..Limits::default() };
        let connection = Connection::open_in_memory().unwrap();
        let seed = Seed { first: 40, nonce: 1 };
        World {
            id: VehicleId::new("a").unwrap(),
            outbox: Some(Outbox::over(connection, limits, seed, Timestamp::ZERO).unwrap()),
            limits,
            delivery: connected(),
            hub: Hub::default(),
            held_up: None,
            console: History::default(),
            read: 0,
            now: Timestamp::ZERO,
            wall_ms: AT_MS,
            told: BTreeMap::new(),
            starts: 1,
            is_whole: bytes > 1_000_000,
        }
    }

    fn outbox(&mut self) -> &mut Outbox {
        self.outbox.as_mut().unwrap()
    }

    fn take(&mut self, step: &Step) {
        let (now, at_ms) = (self.now, possible_ms(self.wall_ms));
        match *step {
            Step::Tell(what) => {
                let content = content(what);
                let mark = self.outbox().push(at_ms, std::slice::from_ref(&content), now).unwrap();
                self.told.insert(mark, content);
            }
            Step::Work(line) => {
                self.work(line);
            }
            Step::Late => {
                if let Some((after, batch)) = self.held_up.take() {
                    self.hub.publish(after, &batch);
                }
            }
            Step::Cut => self.cut(),
            Step::RollBack(by) => {
                let kept = self.hub.stored.len().saturating_sub(by);
                self.hub.stored.truncate(kept);
                self.read = self.read.min(kept);
                // It was started anew: what was on its way to it is lost.
                self.held_up = None;
                self.cut();
            }
            Step::Restart => {
                self.starts += 1;
                let connection = self.outbox.take().unwrap().into_connection();
                let seed = Seed { first: 0, nonce: 1_000_000_007_u32.wrapping_mul(self.starts) };
                self.now = Timestamp::ZERO;
                self.outbox = Some(Outbox::over(connection, self.limits, seed, self.now).unwrap());
                self.delivery = connected();
            }
            Step::Pass(seconds) => {
                self.now = now + Span::from_secs(seconds);
                self.wall_ms += 1000 * seconds.cast_signed();
                let now = self.now;
                self.outbox().tidy(at_ms, now).unwrap();
                // From now on a hub that is rolled back may have lost what is gone here.
                self.is_whole = false;
            }
            Step::SetClock(seconds) => self.wall_ms += 1000 * seconds,
            Step::Read => self.read(),
        }
    }

    fn cut(&mut self) {
        self.delivery.disconnected();
        self.delivery.connected();
    }

    /// Whether there was something to do.
    fn work(&mut self, line: Line) -> bool {
        let (now, at_ms) = (self.now, possible_ms(self.wall_ms));
        let has_unsent = self.outbox().has_unsent().unwrap();
        let answer = match self.delivery.order(has_unsent, now) {
            Order::Rest => return false,
            Order::Until(then) => {
                self.now = then;
                return true;
            }
            Order::Ask => {
                self.delivery.asks();
                match line {
                    Line::Good | Line::Twice => self.own_last(),
                    Line::Refused => Answer::Refused,
                    Line::AnswerLost | Line::Lost | Line::HeldUp => Answer::Silence,
                }
            }
            Order::Send { after } => {
                let (id, bytes) = (self.id.clone(), self.delivery.batch_bytes());
                let pending = self.outbox().batch(&id, KEY, at_ms, bytes).unwrap().unwrap();
                self.delivery.sends(pending.end, pending.packed.len(), now);
                let packed = &pending.packed;
                match line {
                    Line::Good => self.hub.publish(after, packed),
                    Line::AnswerLost => {
                        self.hub.publish(after, packed);
                        Answer::Silence
                    }
                    Line::Lost => Answer::Silence,
                    Line::HeldUp => {
                        self.held_up = Some((after, packed.clone()));
                        Answer::Silence
                    }
                    Line::Twice => {
                        self.hub.publish(after, packed);
                        self.hub.publish(after, packed)
                    }
                    Line::Refused => Answer::Refused,
                }
            }
        };
        match self.delivery.answered(&answer, now) {
            Learned::Nothing => {}
            Learned::HubHas(last) => self.outbox().hub_has(last, at_ms, now).unwrap(),
            Learned::TwoVehicles => panic!("there is one vehicle"),
        }
        true
    }

    fn own_last(&mut self) -> Answer {
        let Some((sequence, packed)) = self.hub.stored.last().cloned() else { return Answer::Nothing };
        let batch = Batch::unpack(&packed, &self.id).unwrap();
        let end = batch.end().unwrap();
        let known = self.outbox().knows(end).unwrap();
        Answer::Last(Last { sequence, said: Some(Said { key: batch.key, end, known }) })
    }

    fn read(&mut self) {
        for (_, packed) in &self.hub.stored[self.read..] {
            let taken = self.console.take(Batch::unpack(packed, &self.id).unwrap());
            assert_eq!(taken.contradictions, 0);
        }
        self.read = self.hub.stored.len();
    }

    fn check(mut self) {
        self.cut();
        let mut rounds = 0;
        while self.work(Line::Good) {
            rounds += 1;
            assert!(rounds < 1000, "it never ends");
        }
        self.read();
        let mut places: BTreeMap<Mark, Option<Content>> = BTreeMap::new();
        for message in self.console.messages() {
            places.insert(message.mark(), Some(message.content.clone()));
        }
        for unknown in self.console.unknown() {
            assert!(unknown.why.is_some(), "a hole that nobody declared: {unknown:?}");
            for n in unknown.from.n..=unknown.to {
                let place = places.insert(Mark { n, ..unknown.from }, None);
                assert_eq!(place, None, "known and unknown");
            }
        }
        assert_eq!(
            places.keys().collect::<Vec<_>>(),
            self.told.keys().collect::<Vec<_>>(),
            "the console knows of exactly the places that the vehicle told"
        );
        for (mark, content) in &self.told {
            match &places[mark] {
                Some(known) => assert_eq!(known, content),
                None => assert!(!self.is_whole, "nothing made a gap necessary at {mark:?}"),
            }
        }
    }
}

fn connected() -> Delivery {
    let mut delivery = Delivery::new(KEY, 64);
    delivery.connected();
    delivery
}

fn content(what: u8) -> Content {
    let words = "x".repeat(usize::from(what) * 20);
    match what {
        0..=7 => Content::Delta(NodeStates {
            stage: Stage::Active,
            nodes: vec![crate::message::Node {
                node: "lidar/front".into(),
                state: telltale_engine::state::State::Error,
                own: telltale_engine::state::State::Error,
                cause: None,
                words,
                gone: false,
            }],
        }),
        8 => Content::Keyframe(NodeStates { stage: Stage::Standby, nodes: Vec::new() }),
        9 => Content::Alarm(Alarm {
            number: 4,
            node: "gnss/fix".into(),
            active: true,
            acknowledged: false,
            words,
        }),
        10 => Content::AuditHead(AuditHead { record: 12, hash: words }),
        _ => Content::Incident(Incident {
            number: 3,
            since: AT_MS,
            until: None,
            stage: "active".into(),
            causes: vec![words],
            triggers: 1,
            version: "0.1.0".into(),
            config: String::new(),
            bytes: 9,
            sha256: None,
        }),
    }
}

/// 10,000 cases in halves that run side by side.
fn cases() -> u32 {
    std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(5_000)
}

fn any_faults(bytes: u64) {
    let config = ProptestConfig { cases: cases(), failure_persistence: None, ..ProptestConfig::default() };
    proptest!(config, |(steps in proptest::collection::vec(step(), 1..50))| {
        let mut world = World::new(bytes);
        for step in &steps {
            world.take(step);
        }
        world.check();
    });
}

#[test]
fn the_history_of_a_console_is_that_of_the_vehicle() {
    any_faults(100_000_000);
}

#[test]
fn it_is_that_of_the_vehicle_with_gaps_where_the_outbox_is_full() {
    any_faults(1_500);
}

fn outbox(limits: Limits) -> Outbox {
    let connection = Connection::open_in_memory().unwrap();
    Outbox::over(connection, limits, Seed { first: 1, nonce: 2 }, Timestamp::ZERO).unwrap()
}

fn waiting(outbox: &mut Outbox) -> Vec<Message> {
    let id = VehicleId::new("a").unwrap();
    let pending = outbox.batch(&id, KEY, AT_MS, usize::MAX).unwrap().expect("something waits");
    Batch::unpack(&pending.packed, &id).unwrap().messages
}

#[test]
fn changes_go_before_alarms_and_leave_gaps() {
    let mut outbox = outbox(Limits { bytes: 2_000, ..Limits::default() });
    for what in [9, 1, 1, 1, 10, 1, 1, 1, 8, 1, 1, 11, 1, 1] {
        outbox.push(AT_MS, &[content(what)], Timestamp::ZERO).unwrap();
    }
    let kinds: Vec<(u64, u64, bool)> = waiting(&mut outbox)
        .iter()
        .map(|it| {
            (it.n, it.end().n, matches!(it.content, Content::Gap(Gap { why: GapReason::Overflow, .. })))
        })
        .collect();
    assert!(outbox.bytes() <= 2_000);
    let gaps: Vec<_> = kinds.iter().filter(|(.., is_gap)| *is_gap).collect();
    assert!(gaps.contains(&&(2, 4, true)) && gaps.iter().any(|(from, ..)| *from == 6), "{kinds:?}");
    for whole in [1, 5, 12] {
        assert!(kinds.contains(&(whole, whole, false)), "{kinds:?}");
    }
}

#[test]
fn what_waited_for_fourteen_days_is_a_gap() {
    let mut outbox = outbox(Limits::default());
    for what in [9, 1, 10] {
        outbox.push(AT_MS, &[content(what)], Timestamp::ZERO).unwrap();
    }
    let later = Timestamp::ZERO + Span::from_secs(14 * 24 * 3600 + 60);
    outbox.push(AT_MS, &[content(9)], later).unwrap();
    outbox.tidy(AT_MS, later).unwrap();
    let ends: Vec<(u64, u64)> = waiting(&mut outbox).iter().map(|it| (it.n, it.end().n)).collect();
    assert_eq!(ends, [(1, 3), (4, 4)]);
}

#[test]
fn a_message_that_no_batch_holds_is_a_gap() {
    let mut outbox = outbox(Limits::default());
    let mut words = String::new();
    let mut random = 1_u64;
    while words.len() < 600_000 {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        words.push_str(&format!("{random:x}"));
    }
    let alarm = Alarm { number: 1, node: "a".into(), active: true, acknowledged: false, words };
    outbox.push(AT_MS, &[Content::Alarm(alarm)], Timestamp::ZERO).unwrap();
    assert_eq!(waiting(&mut outbox)[0].content, Content::Gap(Gap { to: 1, why: GapReason::TooLarge }));
}

#[test]
fn a_copied_outbox_does_not_know_the_messages_of_its_original() {
    let mut first = outbox(Limits::default());
    let mark = first.push(AT_MS, &[content(1)], Timestamp::ZERO).unwrap();
    let mut copy = Connection::open_in_memory().unwrap();
    {
        let original = first.into_connection();
        let backup = rusqlite::backup::Backup::new(&original, &mut copy).unwrap();
        backup.run_to_completion(100, std::time::Duration::ZERO, None).unwrap();
        drop(backup);
        first =
            Outbox::over(original, Limits::default(), Seed { first: 1, nonce: 3 }, Timestamp::ZERO).unwrap();
    }
    let copy = Outbox::over(copy, Limits::default(), Seed { first: 1, nonce: 4 }, Timestamp::ZERO).unwrap();
    let of_first = first.push(AT_MS, &[content(1)], Timestamp::ZERO).unwrap();
    assert!(copy.knows(mark).unwrap() && !copy.knows(of_first).unwrap());
    let beyond = Mark { n: mark.n + 1, epoch: Epoch { start: 1, nonce: 2 } };
    assert!(!copy.knows(beyond).unwrap(), "what the original told after the copy");
}
