//! The sizes of answers, pages and messages at the bounds of the input: long names, long messages and
//! values, and many modules that wait for many causes.

use std::time::UNIX_EPOCH;

use telltale::engine::Engine;
use telltale::engine::input::{Input, StatusArray, WriterId};
use telltale::engine::model::Stage;
use telltale::engine::state::State;
use telltale::engine::time::Timestamp;
use telltale::record::file::KEYFRAMES;
use telltale::runtime::Published;
use telltale::store::Role;
use telltale::web::developer::{PageQuery, Window, coverage, graph, masking, statuses, topics, why};
use telltale::web::live::frame::Frames;
use telltale::web::texts::Lang;
use telltale::web::view::{PageContext, PagePart, Palette, RecorderState, Trends, operator_page};

use crate::by_hand;

const PAGE_BYTES: usize = 1 << 20;
const ANSWER_BYTES: usize = 16 << 20;
/// Of a developer's page. The address of a module is as long as its name, and stands in each of its links.
const DEVELOPER_BYTES: usize = 4 << 20;

fn engine(stage: Stage) -> Engine {
    let mut text = "defaults: { timeout: 1h }\ngroups:\n".to_owned();
    for group in 0..8 {
        let needs = if group == 0 { "" } else { "depends_on: [g0], " };
        text += &format!("- {{ id: g{group}, {needs}match: [{{ regex: '{group} .*' }}] }}\n");
    }
    let mut engine = Engine::new(by_hand::model(&text), Timestamp::ZERO);
    engine.start_in(stage);
    engine
}

/// Sends all of it in one message.
fn say(
    engine: &mut Engine,
    writer: u8,
    level: u8,
    words: &str,
    values: u32,
    names: impl Iterator<Item = String>,
) {
    let mut array = StatusArray::default();
    for name in names {
        array.push_status(level, &name, words, words);
        for value in 0..values {
            array.push_value(&format!("{value} {words}"), words);
        }
    }
    let input = Input::Diagnostics(array.said_by(WriterId([writer; 16])));
    engine.handle(&input, Timestamp::from_millis(10));
}

/// A vehicle that says long words in letters of this kind; in its first group with long names too.
fn flooded(stage: Stage, letter: char, levels: [u8; 2], values: u32, others: u32) -> Published {
    let mut engine = engine(stage);
    let words = |bytes: usize| -> String { std::iter::repeat_n(letter, bytes / letter.len_utf8()).collect() };
    let (long, said) = if values > 0 { (words(4000), words(400)) } else { (words(1000), words(4000)) };
    say(&mut engine, 1, levels[0], &said, values, (0..100).map(|it| format!("0 {it} {long}")));
    say(
        &mut engine,
        2,
        levels[1],
        &said,
        values,
        (0..others).map(|it| format!("{} {it} {letter}", 1 + it % 7)),
    );
    Published::recorded(engine.snapshot(), UNIX_EPOCH)
}

fn context() -> PageContext {
    PageContext {
        lang: Lang::De,
        palette: Palette::Day,
        user: "dora".into(),
        role: Role::Developer,
        demo: false,
        configuration: true,
        recorder: Some(RecorderState::Recording),
        replay: false,
        part: PagePart::Whole,
    }
}

#[track_caller]
fn check(what: &str, bytes: usize, most: usize) {
    println!("{what}: {bytes} bytes");
    assert!(bytes <= most, "{what}: {bytes} bytes");
}

fn check_all(case: &str, published: &Published) {
    let frames = Frames::default();
    let trends = Trends::default();
    for lang in Lang::ALL {
        check(
            &format!("{case}: message to a page"),
            frames.html(published, lang, &trends).full().len(),
            PAGE_BYTES,
        );
    }
    let seen = frames.observe(published);
    check(&format!("{case}: page"), operator_page(published, &seen, &context(), &trends).len(), PAGE_BYTES);
    let snapshot = &published.snapshot;
    let pairs = |pairs: &[(&str, &str)]| pairs.iter().map(|(a, b)| ((*a).into(), (*b).into())).collect();
    let asked = PageQuery::of(pairs(&[("open", "all"), ("cell", "0 g0")]));
    let node = |name: &str| snapshot.node(name).unwrap();
    let named = |group: &str| {
        let of_group = |id: &_| snapshot.module(*id).0.id.starts_with(group);
        snapshot.module_ids().find(of_group).map(|id| snapshot.module(id).0.id.to_string()).unwrap()
    };
    let why = |name: &str| {
        let query = PageQuery::of(pairs(&[("node", name)]));
        let window = Window::over(published, &query, 300);
        let read = why::NodeRead::default();
        why::page((published, &trends), node(name), &context(), (&query, &window), &read)
    };
    for (page, text) in [
        ("statuses", statuses::page(published, &context(), &asked, &trends)),
        ("graph", graph::page(published, &context(), &asked)),
        ("masking", masking::page(published, &context(), &asked)),
        ("coverage", coverage::page(published, &context(), &asked)),
        ("topics", topics::page(published, &context(), &asked, &Default::default(), None)),
        ("why, group", why("g1")),
        ("why, module", why(&named("g0/"))),
        ("why, masked", why(&named("g1/"))),
    ] {
        check(&format!("{case}: {page}"), text.len(), DEVELOPER_BYTES);
    }
}

fn answer(case: &str, published: &Published) -> serde_json::Value {
    let json = Frames::default().json(published);
    check(&format!("{case}: answer"), json.len(), ANSWER_BYTES);
    serde_json::from_str(json.as_str()).unwrap()
}

#[test]
fn pages_and_their_messages_are_bounded() {
    for (case, stage, letter, levels) in [
        ("all that fail", Stage::Active, '<', [2, 2]),
        ("warnings before a clearance", Stage::Standby, '<', [1, 1]),
        ("letters of four bytes", Stage::Active, '\u{1F68C}', [0, 2]),
        ("backslashes", Stage::Standby, '\\', [2, 1]),
    ] {
        check_all(case, &flooded(stage, letter, levels, 9, 420));
    }
}

#[test]
fn an_answer_leaves_out_what_makes_it_too_large() {
    // Each of the thousands of waiting modules names its causes, whose names are long.
    let masked = flooded(Stage::Active, 'w', [2, 2], 0, 3996);
    let said = answer("many causes", &masked);
    assert_eq!((said["left_out"].as_str(), said["overall"].as_str()), (Some("words"), Some("error")));
    let modules = |group: usize| said["groups"][group]["modules"].as_array().unwrap().clone();
    assert!(modules(1).len() > 500);
    for module in modules(1) {
        assert_eq!(module["reason"]["by"].as_array().map_or(1, Vec::len), 1, "{module}");
        assert!(module["message"].as_str().unwrap().len() <= 200, "{module}");
    }
    // Messages whose letters take six bytes each.
    let said = answer("control characters", &flooded(Stage::Active, '\u{1}', [2, 2], 0, 3996));
    assert_eq!((said["left_out"].as_str(), said["stage"].as_str()), (Some("modules"), Some("active")));
    let said = answer("few", &{
        let mut engine = engine(Stage::Active);
        say(&mut engine, 1, 0, "fine", 2, std::iter::once("1 a".to_owned()));
        Published::recorded(engine.snapshot(), UNIX_EPOCH)
    });
    assert_eq!(said.get("left_out"), None);
}

#[test]
fn long_names_take_the_room_of_many() {
    let mut engine = engine(Stage::Active);
    let name = |number| format!("1 {number} {}", "n".repeat(4000));
    say(&mut engine, 1, 0, "", 0, (0..4096).map(name));
    let snapshot = engine.snapshot();
    let names: usize = snapshot.module_ids().map(|id| snapshot.module(id).0.id.len()).sum();
    assert!(names <= (1 << 20) + 4096, "{names} bytes of names");
    let dropped = snapshot.node("g1/(names past the limit)").unwrap();
    let telltale::engine::model::NodeId::Module(dropped) = dropped else { panic!("it is a module") };
    let (_, dropped) = snapshot.module(dropped);
    assert_eq!(dropped.own, State::Warning);
    let said = &*dropped.report.message;
    assert!(said.contains("names are too long") && said.contains("256 bytes for each"), "{said}");
    assert!(snapshot.counters.dropped_names > 3000);
}

#[test]
fn the_state_of_a_large_vehicle_fits_into_a_recording() {
    let text = "limits: { discovered_modules: 100000 }\ngroups: [{ id: g0, match: [{ regex: '.*' }] }]\n";
    let mut large = Engine::new(by_hand::model(text), Timestamp::ZERO);
    for part in 0..10 {
        let names = (0..10_000).map(|it| format!("0 sensors/lidar_{part}_{it}: connection"));
        say(&mut large, part, 1, "the rate is too low", 4, names);
    }
    let state = |engine: &Engine| serde_json::to_string(&engine.keyframe()).unwrap().len();
    check("100,000 modules: state", state(&large), KEYFRAMES.bytes_max);
    // As much as is ever kept of what a vehicle says at the default limits.
    let mut talkative = engine(Stage::Active);
    let words = "w".repeat(4000);
    say(&mut talkative, 1, 2, &words, 0, (0..4000).map(|it| format!("0 {it}")));
    say(&mut talkative, 2, 2, &words, 0, (0..4000).map(|it| format!("1 {it}")));
    for (writer, group) in [(1, 0), (2, 1)] {
        say(&mut talkative, writer, 2, &words, 3, (0..2048).map(|it| format!("{group} {it}")));
    }
    check("long words: state", state(&talkative), KEYFRAMES.bytes_max);
}
