//! Tests of what the ring holds and forgets.

use super::*;
use telltale_engine::input::StatusArray;
use telltale_engine::model::{Model, Other, Parts, StageModel};
use telltale_msg::cdr::Endian;

fn message(topic: &str, bytes: usize) -> Arc<Message> {
    Arc::new(Message {
        topic: topic.into(),
        type_name: "std_msgs/msg/String".into(),
        writer: [1; 16],
        sequence: 1,
        source: None,
        received: std::time::SystemTime::UNIX_EPOCH,
        body: Ok((vec![0; bytes].into(), Endian::Little)),
        left_out: 0,
        kept: false,
    })
}

fn push(ring: &mut Ring, at_ms: u64, topic: &str, bytes: usize) {
    let at = Timestamp::from_millis(at_ms);
    ring.push_input(Stamped { input: Input::Tick, received: at, message: Some(message(topic, bytes)) });
}

fn kept(ring: &Ring) -> Vec<(u64, bool)> {
    let entries = ring.entries.iter();
    entries.map(|entry| (entry.at.as_nanos() / 1_000_000, entry.message.is_some())).collect()
}

#[test]
fn the_oldest_make_room_and_a_large_topic_takes_its_own_past() {
    let mut ring = Ring::new(100_000);
    push(&mut ring, 0, "/small", 10);
    for at in 1..=6 {
        push(&mut ring, at, "/large", 20_000);
    }
    assert_eq!(
        kept(&ring),
        [(0, true), (1, false), (2, false), (3, false), (4, false), (5, true), (6, true)],
        "the order stays, only bytes are gone"
    );
    let held = ring.meter(Timestamp::from_millis(10));
    assert_eq!((held[0].messages, held[0].dropped), (2, 4));
    assert_eq!((&*held[1].topic, held[1].span), ("/small", Span::from_millis(10)));
    assert_eq!(held[0].dropped_age, Some(Span::from_millis(6)));
    let is_short = |wanted_ms| held.iter().map(move |it| it.is_short_of(Span::from_millis(wanted_ms)));
    assert!(is_short(6).all(|it| !it) && is_short(7).eq([true, false]));
    for at in 7..=100 {
        push(&mut ring, at, &format!("/t{at}"), 10_000);
    }
    assert!(ring.bytes() <= 100_000 && ring.bytes() > 80_000, "{}", ring.bytes());
    let sum: usize = ring.entries.iter().map(|it| it.message.as_ref().map_or(0, |it| it.len())).sum();
    let messages = ring.entries.iter().filter(|it| it.message.is_some()).count();
    let entries = (ENTRY_BYTES + INPUT_BYTES) * ring.entries.len();
    assert_eq!(ring.bytes(), sum + MESSAGE_BYTES * messages + entries);
    let (entries, gone) = ring.read(3, usize::MAX);
    assert_eq!(entries.len() as u64 + gone, 101 - 3);
    assert_eq!(ring.read(ring.next(), usize::MAX).0.len(), 0);
    assert_eq!(ring.read(ring.first, 1).0.len(), 1, "one always, that the reader gets on");
}

#[test]
fn topics_that_come_and_go_keep_no_place_of_one_that_comes_later() {
    let mut ring = Ring::new(10_000_000);
    push(&mut ring, 0, "/first", 100);
    assert_eq!(ring.forgot_topic(Timestamp::ZERO), None);
    for at in 1..=2 * TOPICS_MAX as u64 {
        push(&mut ring, at, &format!("/session{at}"), 100);
        push(&mut ring, at, "/steady", 100);
    }
    push(&mut ring, 5000, "/camera", 100);
    let held = ring.meter(Timestamp::from_millis(5000));
    assert_eq!(held.len(), TOPICS_MAX);
    assert_eq!(ring.forgot_topic(Timestamp::from_millis(5001)), Some(Span::from_millis(1)));
    let messages = |topic: &str| held.iter().find(|it| &*it.topic == topic).map(|it| it.messages);
    assert_eq!([messages("/camera"), messages("/first")], [Some(1), None]);
    assert_eq!(messages("/steady"), Some(2 * TOPICS_MAX));
    let with_message = ring.entries.iter().filter(|it| it.message.is_some()).count();
    assert_eq!(
        ring.bytes(),
        (100 + MESSAGE_BYTES) * with_message + (ENTRY_BYTES + INPUT_BYTES) * ring.entries.len()
    );
}

#[test]
fn inputs_of_one_message_share_its_bytes() {
    const ONE: usize = ENTRY_BYTES + INPUT_BYTES;
    let mut ring = Ring::new(1000 * ONE);
    let shared = message("/a", 100 * ONE);
    for at in 0..3 {
        let received = Timestamp::from_millis(at);
        ring.push_input(Stamped { input: Input::Tick, received, message: Some(shared.clone()) });
    }
    assert_eq!(ring.bytes(), 103 * ONE + MESSAGE_BYTES);
    ring.set_bytes_max(150 * ONE);
    push(&mut ring, 5, "/a", 10);
    assert_eq!(kept(&ring), [(0, false), (1, false), (2, false), (5, true)]);
}

#[test]
fn states_of_a_large_vehicle_leave_half_of_the_memory_to_what_was_received() {
    let mut parts = Parts { other: Other::Counted, ..Parts::empty("v", StageModel::None) };
    parts.limits.discovered_modules = 1000;
    let mut engine = Engine::begin(Arc::new(Model::new(parts).unwrap()), Timestamp::ZERO);
    let mut array = StatusArray::default();
    for module in 0..1000 {
        array.push_status(0, &format!("module {module}"), &"as it is ".repeat(100), "");
    }
    engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(1));
    let engine = Arc::new(engine);
    assert!(engine.memory() > 1_000_000, "{}", engine.memory());
    let bytes_max = 6 * engine.memory();
    let mut ring = Ring::new(bytes_max);
    for at_ms in (0..300_000).step_by(100) {
        if at_ms % 10_000 == 0 {
            let mut engine = Engine::clone(&engine);
            engine.handle(&Input::Tick, Timestamp::from_millis(at_ms));
            ring.push_keyframe(Arc::new(engine));
        }
        push(&mut ring, at_ms, "/a", 2_000);
        assert!(ring.bytes() <= bytes_max && ring.keyframe_bytes <= bytes_max / 2);
    }
    assert!(ring.keyframes.len() >= 2, "{:?}", ring.keyframes);
    let states = ring.entries.iter().filter(|it| matches!(it.taken, Taken::Keyframe(Some(_)))).count();
    assert_eq!(states, ring.keyframes.len());
}

#[test]
fn a_recording_begins_with_a_state_whose_inputs_are_all_there() {
    let model = Arc::new(Model::new(Parts::empty("v", StageModel::None)).unwrap());
    let mut ring = Ring::new(1 << 20);
    let seconds = |s: u64| Timestamp::from_nanos(s * 1_000_000_000);
    for s in (0..=600).step_by(10) {
        ring.push_keyframe(Arc::new(Engine::begin(model.clone(), seconds(s))));
        push(&mut ring, s * 1000, "/a", 1);
    }
    let starts: Vec<_> = ring.keyframes.iter().map(|(_, at)| at.as_nanos() / 1_000_000_000).collect();
    assert!(starts.len() < 15 && starts[0] >= 300, "{starts:?}");
    assert!(starts.windows(2).all(|pair| pair[1] - pair[0] <= 60), "{starts:?}");
    assert!(starts.ends_with(&[540, 550, 560, 570, 580, 590, 600]), "{starts:?}");
    let before = |s| ring.keyframe_before(seconds(s)).unwrap();
    assert_eq!(before(575), (2 * 57, seconds(570)));
    let (entries, _) = ring.read(2 * 57, usize::MAX);
    assert!(matches!(&entries[0].taken, Taken::Keyframe(Some(engine)) if engine.now() == seconds(570)));
    let states = ring.entries.iter().filter(|it| matches!(it.taken, Taken::Keyframe(Some(_)))).count();
    assert_eq!(states, starts.len(), "the others are let go");
    assert_eq!(before(1).1, seconds(starts[0]), "the oldest, if none is old enough");
}
