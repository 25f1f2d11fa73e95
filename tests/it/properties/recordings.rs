//! What was recorded is replayed: an engine that takes a recording shows what the first one showed, from the
//! beginning of the recording on, through everything that can happen.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, UNIX_EPOCH};

use proptest::prelude::*;
use telltale::clock::Clock;
use telltale::engine::Engine;
use telltale::engine::input::{Input, WriterId};
use telltale::engine::model::Model;
use telltale::engine::snapshot::Snapshot;
use telltale::engine::time::{Span, Timestamp};
use telltale::msg::cdr::Endian;
use telltale::msg::fields::Definitions;
use telltale::msg::messages;
use telltale::msg::received::{Message, Stamped};
use telltale::record::feed::Feed;
use telltale::record::incident::Margins;
use telltale::record::recorder::{Mark, Recorder, Settings};
use telltale::record::retention::Policy;
use telltale::record::ring::ConfigurationText;
use telltale::record::room::Room;
use telltale::record::writer::{self, NEWS_MAX, News, Place};
use telltale::replay::{Playback, Recording, Run};
use tokio::sync::{mpsc, watch};

use super::cases::Choices;
use super::keyframes::{Step, model, start, story};
use super::{config, numbers};
use crate::folder::TestFolder;

/// Each case writes a file and brings it to the disk.
fn few() -> ProptestConfig {
    let ProptestConfig { cases, .. } = config();
    ProptestConfig { cases: cases.div_ceil(160), ..config() }
}

static FOLDERS: AtomicUsize = AtomicUsize::new(0);

/// The text that stands for a model.
fn text(number: usize) -> ConfigurationText {
    ConfigurationText { name: "v.yaml".to_owned(), text: number.to_string() }
}

/// As the bridge takes it: a message, and the statuses that are decoded from it.
fn received(input: Input, number: i64, model: &Model) -> (Input, Option<Arc<Message>>) {
    let (input, (topic, type_name), body) = match input {
        Input::Diagnostics(array) if number % 3 > 0 => {
            let body = messages::encode_diagnostic_arrays(&array, UNIX_EPOCH, usize::MAX).remove(0);
            let (array, _) = messages::diagnostic_array(&body, Endian::Little, &model.limits);
            (
                Input::Diagnostics(array.said_by(WriterId(WRITER))),
                ("/diagnostics", messages::DIAGNOSTIC_ARRAY),
                body,
            )
        }
        Input::Tick => (input, ("/points", "std_msgs/msg/String"), vec![0; 9]),
        Input::Sample(sample) => {
            let source = sample.source.clone();
            let topic = format!("/{}", source.topic.trim_start_matches('/'));
            return (Input::Sample(sample), Some(message(&topic, &source.type_name, vec![0; 9], number)));
        }
        input => return (input, None),
    };
    (input, Some(message(topic, type_name, body, number)))
}

const WRITER: [u8; 16] = [7; 16];

fn message(topic: &str, type_name: &str, body: Vec<u8>, number: i64) -> Arc<Message> {
    Arc::new(Message {
        topic: topic.into(),
        type_name: type_name.into(),
        writer: WRITER,
        sequence: number,
        source: None,
        received: UNIX_EPOCH + Duration::from_secs(1_800_000_000),
        body: Ok((body.into(), Endian::Little)),
        left_out: 0,
        kept: false,
    })
}

/// An engine that is recorded.
struct Recorded {
    engine: Engine,
    feed: Feed,
    shown: Vec<(Timestamp, Snapshot)>,
}

impl Recorded {
    fn take(&mut self, at: Timestamp, input: Input, message: Option<Arc<Message>>) {
        self.engine.handle(&input, at);
        self.feed.took(Stamped { input, received: at, message });
        self.end_turn(at);
    }

    fn reload(&mut self, at: Timestamp, model: &Arc<Model>, number: usize) {
        // As the runtime does it: what was due is of the old configuration.
        self.take(at, Input::Tick, None);
        self.engine.reload(model.clone(), at);
        self.feed.reloaded(at, [text(number)].into());
        self.end_turn(at);
    }

    fn end_turn(&mut self, at: Timestamp) {
        let events = self.engine.take_events();
        let snapshot = self.engine.snapshot();
        self.feed.happened(&events, &snapshot);
        self.shown.push((at, Snapshot::clone(&snapshot)));
        self.feed.published(snapshot);
        self.feed.end_turn(&self.engine);
    }
}

proptest! {
    #![proptest_config(few())]

    #[test]
    fn a_replayed_recording_shows_what_was_shown(numbers in numbers()) {
        let mut choices = Choices::new(&numbers);
        let first = model(&mut choices);
        let mut engine = start(&mut choices, &first);
        engine.keep_events();
        let story = story(&mut choices, &numbers);
        let folder = TestFolder::new(&format!("replayed-{}", FOLDERS.fetch_add(1, Ordering::Relaxed)));
        std::fs::create_dir(&*folder).unwrap();
        let (clock, _) = Clock::standing();
        let (feed, turns) = Feed::new(clock);
        let settings = Settings {
            margins: Margins { before: Span::from_secs(30), after: Span::from_secs(100) },
            memory: 100_000_000,
            longest_memory: Span::ZERO,
            configuration: [text(0)].into(),
        };
        let recorder = Recorder::start(turns, engine.snapshot(), settings, 1, clock).unwrap();
        let (tell, mut news) = mpsc::channel(NEWS_MAX);
        let place =
            Place { folder: folder.to_path_buf(), definitions: Definitions::default(), about: BTreeMap::new() };
        let (tell_fault, _fault) = watch::channel(None);
        writer::start(&recorder, place, Room::new(&Policy::default()), tell, tell_fault).unwrap();

        let mut models = vec![first];
        let mut recorded = Recorded { engine, feed, shown: Vec::new() };
        let (tick, message) = received(Input::Tick, 0, &models[0]);
        recorded.take(Timestamp::ZERO, tick, message);
        while recorder.meter().topics.is_empty() {
            std::thread::yield_now();
        }
        prop_assert_eq!(recorder.mark("anna", ""), Ok(Mark { incident: 1, triggers: 1 }));
        for (index, (at, step)) in story.into_iter().enumerate() {
            match step {
                Step::Take(input) => {
                    let (input, message) = received(input, index as i64 + 1, &models[models.len() - 1]);
                    recorded.take(at, input, message);
                }
                Step::Reload(model) => {
                    models.push(model.clone());
                    recorded.reload(at, &model, models.len() - 1);
                }
            }
        }
        let Recorded { feed, shown, .. } = recorded;
        drop((feed, recorder));
        let summary = std::iter::from_fn(|| news.blocking_recv()).find_map(|news| match news {
            News::Ended(summary) => Some(summary),
            News::Begun(_) | News::Extended(_) => None,
        });
        let summary = summary.expect("it is written before the end");

        let path = folder.join(&summary.recording.file);
        let run = || {
            let (first, models) = (models[0].clone(), models.clone());
            let load =
                move |texts: &[ConfigurationText]| Ok(models[texts[0].text.parse::<usize>().unwrap()].clone());
            Run::recorded_by(Recording::open(&path).unwrap(), first, Box::new(load))
        };
        let mut playback = Playback::open(run()).unwrap();
        for pick in numbers.iter().take(3) {
            let (at, _) = shown[*pick as usize % shown.len()];
            let (_, expected) = shown.iter().rfind(|(it, _)| *it == at).expect("it was shown");
            playback.go_to(at).unwrap();
            prop_assert_eq!(playback.at(), at);
            let got = Snapshot::clone(&playback.snapshot().expect("it is recorded"));
            prop_assert!(&got == expected, "shown at {at:?}\n{expected:#?}\n{got:#?}");
        }
        // By the same configuration it is judged the same, also in what no message says of itself: that it came late, or was
        // never decoded.
        let is_one = models.len() == 1;
        let recording = Recording::open(&path).unwrap();
        let (model, definitions) = (models[0].clone(), Definitions::default());
        let anew = Run::judged_anew(recording, model.clone(), Some(model), &definitions, None);
        if let Some(mut anew) = anew.ok().filter(|_| is_one) {
            let mut shown = shown.iter().skip(1);
            while let Some(taken) = anew.step().unwrap() {
                let (at, expected) = shown.next().expect("it takes no more than the first one took");
                prop_assert_eq!(taken.at, *at);
                let got = Snapshot::clone(&anew.engine().expect("it took something").snapshot());
                prop_assert!(got == *expected, "judged anew at {at:?}\n{expected:#?}\n{got:#?}");
            }
            prop_assert!(shown.next().is_none(), "it takes all");
        }
        let mut run = run();
        let mut shown = shown.into_iter();
        // The recording begins with the state after it.
        shown.next();
        while let Some(taken) = run.step().unwrap() {
            let (at, expected) = shown.next().expect("it takes no more than the first one took");
            prop_assert_eq!(taken.at, at);
            let got = Snapshot::clone(&run.engine().expect("it took something").snapshot());
            prop_assert!(got == expected, "at {at:?}\n{expected:#?}\n{got:#?}");
        }
        prop_assert_eq!(shown.next().map(|(at, _)| at), None, "it takes all");
        prop_assert_eq!(run.notes(), &Default::default());
        prop_assert_eq!(run.omissions(), (Vec::new(), 0));
    }
}
