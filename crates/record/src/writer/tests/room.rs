//! Tests of recordings that have less room than they need.

use super::*;
use crate::file::LEFT_OUT;
use crate::retention::Policy;

const DISK: u64 = 4_000_000;

impl Recorded {
    /// A camera says something that cannot be compressed.
    fn see(&mut self, bytes: usize) {
        self.sequence += 1;
        let mut seed = self.sequence as u64 | 1;
        let noise = std::iter::repeat_with(|| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 56) as u8
        });
        let message = Message {
            topic: "/camera".into(),
            type_name: "sensor_msgs/msg/Image".into(),
            writer: [4; 16],
            sequence: self.sequence,
            source: Some(self.clock.wall()),
            received: self.clock.wall(),
            body: Ok((noise.take(bytes).collect::<Vec<_>>().into(), Endian::Little)),
            left_out: 0,
            kept: false,
        };
        let received = self.clock.now();
        self.engine.handle(&Input::Tick, received);
        self.feed.took(Stamped { input: Input::Tick, received, message: Some(Arc::new(message)) });
        self.feed.end_turn(&self.engine);
    }

    /// The recorder has taken all of it, and the writer has written it.
    fn settle(&self) {
        let is_settled = || {
            let meter = self.recorder.meter();
            meter.topics.iter().any(|it| it.dropped > 0 || it.messages > 0)
        };
        while !is_settled() {
            std::thread::park_timeout(LOOK_EVERY);
        }
    }
}

/// The lines of a journal: those with a message in the file, those without it, and those that are missing.
fn lines(path: &Path) -> (usize, usize, u64) {
    let mut reader = Reader::open(path).unwrap();
    let (mut whole, mut left_out, mut lost) = (0, 0, 0);
    while let Some(entry) = reader.next_entry() {
        let Entry::Json { channel, text, .. } = entry else { continue };
        if *channel.topic != *JOURNAL.topic {
            continue;
        }
        match serde_json::from_slice::<Line>(&text).unwrap() {
            Line { took: Took::Lost(count), .. } => lost += count,
            Line { left_out: Some(_), .. } => left_out += 1,
            Line { message: Some(_), .. } => whole += 1,
            _ => {}
        }
    }
    (whole, left_out, lost)
}

#[test]
fn an_incident_grows_no_further_than_its_room_and_says_what_it_lacks() {
    let mut recorded = Recorded::new();
    recorded.room.follow(&Policy::new(DISK, Span::from_secs(3600)));
    recorded.say("pump", 0, 1);
    for _ in 0..80 {
        recorded.see(100_000);
    }
    recorded.say("pump", 2, 1);
    recorded.settle();
    for _ in 0..9 {
        recorded.say("pump", 2, 1);
        for _ in 0..10 {
            recorded.see(100_000);
        }
    }
    recorded.say("pump", 2, 20);
    let summary = recorded.ended();
    let path = recorded.folder.path().join(&summary.recording.file);
    let length = path.metadata().unwrap().len();
    assert!(length <= DISK / 2, "{length} bytes");
    assert!(length > DISK / 4, "there was room for more: {length} bytes");
    let recording = &summary.recording;
    assert!(
        recording.left_out > 0 && recording.left_out_bytes == 100_000 * recording.left_out,
        "{recording:?}"
    );
    let (whole, left_out, _) = lines(&path);
    assert_eq!(left_out as u64, recording.left_out, "each is named in the file");
    let statuses = recorded.messages(&summary)["/diagnostics"];
    assert!(statuses >= 11 && whole > statuses, "what is small is whole: {statuses} of {whole}");
    let reader = Reader::open(&path).unwrap();
    let (_, told) = reader.metadata().find(|(name, _)| *name == LEFT_OUT).expect("the file says it");
    let said =
        format!("{} messages, {} bytes: they had no room", recording.left_out, recording.left_out_bytes);
    assert_eq!(told["/camera"], said);
}

#[test]
fn without_any_room_the_journal_says_that_it_lacks_something_and_the_file_is_whole() {
    let mut recorded = Recorded::new();
    recorded.room.follow(&Policy::new(200_000, Span::from_secs(3600)));
    recorded.say("pump", 0, 1);
    recorded.say("pump", 2, 1);
    for _ in 0..900 {
        recorded.say("pump", 2, 0);
    }
    recorded.say("pump", 2, 20);
    let summary = recorded.ended();
    assert!(summary.recording.finished && summary.recording.missing > 0, "{summary:?}");
    let path = recorded.folder.path().join(&summary.recording.file);
    assert!(path.metadata().unwrap().len() <= 100_000 && lines(&path).2 > 0);
    assert_eq!(crate::file::check(&path).unwrap(), Vec::<String>::new());
}

#[test]
fn a_message_without_its_content_stands_in_the_journal_with_its_times_and_its_size() {
    let mut recorded = Recorded::new();
    recorded.say("pump", 0, 1);
    let message = Message {
        topic: "/points".into(),
        type_name: "sensor_msgs/msg/PointCloud2".into(),
        writer: [4; 16],
        sequence: 77,
        source: Some(recorded.clock.wall()),
        received: recorded.clock.wall(),
        body: Ok((bytes::Bytes::new(), Endian::Little)),
        left_out: 640_000,
        kept: false,
    };
    let received = recorded.clock.now();
    recorded.feed.took(Stamped { input: Input::Tick, received, message: Some(Arc::new(message)) });
    recorded.say("pump", 2, 1);
    assert!(recorded.recorder.meter().topics.iter().all(|it| &*it.topic != "/points" || it.is_sizes_only));
    recorded.say("pump", 2, 20);
    let summary = recorded.ended();
    let path = recorded.folder.path().join(&summary.recording.file);
    assert_eq!((lines(&path).1, summary.recording.left_out, summary.recording.missing), (1, 0, 0));
    assert!(!recorded.messages(&summary).contains_key("/points"));
    let reader = Reader::open(&path).unwrap();
    let (_, told) = reader.metadata().find(|(name, _)| *name == LEFT_OUT).expect("the file says it");
    assert_eq!(told["/points"], "1 messages, 640000 bytes: they are recorded as their times and sizes");
}
