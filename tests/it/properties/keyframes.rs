//! An engine that is loaded from a keyframe goes the same way as the engine that made the keyframe, through
//! everything that can happen. A damaged keyframe is refused or does no harm.

use std::collections::BTreeSet;
use std::sync::Arc;

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::strategy::ValueTree as _;
use proptest::test_runner::TestRunner;
use serde_json::Value;
use telltale::engine::Engine;
use telltale::engine::event::Event;
use telltale::engine::input::{Input, Response};
use telltale::engine::keyframe::Keyframe;
use telltale::engine::model::monitors::{Class, Condition, TopicId, ValueSource};
use telltale::engine::model::motion::{Stop, WatchedField};
use telltale::engine::model::sample::FieldValue;
use telltale::engine::model::{
    GroupId, Model, ModuleMonitor, ModuleSpec, MonitorSpec, Parts, SignalSource, SignalSpec, Stage,
};
use telltale::engine::snapshot::Snapshot;
use telltale::engine::text::Text;
use telltale::engine::time::{Span, Timestamp};

use super::cases::{self, Choices};
use super::files::history_of_all;
use super::{config, numbers};

use crate::by_hand;

pub enum Step {
    Take(Input),
    Reload(Arc<Model>),
}

/// A vehicle with everything that has a state of its own.
pub fn model(choices: &mut Choices<'_>) -> Arc<Model> {
    cases::model_that(choices, |parts| {
        parts.driving.goal = Some(WatchedField { topic: TopicId(1), field: 1 });
        let stop = |x_m: f64| Stop {
            id: format!("stop{x_m}").into(),
            name: Text::plain("Stop"),
            x_m,
            y_m: 0.0,
            yaw_deg: 0.0,
        };
        parts.driving.stops = vec![stop(0.0), stop(30.0)];
        add_signals(parts);
        // The name of a status that resembles received ones.
        let id = format!("{}/resembling", parts.groups[0].path);
        let monitor = ModuleMonitor::SelfState("stray 0".into());
        let policy = parts.discovered.clone();
        parts.modules.push(ModuleSpec { policy, ..ModuleSpec::new(&id, GroupId(0), monitor) });
        parts.limits.status_bytes = 300;
        parts.limits.source_bytes = 200;
    })
}

/// An event, a level that becomes unknown, and a condition over two values.
fn add_signals(parts: &mut Parts) {
    let like = parts.signals[0].clone();
    parts.signals[0].timeout = Some(Span::from_millis(900));
    parts.signals.push(SignalSpec {
        name: "goal".into(),
        present_for: Some(Span::from_millis(400)),
        ..like.clone()
    });
    let number = |topic| ValueSource::Field { topic: TopicId(topic), field: 0 };
    let is_larger = Condition::new("x > y", |values| match values {
        [FieldValue::Number(x), FieldValue::Number(y)] => Ok(x > y),
        _ => Err("no numbers".into()),
    });
    let condition = MonitorSpec::Expression {
        inputs: vec![("x".into(), number(0)), ("y".into(), number(2))],
        max_age: Span::from_millis(700),
        warning: None,
        error: Some(is_larger),
        class: Class { location: "contextual", information: "content", flow: None },
    };
    let source = SignalSource::Condition(Box::new(condition));
    parts.signals.push(SignalSpec { name: "larger".into(), source, ..like });
}

/// Inputs, and configurations among them: the same one and others.
pub fn story(choices: &mut Choices<'_>, numbers: &[u32]) -> Vec<(Timestamp, Step)> {
    let others: Vec<u32> = numbers.iter().rev().copied().collect();
    let first = model(&mut Choices::new(numbers));
    let reloads: Vec<(usize, Arc<Model>)> = (0..choices.below(3))
        .map(|_| {
            let place = choices.below(60);
            (place, if choices.one_in(2) { first.clone() } else { model(&mut Choices::new(&others)) })
        })
        .collect();
    let inputs = history_of_all(choices).into_iter();
    let mut steps: Vec<(Timestamp, Step)> = inputs.map(|(at, input)| (at, Step::Take(input))).collect();
    for (place, model) in reloads {
        let place = place % (steps.len() + 1);
        let at = steps.get(place).or(steps.last()).map_or(Timestamp::ZERO, |(at, _)| *at);
        steps.insert(place, (at, Step::Reload(model)));
    }
    // What is remembered for long, and what only another configuration asks for.
    let end = steps.last().map_or(Timestamp::ZERO, |(at, _)| *at);
    steps.push((end + Span::from_millis(50), Step::Reload(first)));
    steps.extend([1, 4, 12, 30].map(|secs| (end + Span::from_secs(secs), Step::Take(Input::Tick))));
    steps
}

pub fn start(choices: &mut Choices<'_>, model: &Arc<Model>) -> Engine {
    let mut engine = match choices.below(4) {
        0 => Engine::begin(model.clone(), Timestamp::ZERO),
        1 => {
            let mut before = Engine::new(model.clone(), Timestamp::ZERO);
            before.start_in(Stage::Active);
            cases::history(choices).iter().take(20).for_each(|(at, input)| {
                before.handle(input, *at);
            });
            Engine::resume(model.clone(), &before.snapshot().to_restore(), Timestamp::ZERO)
        }
        _ => Engine::new(model.clone(), Timestamp::ZERO),
    };
    if choices.one_in(4) {
        engine.start_in(Stage::ALL[choices.below(5)]);
    }
    if choices.one_in(2) {
        engine.keep_events();
    }
    engine
}

/// What can be seen of an engine.
type Seen = (Snapshot, Option<Timestamp>, u64, u64);

fn seen(engine: &mut Engine) -> Seen {
    let snapshot = Snapshot::clone(&engine.snapshot());
    (snapshot, engine.next_deadline(), engine.seq(), engine.revision())
}

/// Takes a step, after the deadlines before it. Returns what is seen after each.
fn take(engine: &mut Engine, at: Timestamp, step: &Step) -> (Vec<Seen>, Response, Vec<Event>) {
    let mut all = Vec::new();
    while let Some(due) = engine.next_deadline().filter(|due| *due < at) {
        engine.handle(&Input::Tick, due);
        all.push(seen(engine));
    }
    let response = match step {
        Step::Take(input) => engine.handle(input, at),
        Step::Reload(model) => {
            engine.reload(model.clone(), at);
            Response::Done
        }
    };
    all.push(seen(engine));
    (all, response, engine.take_events())
}

fn written(engine: &Engine) -> String {
    serde_json::to_string(&engine.keyframe()).expect("every keyframe can be written")
}

fn loaded(model: &Arc<Model>, text: &str) -> Engine {
    let keyframe: Keyframe = serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"));
    Engine::from_keyframe(model.clone(), &keyframe).unwrap_or_else(|error| panic!("{error}: {text}"))
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn a_loaded_keyframe_goes_the_same_way(numbers in numbers(), pick in any::<usize>()) {
        let mut choices = Choices::new(&numbers);
        let mut model = model(&mut choices);
        let mut engine = start(&mut choices, &model);
        let story = story(&mut choices, &numbers);
        let (past, future) = story.split_at(pick % (story.len() + 1));
        for (index, (at, step)) in past.iter().enumerate() {
            // Some events stay until the keyframe is made.
            let events = index + 3 < past.len();
            if let Step::Reload(next) = step {
                model = next.clone();
                engine.reload(next.clone(), *at);
            } else if events {
                take(&mut engine, *at, step);
            } else if let Step::Take(input) = step {
                engine.handle(input, *at);
            }
        }
        let text = written(&engine);
        let mut again = loaded(&model, &text);
        prop_assert_eq!(&text, &written(&again));
        prop_assert_eq!(seen(&mut engine), seen(&mut again), "{}", text);
        for (at, step) in future {
            let (expected, got) = (take(&mut engine, *at, step), take(&mut again, *at, step));
            prop_assert!(expected == got, "{text}\n{expected:#?}\n{got:#?}");
        }
        prop_assert_eq!(written(&engine), written(&again));
    }

    #[test]
    fn a_damaged_keyframe_is_refused_or_does_no_harm(numbers in numbers(), damage in numbers()) {
        let mut choices = Choices::new(&numbers);
        let model = model(&mut choices);
        let mut engine = start(&mut choices, &model);
        let story = story(&mut choices, &numbers);
        let (past, future) = story.split_at(story.len() / 2);
        for (at, step) in past.iter().filter(|(_, step)| matches!(step, Step::Take(_))) {
            take(&mut engine, *at, step);
        }
        let whole: Value = serde_json::from_str(&written(&engine)).expect("it was just written");
        let mut choices = Choices::new(&damage);
        for _ in 0..4 {
            let mut broken = whole.clone();
            for _ in 0..1 + choices.below(3) {
                spoil(&mut broken, &mut choices);
            }
            let Ok(keyframe) = serde_json::from_value::<Keyframe>(broken) else { continue };
            let Ok(mut engine) = Engine::from_keyframe(model.clone(), &keyframe) else { continue };
            seen(&mut engine);
            for (at, step) in future {
                take(&mut engine, *at, step);
            }
            written(&engine);
        }
    }
}

/// Changes one value somewhere inside.
fn spoil(value: &mut Value, choices: &mut Choices<'_>) {
    let goes_on = !choices.one_in(12);
    match value {
        Value::Object(entries) if goes_on && !entries.is_empty() => {
            let key = entries.keys().nth(choices.below(entries.len())).cloned().unwrap_or_default();
            match choices.below(40) {
                0 => drop(entries.remove(&key)),
                1 => {
                    let other = entries.values().nth(choices.below(entries.len())).cloned();
                    entries.insert(key, other.unwrap_or_default());
                }
                _ => spoil(&mut entries[&key], choices),
            }
        }
        Value::Array(items) if goes_on && !items.is_empty() => {
            let (index, other) = (choices.below(items.len()), choices.below(items.len()));
            match choices.below(30) {
                0 => drop(items.remove(index)),
                1 => items.push(items[index].clone()),
                2 => items.swap(index, other),
                _ => spoil(&mut items[index], choices),
            }
        }
        _ => {
            let number = value.as_u64();
            *value = match choices.below(14) {
                0 => Value::Null,
                1 => Value::Bool(choices.one_in(2)),
                2 => (-1).into(),
                3 => u64::MAX.into(),
                4 => u64::from(u32::MAX).into(),
                5 => 1e300.into(),
                6 => "".into(),
                7 => ["ok", "ignore", "error", "gone", "discovered", "active"][choices.below(6)].into(),
                8 => Value::Array(Vec::new()),
                9 => Value::Object(serde_json::Map::new()),
                10 => (1_u64 << 53).into(),
                11 => number.map_or(Value::Null, |it| it.saturating_add(1).into()),
                12 => number.map_or(Value::Bool(true), |it| it.saturating_sub(1).into()),
                _ => choices.below(20).into(),
            };
        }
    }
}

#[test]
fn a_keyframe_of_another_format_or_configuration_is_refused_in_plain_words() {
    let model =
        |id: &str| by_hand::model(&format!("groups:\n- {{ id: {id}, modules: [{{ id: m, status: s }}] }}\n"));
    let text = written(&Engine::new(model("a"), Timestamp::ZERO));
    let keyframe: Keyframe = serde_json::from_str(&text).unwrap();
    assert!(Engine::from_keyframe(model("a"), &keyframe).is_ok());
    let error = Engine::from_keyframe(model("b"), &keyframe).unwrap_err();
    assert_eq!(error.to_string(), "the keyframe is of another configuration");
    let newer = text.replacen("\"format\":1", "\"format\":2", 1);
    let error = serde_json::from_str::<Keyframe>(&newer).unwrap_err().to_string();
    assert!(error.starts_with("the keyframe has format 2; this program reads format 1"), "{error}");
}

/// The paths of all pieces of a value; `*` stands for each element of a list of objects.
fn pieces(value: &Value, path: &mut Vec<String>, found: &mut BTreeSet<Vec<String>>) {
    match value {
        Value::Object(entries) if !entries.is_empty() => {
            for (key, value) in entries {
                path.push(key.clone());
                pieces(value, path, found);
                path.pop();
            }
        }
        Value::Array(items) if items.iter().any(Value::is_object) => {
            path.push("*".into());
            items.iter().for_each(|item| pieces(item, path, found));
            path.pop();
            found.insert(path.clone());
        }
        Value::Null | Value::Bool(false) => {}
        Value::Number(number) if number.as_u64() == Some(0) => {}
        Value::String(text) if text.is_empty() => {}
        Value::Array(items) if items.is_empty() => {}
        _ => drop(found.insert(path.clone())),
    }
}

/// Sets a piece to nothing, or to the least value of its type.
fn leave_out(value: &mut Value, path: &[String], least: bool) {
    match (path, value) {
        ([], value) => {
            *value = match value {
                Value::Bool(_) => false.into(),
                Value::Number(_) if least => 0.into(),
                Value::String(_) if least => "".into(),
                Value::Array(_) => Value::Array(Vec::new()),
                _ => Value::Null,
            }
        }
        ([_, rest @ ..], Value::Array(items)) => {
            items.iter_mut().for_each(|item| leave_out(item, rest, least));
        }
        ([key, rest @ ..], Value::Object(entries)) => {
            entries.get_mut(key).into_iter().for_each(|value| leave_out(value, rest, least));
        }
        _ => {}
    }
}

/// Whether a keyframe is refused, or leads elsewhere.
fn makes_a_difference(
    model: &Arc<Model>,
    keyframe: &Value,
    expected: &Seen,
    future: &[(Timestamp, Step)],
    path: &[(Vec<Seen>, Response, Vec<Event>)],
) -> bool {
    let Ok(keyframe) = serde_json::from_value::<Keyframe>(keyframe.clone()) else { return true };
    let Ok(mut engine) = Engine::from_keyframe(model.clone(), &keyframe) else { return true };
    seen(&mut engine) != *expected
        || future.iter().zip(path).any(|((at, step), expected)| take(&mut engine, *at, step) != *expected)
}

/// Every field of the engine's state has an effect: no case goes the same way without it.
#[test]
fn no_part_of_the_state_can_be_left_out() {
    let mut runner = TestRunner::deterministic();
    let (mut known, mut needed) = (BTreeSet::new(), BTreeSet::new());
    for pick in 0..(config().cases as usize / 10).max(500) {
        let numbers =
            vec(any::<u32>(), 250..400).new_tree(&mut runner).expect("numbers can be made").current();
        let mut choices = Choices::new(&numbers);
        let model = model(&mut choices);
        let mut engine = start(&mut choices, &model);
        let story = story(&mut choices, &numbers);
        let (past, future) = story.split_at(pick % (story.len() + 1));
        let inputs = past.iter().filter(|(_, step)| matches!(step, Step::Take(_)));
        inputs.for_each(|(at, step)| drop(take(&mut engine, *at, step)));
        let whole: Value = serde_json::from_str(&written(&engine)).expect("it was just written");
        let mut found = BTreeSet::new();
        pieces(&whole, &mut Vec::new(), &mut found);
        let expected = seen(&mut engine);
        let path: Vec<_> = future.iter().map(|(at, step)| take(&mut engine, *at, step)).collect();
        for piece in found.iter().filter(|piece| !needed.contains(*piece)).cloned().collect::<Vec<_>>() {
            let differs = [false, true].into_iter().all(|least| {
                let mut without = whole.clone();
                leave_out(&mut without, &piece, least);
                without != whole && makes_a_difference(&model, &without, &expected, future, &path)
            });
            if differs {
                needed.insert(piece);
            }
        }
        known.append(&mut found);
    }
    let rare: Vec<String> = known.difference(&needed).map(|path| path.join(".")).collect();
    println!("pieces without an effect in these cases: {rare:#?}");
    let fields = |paths: &BTreeSet<Vec<String>>| -> BTreeSet<String> {
        paths.iter().filter_map(|path| path.get(1)).cloned().collect()
    };
    let without_effect: Vec<String> = fields(&known).difference(&fields(&needed)).cloned().collect();
    assert_eq!(without_effect, Vec::<String>::new());
}
