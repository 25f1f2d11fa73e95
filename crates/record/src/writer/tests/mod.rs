//! Tests of an incident's way from the engine into a file.

mod latched;
mod room;

use std::collections::HashMap;
use std::path::Path;
use telltale_clock::unix_ms;

use super::*;
use crate::feed::Feed;
use crate::file::{ABOUT, Entry, JOURNAL, KEYFRAMES, Reader, TRANSITIONS};
use crate::incident::Margins;
use crate::journal::{Line, Took};
use crate::recorder::{Mark, Settings};
use crate::retention::Policy;
use crate::ring::{ConfigurationText, KEPT_FOR, Taken};
use crate::story::Happened;
use crate::summary::Recording;
use crate::transition::{Change, Transition};
use telltale_engine::Engine;
use telltale_engine::input::{Input, StatusArray, WriterId};
use telltale_engine::keyframe::Keyframe;
use telltale_engine::model::{Model, Other, Parts, StageModel};
use telltale_engine::snapshot::Snapshot;
use telltale_msg::cdr::Endian;
use telltale_msg::messages;
use telltale_msg::received::{Message, Stamped};

/// An engine whose inputs are recorded into a folder.
struct Recorded {
    model: Arc<Model>,
    engine: Engine,
    feed: Feed,
    clock: Clock,
    hand: telltale_clock::ClockHand,
    recorder: Recorder,
    news: mpsc::Receiver<News>,
    fault: watch::Receiver<Fault>,
    folder: tempfile::TempDir,
    room: Room,
    sequence: i64,
    /// Everything that was shown.
    shown: Vec<Arc<Snapshot>>,
}

impl Recorded {
    fn new() -> Recorded {
        let folder = tempfile::tempdir().unwrap();
        let (clock, hand) = Clock::with_hand();
        let parts = Parts { other: Other::Counted, ..Parts::empty("v", StageModel::None) };
        let model = Arc::new(Model::new(parts).unwrap());
        let mut engine = Engine::begin(model.clone(), clock.now());
        engine.keep_events();
        let (feed, turns) = Feed::new(clock);
        let text = ConfigurationText { name: "v.yaml".into(), text: "vehicle: { id: v }\n".into() };
        let settings = Settings {
            margins: Margins::default(),
            memory: 10_000_000,
            longest_memory: Span::from_secs(2),
            configuration: [text].into(),
        };
        let recorder = Recorder::start(turns, engine.snapshot(), settings, 7, clock).unwrap();
        let room = Room::new(&Policy::default());
        let (tell, news) = mpsc::channel(NEWS_MAX);
        let place = Place {
            folder: folder.path().to_path_buf(),
            definitions: Definitions::new(Vec::new()),
            about: BTreeMap::from([(VEHICLE.to_owned(), "shuttle-1".to_owned())]),
        };
        let (tell_fault, fault) = watch::channel(None);
        start(&recorder, place, room.clone(), tell, tell_fault).unwrap();
        let (sequence, shown) = (0, Vec::new());
        Recorded { model, engine, feed, clock, hand, recorder, news, fault, folder, room, sequence, shown }
    }

    /// A publisher reports this, `seconds` after what was before.
    fn say(&mut self, name: &str, level: u8, seconds: u64) {
        self.hand.advance(Span::from_secs(seconds));
        let now = self.clock.now();
        let mut array = StatusArray::default();
        array.push_status(level, name, "as it is", "");
        let body = messages::encode_diagnostic_arrays(&array, self.clock.wall(), 1 << 16).remove(0);
        self.sequence += 1;
        let message = Message {
            topic: "/diagnostics".into(),
            type_name: "diagnostic_msgs/msg/DiagnosticArray".into(),
            writer: [3; 16],
            sequence: self.sequence,
            source: Some(self.clock.wall()),
            received: self.clock.wall(),
            body: Ok((body.into(), Endian::Little)),
            left_out: 0,
            kept: false,
        };
        let input = Input::Diagnostics(array.said_by(WriterId([3; 16])));
        self.engine.handle(&input, now);
        let stamped = Stamped { input, received: now, message: Some(Arc::new(message)) };
        self.feed.took(stamped);
        let snapshot = self.engine.snapshot();
        self.feed.happened(&self.engine.take_events(), &snapshot);
        self.feed.published(snapshot.clone());
        self.shown.push(snapshot);
        self.feed.end_turn(&self.engine);
    }

    /// The next end of an incident.
    fn ended(&mut self) -> Summary {
        loop {
            match self.news.blocking_recv().expect("the writer lives") {
                News::Ended(summary) => return summary,
                News::Begun(_) | News::Extended(_) => {}
            }
        }
    }

    /// Waits for a fault, or its end.
    fn fault(&mut self, is_it: impl Fn(&Fault) -> bool) {
        while !is_it(&self.fault.borrow_and_update()) {
            std::thread::park_timeout(LOOK_EVERY);
        }
    }

    /// Feeds a recording into a new engine, and compares everything that it shows with what was shown. Returns
    /// the number of comparisons from the first instant that is shown on.
    fn replay(&self, path: &Path) -> usize {
        let mut reader = Reader::open(path).unwrap();
        let about = reader.metadata().find(|(name, _)| *name == ABOUT).unwrap().1;
        let shown_from: u64 = about["shown_from_ns"].parse().unwrap();
        let (mut engine, mut body, mut compared) = (None, None, 0);
        while let Some(entry) = reader.next_entry() {
            match entry {
                Entry::Message { body: bytes, .. } => body = Some(bytes.unwrap()),
                Entry::Json { channel, text, .. }
                    if *channel.topic == *KEYFRAMES.topic && engine.is_none() =>
                {
                    let keyframe: Keyframe = serde_json::from_slice(&text).unwrap();
                    engine = Some(Engine::from_keyframe(self.model.clone(), &keyframe).unwrap());
                }
                Entry::Json { channel, text, .. } if *channel.topic == *JOURNAL.topic => {
                    let line: Line = serde_json::from_slice(&text).unwrap();
                    assert_eq!(line.took, Took::Statuses);
                    let (body, endian) = body.as_ref().expect("the message stands before its line");
                    let (array, fault) = messages::diagnostic_array(body, *endian, &self.model.limits);
                    assert!(fault.is_none());
                    let engine = engine.as_mut().expect("a recording begins with a keyframe");
                    engine.handle(&Input::Diagnostics(array.said_by(WriterId([3; 16]))), line.at_ns);
                    let snapshot = engine.snapshot();
                    let live = self.shown.iter().find(|it| it.now == snapshot.now).unwrap();
                    assert_eq!(&snapshot, live);
                    compared += usize::from(line.at_ns.as_nanos() >= shown_from);
                }
                Entry::Json { .. } => {}
                Entry::Missing(missing) => panic!("{missing:?}"),
            }
        }
        assert!(reader.omissions().is_empty() && reader.is_complete());
        compared
    }

    /// The messages of a file, by topic.
    fn messages(&self, summary: &Summary) -> HashMap<String, usize> {
        let mut reader = Reader::open(&self.folder.path().join(&summary.recording.file)).unwrap();
        let mut found = HashMap::new();
        while let Some(Entry::Message { channel, .. } | Entry::Json { channel, .. }) = reader.next_entry() {
            *found.entry(channel.topic.to_string()).or_insert(0) += 1;
        }
        found
    }
}

#[test]
fn an_error_is_recorded_with_its_past_and_what_follows() {
    let mut recorded = Recorded::new();
    for _ in 0..50 {
        recorded.say("pump", 0, 1);
    }
    recorded.say("pump", 2, 1);
    for _ in 0..15 {
        recorded.say("pump", 2, 1);
    }
    let summary = recorded.ended();
    assert_eq!((summary.id, &summary.roots[..]), (7, &["other/pump".to_owned()][..]));
    assert_eq!((summary.triggers.len(), &*summary.vehicle), (1, "shuttle-1"));
    assert!(summary.freeze.iter().any(|it| it.node == "other/pump" && it.message == "as it is"));
    let Recording { pre_roll_s, finished, missing, .. } = summary.recording;
    assert!(finished && missing == 0 && (30.0..30.1).contains(&pre_roll_s), "{summary:?}");
    let path = recorded.folder.path().join(&summary.recording.file);
    assert_eq!(summary.recording.sha256, Some(hash_file(&path).unwrap()));
    assert_eq!(summary.recording.bytes, std::fs::metadata(&path).unwrap().len());
    let messages = recorded.messages(&summary);
    assert_eq!(recorded.replay(&path), 40, "every instant from 30 s before to 10 s after");
    // A keyframe every ten seconds, the first before the first instant that is shown.
    assert!((50..=51).contains(&messages["/diagnostics"]), "{messages:?}");
    assert_eq!(messages["/diagnostics"], messages["/telltale/journal"]);
    assert!(messages["/telltale/keyframe"] >= 4 && messages["/telltale/transitions"] >= 2, "{messages:?}");
}

#[test]
fn a_mark_is_an_incident_and_the_end_of_the_program_ends_it() {
    let mut recorded = Recorded::new();
    recorded.say("pump", 0, 1);
    while recorded.recorder.meter().topics.is_empty() {
        std::thread::yield_now();
    }
    let mark = |triggers| Ok(Mark { incident: 7, triggers });
    assert_eq!(recorded.recorder.mark("anna", "a strange noise"), mark(1));
    let Some(News::Begun(begun)) = recorded.news.blocking_recv() else { panic!("it begins") };
    assert_eq!(begun.trigger_count(), 1);
    // As after a kill in that instant.
    let path = recorded.folder.path().join(&begun.recording.file);
    let found = crate::found::summary(&path, 7).unwrap().unwrap();
    assert_eq!(found.triggers, begun.triggers);
    assert_eq!(recorded.recorder.mark("anna", "again"), mark(2));
    assert_eq!(recorded.recorder.present(), Some(7));
    recorded.say("pump", 0, 1);
    let Recorded { feed, mut news, .. } = recorded;
    drop(feed);
    let summary = loop {
        let news = news.blocking_recv().expect("the incident is written before the end");
        if let News::Ended(summary) = news {
            break summary;
        }
    };
    let notes: Vec<_> = summary.triggers.iter().map(|it| (&*it.kind, &*it.what, &*it.note)).collect();
    assert_eq!(notes, [("mark", "anna", "a strange noise"), ("mark", "anna", "again")]);
    assert!(summary.recording.finished && !summary.recording.interrupted && summary.until_ms.is_some());
}

/// The changes of a recording, and the times of all its entries.
fn changes(path: &Path) -> (Vec<Transition<'static>>, Vec<u64>) {
    let mut reader = Reader::open(path).unwrap();
    let (mut changes, mut times) = (Vec::new(), Vec::new());
    while let Some(entry) = reader.next_entry() {
        match entry {
            Entry::Message { stamps, .. } => times.push(stamps.log_time_ns),
            Entry::Json { channel, stamps, text } => {
                times.push(stamps.log_time_ns);
                if *channel.topic == *TRANSITIONS.topic {
                    changes.push(serde_json::from_slice(&text).unwrap());
                }
            }
            Entry::Missing(missing) => panic!("{missing:?}"),
        }
    }
    (changes, times)
}

#[test]
fn a_clock_that_is_set_is_told_and_the_times_go_on() {
    let mut recorded = Recorded::new();
    let begin = unix_ms(recorded.clock.wall());
    recorded.say("pump", 0, 1);
    recorded.say("pump", 2, 1);
    while recorded.recorder.present().is_none() {
        std::thread::yield_now();
    }
    for hour in [3600, -3600] {
        // The recorder looks at the clock while nothing else happens.
        recorded.hand.step_wall(hour);
        let told = || {
            let (entries, _) = recorded.recorder.0.lock().ring.read(0, usize::MAX);
            entries.iter().filter(|it| matches!(it.taken, Taken::Told(_))).count()
        };
        // The recorder needs the lock for it.
        while told() < if hour > 0 { 1 } else { 2 } {
            std::thread::park_timeout(LOOK_EVERY);
        }
        recorded.say("pump", 2, 2);
    }
    recorded.say("pump", 2, 10);
    let summary = recorded.ended();
    let path = recorded.folder.path().join(&summary.recording.file);
    let (changes, times) = changes(&path);
    assert!(times.is_sorted(), "{times:?}");
    let spans_ms = (times[times.len() - 1] - times[0]) / 1_000_000;
    assert!((10_000..60_000).contains(&spans_ms), "{spans_ms}");
    let apart = summary.since_ms.abs_diff(begin);
    assert!(
        apart < 60_000 || (3_540_000..3_660_000).contains(&apart),
        "by the clock when its file began: {apart}"
    );
    assert!(summary.until_ms.unwrap() - summary.since_ms < 60_000);
    let steps: Vec<i64> = changes
        .iter()
        .filter_map(|it| {
            if let Change::ClockSet { by_ms } = it.change {
                Some((by_ms as f64 / 1e5).round() as i64)
            } else {
                None
            }
        })
        .collect();
    assert_eq!(steps, [36, -36]);
    let shown = crate::story::read(&path, &summary).unwrap().moments;
    assert!(
        shown.iter().any(|it| matches!(it.what, Happened::ClockSet { by_ms: 3_599_000..=3_601_000 })),
        "{shown:?}"
    );
    assert!(recorded.replay(&path) > 0);
}

#[test]
fn a_file_alone_has_the_marks_the_requests_and_the_values() {
    let mut recorded = Recorded::new();
    recorded.say("pump", 0, 1);
    recorded.say("pump", 2, 1);
    while recorded.recorder.present().is_none() {
        std::thread::yield_now();
    }
    recorded.recorder.mark("anna", "a strange noise").unwrap();
    recorded.recorder.tell(Change::Refused {
        action: "clearance".into(),
        on: "".into(),
        by: "anna".into(),
        why: "No goal is set.".into(),
        why_de: "Kein Ziel.".into(),
    });
    recorded.say("valve", 2, 3);
    recorded.say("pump", 2, 30);
    let summary = recorded.ended();
    let path = recorded.folder.path().join(&summary.recording.file);
    let found = crate::found::summary(&path, summary.id).unwrap().unwrap();
    assert_eq!(found.triggers, summary.triggers);
    assert_eq!((&found.roots, &found.stage), (&summary.roots, &summary.stage));
    // It has the values of what failed before it began.
    assert!(summary.freeze.starts_with(&found.freeze) && !found.freeze.is_empty());
    let frozen: Vec<_> = summary.freeze.iter().map(|it| (&*it.node, it.at_ms)).collect();
    assert_eq!(frozen, [("other/pump", None), ("other/valve", Some(summary.triggers[2].at_ms))]);
    assert!(found.is_marked() && found.since_ms == summary.since_ms && found.triggers.len() == 3);
    let story = crate::story::read(&path, &summary).unwrap();
    let refused = |it: &Happened| matches!(it, Happened::Refused { why, .. } if why == "No goal is set.");
    assert!(story.moments.iter().any(|it| refused(&it.what)), "{:?}", story.moments);
    assert_eq!(recorded.replay(&path), 3);
}

#[test]
fn a_mark_before_the_first_state_of_the_engine_is_recorded_as_soon_as_there_is_one() {
    let mut recorded = Recorded::new();
    assert_eq!(
        recorded.recorder.mark("anna", "early"),
        Err(crate::recorder::Unmarked::Off),
        "it is not promised"
    );
    recorded.say("pump", 0, 1);
    recorded.say("pump", 0, 60);
    let summary = recorded.ended();
    assert_eq!((summary.id, &*summary.triggers[0].note), (7, "early"));
    assert!(summary.recording.finished && summary.recording.messages > 0);
}

#[test]
fn the_last_minutes_have_the_configuration_by_which_they_were_judged() {
    let mut recorded = Recorded::new();
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let place = Place {
        folder: recorded.folder.path().to_path_buf(),
        definitions: Definitions::new(Vec::new()),
        about: BTreeMap::new(),
    };
    let recorder = recorded.recorder.clone();
    let recent = || {
        let path = write_recent(&recorder, &place, folder).unwrap().expect("it has a beginning");
        let mut reader = Reader::open(&path).unwrap();
        let text = reader.attachment("configuration/v.yaml").unwrap();
        let times = std::iter::from_fn(|| reader.next_entry()).count();
        assert!(reader.is_complete() && times > 0);
        std::fs::remove_file(path).unwrap();
        String::from_utf8(text).unwrap()
    };
    let held_from = |from: Timestamp| {
        while recorder.holds_since().is_none_or(|since| since < from) {
            std::thread::yield_now();
        }
    };
    recorded.say("pump", 0, 1);
    held_from(Timestamp::ZERO);
    let later = ConfigurationText { name: "v.yaml".into(), text: "vehicle: { id: w }\n".into() };
    recorded.feed.reloaded(recorded.clock.now(), [later].into());
    recorded.say("pump", 0, 1);
    assert_eq!(recent(), "vehicle: { id: v }\n");
    // The ring forgets what is too old.
    for _ in 0..5 {
        recorded.say("pump", 0, KEPT_FOR.as_millis() / 2000);
    }
    held_from(Timestamp::ZERO + KEPT_FOR);
    assert_eq!(recent(), "vehicle: { id: w }\n");
}

/// Removes a folder in which the writer may be trying the disk.
fn remove(folder: &Path) {
    while folder.exists() {
        let _ = std::fs::remove_dir_all(folder);
    }
}

#[test]
fn a_disk_that_refuses_is_a_fault_until_it_takes_recordings_again() {
    let mut recorded = Recorded::new();
    let folder = recorded.folder.path().to_path_buf();
    recorded.say("pump", 0, 1);
    remove(&folder);
    recorded.say("pump", 2, 1);
    // The trial at the start may have been earlier.
    recorded.fault(|fault| fault.as_ref().is_some_and(|it| it.contains("cannot be examined")));
    std::fs::create_dir(&folder).unwrap();
    recorded.hand.advance(TRY_EVERY);
    recorded.fault(Option::is_none);
    // The incident lasts, so it is recorded after all, from before its beginning.
    let Recorded { feed, mut news, .. } = recorded;
    drop(feed);
    let mut ended = std::iter::from_fn(|| news.blocking_recv()).filter_map(|news| match news {
        News::Ended(summary) => Some(summary),
        _ => None,
    });
    let summary = ended.next().expect("it is written before the end");
    assert_eq!((summary.id, &summary.roots[..]), (8, &["other/pump".to_owned()][..]));
    assert!(summary.recording.finished && summary.recording.messages > 0, "{summary:?}");
}

#[test]
fn a_folder_that_becomes_useless_is_told_before_an_incident() {
    let mut recorded = Recorded::new();
    remove(recorded.folder.path());
    recorded.hand.advance(LOOK_AFTER_DISK_EVERY);
    // The trial at the start may have been interrupted by the removal.
    recorded.fault(|fault| fault.as_ref().is_some_and(|it| it.contains("trial.mcap cannot be created")));
    std::fs::create_dir_all(recorded.folder.path()).unwrap();
    recorded.hand.advance(TRY_EVERY);
    recorded.fault(Option::is_none);
}

#[test]
fn how_long_the_disk_takes_is_known_meanwhile() {
    let recorded = Recorded::new();
    let (recorder, hand) = (&recorded.recorder, recorded.hand);
    let waits = recorder.0.on_disk(|| {
        hand.advance(Span::from_secs(3));
        recorder.waits_for_disk()
    });
    assert!(waits.is_some_and(|waits| waits >= Span::from_secs(3)), "{waits:?}");
}
