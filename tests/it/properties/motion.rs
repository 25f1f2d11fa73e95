//! The motion is what follows from the speeds of the last moments, computed from the whole history.

use proptest::prelude::*;
use telltale::engine::Engine;
use telltale::engine::input::Input;
use telltale::engine::model::Model;
use telltale::engine::model::motion::SpeedSource;
use telltale::engine::model::sample::FieldValue;
use telltale::engine::snapshot::{Motion, Moving};
use telltale::engine::time::{Span, Timestamp};

use super::cases::{Choices, history, model};
use super::{config, numbers};

/// How long a vehicle is slow before it stands.
const STANDS_AFTER: Span = Span::from_millis(500);

/// The speeds that were heard, newest first; `None` is no number.
fn speeds(model: &Model, source: SpeedSource, seen: &[(Timestamp, Input)]) -> Vec<(Timestamp, Option<f64>)> {
    let spec = &model.watched.topics[source.value.topic.0 as usize];
    let speed = |(at, input): &(Timestamp, Input)| match input {
        Input::Sample(sample) if sample.source == *spec && !sample.late => {
            match sample.values.get(source.value.field as usize)? {
                FieldValue::Absent => None,
                FieldValue::Number(mps) => Some((*at, Some(mps.abs()).filter(|mps| mps.is_finite()))),
                _ => Some((*at, None)),
            }
        }
        _ => None,
    };
    seen.iter().rev().filter_map(speed).collect()
}

fn expected(source: SpeedSource, speeds: &[(Timestamp, Option<f64>)], now: Timestamp) -> Moving {
    let mut after = now;
    let mut slow_since = None;
    for &(at, mps) in speeds {
        let (Some(mps), true) = (mps, after < at + source.timeout) else { break };
        if mps >= source.standing_below_mps {
            return match slow_since {
                Some(since) if now >= since + STANDS_AFTER => Moving::No,
                _ => Moving::Yes,
            };
        }
        (after, slow_since) = (at, Some(at));
    }
    match slow_since {
        Some(since) if now >= since + STANDS_AFTER => Moving::No,
        _ => Moving::Unknown,
    }
}

/// The way in metres: between two speeds that follow one another in time, half of each.
fn driven_m(source: SpeedSource, speeds: &[(Timestamp, Option<f64>)]) -> f64 {
    let between = |pair: &[(Timestamp, Option<f64>)]| {
        let [(at, now), (earlier, before)] = pair else { return 0.0 };
        match now.zip(*before) {
            Some((now, before)) if *at < *earlier + source.timeout => {
                (now + before) / 2.0 * at.since(*earlier).as_nanos() as f64 / 1e9
            }
            _ => 0.0,
        }
    };
    speeds.windows(2).map(between).sum()
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn a_silent_vehicle_never_stands_and_a_slow_one_stands_when_it_lasts(numbers in numbers()) {
        let mut choices = Choices::new(&numbers);
        let model = model(&mut choices);
        let source = model.driving.speed.expect("every random vehicle has a speed");
        let history = history(&mut choices);
        let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
        for (index, (at, input)) in history.iter().enumerate() {
            while let Some(due) = engine.next_deadline().filter(|due| due < at) {
                engine.handle(&Input::Tick, due);
                let Motion { moving, .. } = engine.snapshot().motion;
                prop_assert_eq!(moving, expected(source, &speeds(&model, source, &history[..index]), due));
            }
            engine.handle(input, *at);
            let Motion { moving, speed_kmh, .. } = engine.snapshot().motion;
            prop_assert_eq!(moving, expected(source, &speeds(&model, source, &history[..=index]), *at));
            match (moving, speed_kmh) {
                (Moving::Yes, Some(kmh)) => prop_assert!(kmh > 0),
                (Moving::No, kmh) => prop_assert_eq!(kmh, Some(0)),
                (Moving::Yes | Moving::Unknown, kmh) => prop_assert_eq!(kmh, None),
            }
            let driven_m = driven_m(source, &speeds(&model, source, &history[..=index]));
            let is = engine.snapshot().driven_m;
            prop_assert!((is - driven_m).abs() <= 1e-6 * (1.0 + driven_m), "{} m, not {}", is, driven_m);
        }
    }
}
