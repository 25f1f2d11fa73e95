//! Tests of what latched topics said before a recording.

use super::*;

impl Recorded {
    /// A latched topic says this now.
    fn latch(&mut self, topic: &str, text: u8) {
        let message = Message {
            topic: topic.into(),
            type_name: "std_msgs/msg/UInt8".into(),
            writer: [5; 16],
            sequence: 1,
            source: Some(self.clock.wall()),
            received: self.clock.wall(),
            body: Ok((vec![text].into(), Endian::Little)),
            left_out: 0,
            kept: true,
        };
        let received = self.clock.now();
        self.engine.handle(&Input::Tick, received);
        self.feed.took(Stamped { input: Input::Tick, received, message: Some(Arc::new(message)) });
        self.feed.end_turn(&self.engine);
    }
}

#[test]
fn what_latched_topics_said_last_stands_before_the_recording_with_its_own_time() {
    let mut recorded = Recorded::new();
    recorded.latch("/old", 0);
    recorded.latch("/map", 1);
    let said = recorded.clock.now();
    recorded.say("pump", 0, 1);
    for _ in 0..8 {
        recorded.say("pump", 0, KEPT_FOR.as_millis() / 4000);
    }
    recorded.latch("/old", 2);
    recorded.say("pump", 0, 20);
    recorded.say("pump", 0, 50);
    recorded.say("pump", 2, 1);
    recorded.say("pump", 2, 20);
    let summary = recorded.ended();
    let path = recorded.folder.path().join(&summary.recording.file);
    let mut reader = Reader::open(&path).unwrap();
    let about = reader.metadata().find(|(name, _)| *name == ABOUT).unwrap().1;
    let zero_ns: u64 = about["start_of_clock_ns"].parse().unwrap();
    let mut latched = Vec::new();
    while let Some(Entry::Message { channel, stamps, body }) = reader.next_entry() {
        assert!(stamps.publish_time_ns.abs_diff(stamps.log_time_ns) < 1_000_000_000);
        latched.push((channel.topic.to_string(), stamps.log_time_ns - zero_ns, body.unwrap().0.to_vec()));
    }
    let names: Vec<_> = latched.iter().map(|(topic, _, body)| (&**topic, body[0])).collect();
    assert_eq!(names, [("/map", 1), ("/old", 2)], "the last ones before the first keyframe");
    assert!(said.as_nanos() - latched[0].1 < 1_000_000_000, "{latched:?}");
    assert!(recorded.replay(&path) >= 2, "a replay is as without them");
    let found = crate::found::summary(&path, summary.id).unwrap().unwrap();
    assert_eq!(found.since_ms, summary.since_ms);
    let opened = crate::file::check(&path).unwrap();
    assert!(opened.is_empty(), "{opened:?}");
}
