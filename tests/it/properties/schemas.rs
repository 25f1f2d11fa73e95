//! What programs are sent of random vehicles is as the published JSON Schemas say.

use std::time::{Duration, UNIX_EPOCH};

use proptest::prelude::*;
use telltale::engine::Engine;
use telltale::engine::time::Timestamp;
use telltale::runtime::Published;
use telltale::web::live::frame::{Form, Frames};
use telltale::web::{snapshot_schema, stream_schema};

use super::cases::{Choices, history, model};
use super::numbers;
use crate::schemas::Strict;

fn config() -> ProptestConfig {
    ProptestConfig { cases: super::config().cases.div_ceil(40), ..super::config() }
}

#[test]
fn snapshots_and_streams_are_as_their_schemas_say() {
    let (whole, message) = (Strict::at(&snapshot_schema(), ""), Strict::at(&stream_schema(), ""));
    let forms = [(false, false), (false, true), (true, false), (true, true)];
    let forms = forms.map(|(groups, deltas)| Form { groups, deltas });
    proptest!(config(), |(numbers in numbers())| {
        let mut choices = Choices::new(&numbers);
        let mut engine = Engine::new(model(&mut choices), Timestamp::ZERO);
        let (frames, mut sent) = (Frames::default(), [None; 4]);
        for (index, (at, input)) in history(&mut choices).into_iter().enumerate() {
            engine.handle(&input, at);
            if index % 8 > 0 {
                continue;
            }
            let wall = UNIX_EPOCH + Duration::from_nanos(1_795_176_000_000_000_000 + at.as_nanos());
            let published = Published::recorded(engine.snapshot(), wall);
            let value = serde_json::from_str(&frames.json(&published)).unwrap();
            prop_assert_eq!(whole.fault(&value), None);
            for (form, sent) in forms.into_iter().zip(&mut sent) {
                let (text, has) = frames.stream(&published, form, *sent);
                *sent = Some(has);
                let value = serde_json::from_str(&text).unwrap();
                prop_assert_eq!(message.fault(&value), None, "{:?}", form);
            }
        }
    });
}
