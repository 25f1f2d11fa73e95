//! Inputs in files: each is the same when it is read again, and a person can read it.

use std::sync::Arc;

use proptest::prelude::*;
use telltale::engine::input::{
    FleetFault, Input, ListenerReport, OutputReport, ReceptionTrouble, TroubleKind, Upkeep, WriterId,
};
use telltale::engine::model::monitors::TopicSpec;
use telltale::engine::model::output::Output;
use telltale::engine::model::sample::{FieldValue, Sample};
use telltale::engine::time::Timestamp;

use super::cases::{Choices, history};
use super::{config, numbers};

/// The inputs of a vehicle, and among them those about Telltale itself.
pub fn history_of_all(choices: &mut Choices<'_>) -> Vec<(Timestamp, Input)> {
    let mut own = Vec::new();
    for _ in 0..choices.below(30) {
        own.push(about_ourselves(choices));
    }
    let mut all = history(choices);
    for (index, (_, input)) in all.iter_mut().enumerate() {
        if let Input::Sample(sample) = input {
            sample.late = index % 9 == 4;
            if index % 11 == 5 {
                sample.received_wall_ns = Sample::NO_CLOCK;
            }
        }
    }
    for (index, input) in own.into_iter().enumerate() {
        let place = (index * 7) % (all.len() + 1);
        let at = all.get(place).or(all.last()).map_or(Timestamp::ZERO, |(at, _)| *at);
        all.insert(place, (at, input));
    }
    all
}

fn about_ourselves(choices: &mut Choices<'_>) -> Input {
    let outputs = [Output::ManeuverStop, Output::Deceleration, Output::Stage, Output::Pose];
    let fault = choices.one_in(2).then(|| Box::from("broken"));
    let topic: Box<str> = "/t".into();
    match choices.below(13) {
        12 => Input::Voices { other: fault },
        11 => Input::Nodes { repeated: fault },
        9 => Input::Signal { name: "goal".into(), value: true },
        10 => Input::Signal { name: "nobody knows it".into(), value: choices.one_in(2) },
        0 => Input::Reception(ReceptionTrouble {
            topic,
            kind: [TroubleKind::Malformed, TroubleKind::WrongType, TroubleKind::Lost][choices.below(3)],
            count: 1 + choices.below(3) as u64,
            text: "too short".into(),
        }),
        1 => Input::Output(OutputReport { output: outputs[choices.below(4)], topic, error: fault }),
        2 | 3 => {
            let heard = choices.one_in(2);
            Input::Listened(ListenerReport { output: outputs[choices.below(4)], topic, heard })
        }
        4 => Input::Aggregator { other: fault },
        5 => Input::Storage { fault },
        6 => Input::Dds { fault },
        7 => Input::Display { late: fault },
        _ => {
            let old = || "old".into();
            let is_old = choices.one_in(2);
            Input::Upkeep(Upkeep {
                clock: fault.map(|words| (&*words).into()),
                certificate: is_old.then(old),
                recording: is_old.then(old),
                fleet: (!is_old).then(|| FleetFault { text: old(), is_error: choices.one_in(2) }),
            })
        }
    }
}

/// The input after a file, and its text there.
fn read_again(input: &Input) -> (Input, String) {
    let text = serde_json::to_string(input).expect("every input can be written");
    (serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}")), text)
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn an_input_in_a_file_is_the_same_input(numbers in numbers()) {
        for (at, input) in history_of_all(&mut Choices::new(&numbers)) {
            let (again, text) = read_again(&input);
            // Not a number differs from itself, but not from its name.
            prop_assert_eq!(format!("{again:?}"), format!("{input:?}"), "{}", text);
            prop_assert_eq!(Timestamp::from(u64::from(at)), at);
        }
    }

    #[test]
    fn every_number_survives_a_file(bits in any::<u64>()) {
        let number = f64::from_bits(bits);
        let (again, text) = read_again(&sample(number));
        let Input::Sample(Sample { values, .. }) = again else { panic!("{text} became {again:?}") };
        let FieldValue::Number(again) = values[0] else { panic!("{text} became {values:?}") };
        prop_assert!(again.to_bits() == bits || again.is_nan() && number.is_nan(), "{number} as {text}");
    }
}

fn sample(number: f64) -> Input {
    let source = TopicSpec { topic: "/a".into(), type_name: "".into(), stamp: true, fields: Vec::new() };
    let values = [FieldValue::Number(number)].into();
    let (stamp_ns, received_wall_ns) = (Some(-5), Sample::NO_CLOCK);
    Input::Sample(Sample { stamp_ns, received_wall_ns, late: true, ..Sample::of(Arc::new(source), values) })
}

#[test]
fn numbers_that_json_lacks_are_words_and_others_are_refused() {
    for (number, word) in [(f64::INFINITY, "inf"), (f64::NEG_INFINITY, "-inf"), (f64::NAN, "nan")] {
        let (again, text) = read_again(&sample(number));
        assert!(text.contains(&format!(r#"[{{"number":"{word}"}}]"#)), "{text}");
        assert_eq!(format!("{again:?}"), format!("{:?}", sample(number)));
    }
    let (_, text) = read_again(&sample(1.0));
    assert!(serde_json::from_str::<Input>(&text.replace("1.0", "1")).is_ok());
    for other in ["\"one\"", "null", "{}"] {
        assert!(serde_json::from_str::<Input>(&text.replace("1.0", other)).is_err(), "{other}");
    }
}

#[test]
fn an_input_reads_as_what_it_is() {
    let mut array = telltale::engine::input::StatusArray::default();
    array.push_status(1, "imu", "noisy", "imu-7");
    array.push_value("rate", "9.5");
    let array = Input::Diagnostics(array.said_by(WriterId([0xab; 16])));
    let signal = Input::Signal { name: "active".into(), value: true };
    let shown = [
        (
            array,
            format!(
                r#"{{"diagnostics":{{"writer":"{}","statuses":[{{"level":1,"name":"imu","message":"noisy","hardware_id":"imu-7","values":[["rate","9.5"]]}}]}}}}"#,
                "ab".repeat(16)
            ),
        ),
        (signal, r#"{"signal":{"name":"active","value":true}}"#.to_owned()),
        (Input::Tick, r#""tick""#.to_owned()),
    ];
    for (input, expected) in shown {
        assert_eq!(read_again(&input), (input, expected));
    }
    for wrong in ["ab", &"g".repeat(32), &"+".repeat(32), &"ä".repeat(16)] {
        let text = format!(r#"{{"diagnostics":{{"writer":"{wrong}","statuses":[]}}}}"#);
        assert!(serde_json::from_str::<Input>(&text).is_err(), "{wrong}");
    }
}
