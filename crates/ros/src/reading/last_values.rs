//! The last message of each publisher of a topic that keeps it for late readers: a new configuration, and a new participant,
//! count as one.

use std::collections::BTreeMap;
use std::sync::Arc;

use telltale_engine::time::Timestamp;
use telltale_msg::received::Message;
use telltale_msg::sample_bytes::Guid;

/// Publishers of one topic with a kept last message. Of more, the oldest messages go.
const WRITERS_MAX: usize = 64;
/// A larger message is not kept.
const BYTES_MAX: usize = 64 << 10;
/// All kept messages of one topic.
const ALL_BYTES_MAX: usize = 256 << 10;

#[derive(Debug, Clone)]
pub struct LastValue {
    pub message: Arc<Message>,
    /// When it should have come.
    pub at: Timestamp,
}

#[derive(Debug, Clone, Default)]
pub struct LastValues(BTreeMap<Guid, LastValue>);

impl LastValues {
    /// Takes the last message of its publisher, which should have come at this instant.
    pub fn take(&mut self, message: &Arc<Message>, at: Timestamp) {
        self.0.remove(&message.writer);
        if message.body.is_err() || message.len() > BYTES_MAX {
            return;
        }
        self.0.insert(message.writer, LastValue { message: message.clone(), at });
        while self.0.len() > WRITERS_MAX || self.bytes() > ALL_BYTES_MAX {
            let oldest = self.0.iter().min_by_key(|(_, last)| last.at).map(|(writer, _)| *writer);
            oldest.map(|writer| self.0.remove(&writer));
        }
    }

    /// The message of this publisher with this number, which is not kept any more.
    pub fn remove(&mut self, writer: &Guid, sequence: i64) -> Option<LastValue> {
        let is_it = self.0.get(writer).is_some_and(|last| last.message.sequence == sequence);
        is_it.then(|| self.0.remove(writer)).flatten()
    }

    pub fn forget(&mut self, writer: &Guid) {
        self.0.remove(writer);
    }

    /// Those of publishers that still keep them, oldest first; others go.
    pub fn of(&mut self, keeps: impl Fn(&Guid) -> bool) -> Vec<LastValue> {
        self.0.retain(|writer, _| keeps(writer));
        let mut all: Vec<LastValue> = self.0.values().cloned().collect();
        all.sort_by_key(|last| last.at);
        all
    }

    fn bytes(&self) -> usize {
        self.0.values().map(|last| last.message.len()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;
    use std::time::UNIX_EPOCH;

    fn message(writer: u8, sequence: i64, bytes: usize) -> Arc<Message> {
        Arc::new(Message {
            topic: "/tf_static".into(),
            type_name: "tf2_msgs/msg/TFMessage".into(),
            writer: [writer; 16],
            sequence,
            source: None,
            received: UNIX_EPOCH,
            body: Ok((Bytes::from(vec![0; bytes]), telltale_msg::cdr::Endian::Little)),
            left_out: 0,
            kept: true,
        })
    }

    #[test]
    fn each_publisher_has_its_last_message_within_the_bounds() {
        let mut values = LastValues::default();
        let kept = |values: &mut LastValues| {
            let all = values.of(|writer| writer[0] != 2);
            all.iter().map(|last| (last.message.writer[0], last.message.sequence)).collect::<Vec<_>>()
        };
        for (writer, sequence, at_s) in [(1, 1, 30), (2, 1, 10), (3, 1, 20), (3, 2, 40)] {
            values.take(&message(writer, sequence, 10), Timestamp::from_millis(1000 * at_s));
        }
        assert_eq!(kept(&mut values), [(1, 1), (3, 2)], "oldest first; 2 keeps nothing any more");
        assert!(values.remove(&[3; 16], 1).is_none() && values.remove(&[3; 16], 2).is_some());
        values.take(&message(1, 2, BYTES_MAX + 1), Timestamp::from_millis(50_000));
        assert_eq!(kept(&mut values), []);
        for writer in 10..200 {
            values.take(&message(writer, 1, BYTES_MAX / 2), Timestamp::from_millis(writer.into()));
            values.take(&message(writer, 2, 1), Timestamp::from_millis(writer.into()));
        }
        assert_eq!(kept(&mut values).len(), WRITERS_MAX);
        for writer in 10..200 {
            values.take(&message(writer, 3, BYTES_MAX), Timestamp::from_millis(1000 + u64::from(writer)));
        }
        assert_eq!(kept(&mut values), [(196, 3), (197, 3), (198, 3), (199, 3)]);
    }
}
