//! The last messages of latched topics that the ring forgot: they still count, and a recording has them.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use telltale_engine::time::Timestamp;
use telltale_msg::received::Message;
use telltale_msg::sample_bytes::Guid;

/// Writers of one topic whose last message is kept; of more, those that wrote last. Each static transform may have one of
/// its own.
const WRITERS_MAX: usize = 64;

/// One message, and all messages of one topic, take at most this part of the ring's bytes.
const TOPIC_SHARE: usize = 64;

/// All of them take at most this part of the ring's bytes.
const SHARE: usize = 16;

/// A message with the time of its receipt.
pub type Kept = (Timestamp, Arc<Message>);

/// The last message of each writer of a topic that keeps it for late readers.
#[derive(Debug, Clone, Default)]
pub struct Latched {
    topics: BTreeMap<Arc<str>, VecDeque<Kept>>,
    bytes: usize,
}

impl Latched {
    /// Takes a message in the place of the one before of the same writer. A larger one than the bound allows makes its
    /// topic's writer have none. Where all together would be too many, the oldest ones go.
    pub fn take(&mut self, at: Timestamp, message: Arc<Message>, ring_bytes_max: usize) {
        self.forget(&message.topic, Some(message.writer));
        if message.len() > ring_bytes_max / TOPIC_SHARE {
            return;
        }
        let topic = message.topic.clone();
        self.bytes += message.len();
        self.topics.entry(topic.clone()).or_default().push_back((at, message));
        while self.topics.get(&topic).is_some_and(|kept| {
            let bytes: usize = kept.iter().map(|(_, message)| message.len()).sum();
            kept.len() > WRITERS_MAX || bytes > ring_bytes_max / TOPIC_SHARE
        }) {
            self.forget(&topic, None);
        }
        while self.bytes > ring_bytes_max / SHARE {
            let oldest = |(_, kept): &(&Arc<str>, &VecDeque<Kept>)| kept.front().map(|(at, _)| *at);
            let Some(topic) = self.topics.iter().min_by_key(oldest).map(|(topic, _)| topic.clone()) else {
                return;
            };
            self.forget(&topic, None);
        }
    }

    /// Forgets the message of a writer, or the oldest one of the topic.
    fn forget(&mut self, topic: &Arc<str>, writer: Option<Guid>) {
        let Some(kept) = self.topics.get_mut(topic) else { return };
        let place = match writer {
            Some(writer) => kept.iter().position(|(_, message)| message.writer == writer),
            None => Some(0),
        };
        if let Some((_, gone)) = place.and_then(|place| kept.remove(place)) {
            self.bytes -= gone.len();
        }
        if kept.is_empty() {
            self.topics.remove(topic);
        }
    }

    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// All of them, the oldest first.
    pub fn in_order(self) -> Vec<Kept> {
        let mut all: Vec<Kept> = self.topics.into_values().flatten().collect();
        all.sort_by_key(|(at, _)| *at);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_msg::cdr::Endian;

    fn message(topic: &str, writer: u8, bytes: usize) -> Arc<Message> {
        Arc::new(Message {
            topic: topic.into(),
            type_name: "std_msgs/msg/String".into(),
            writer: [writer; 16],
            sequence: 1,
            source: None,
            received: std::time::SystemTime::UNIX_EPOCH,
            body: Ok((vec![0; bytes].into(), Endian::Little)),
            left_out: 0,
            kept: true,
        })
    }

    /// The topics and writers that are kept of such messages, one a millisecond, in a ring of 64,000 bytes.
    fn kept(messages: &[(&str, u8, usize)]) -> Vec<(String, u8)> {
        let mut latched = Latched::default();
        for (at, &(topic, writer, bytes)) in messages.iter().enumerate() {
            latched.take(Timestamp::from_millis(at as u64), message(topic, writer, bytes), 64_000);
            let sum: usize = latched.topics.values().flatten().map(|(_, it)| it.len()).sum();
            assert!(latched.bytes == sum && sum <= 4_000, "{sum}");
        }
        latched.in_order().iter().map(|(_, it)| (it.topic.to_string(), it.writer[0])).collect()
    }

    #[test]
    fn the_last_message_of_each_writer_stays_within_bounds() {
        let named = |list: &[(&str, u8)]| {
            list.iter().map(|&(topic, writer)| (topic.to_owned(), writer)).collect::<Vec<_>>()
        };
        assert_eq!(kept(&[("/a", 1, 10), ("/b", 1, 10), ("/a", 1, 10)]), named(&[("/b", 1), ("/a", 1)]));
        assert_eq!(kept(&[("/a", 1, 10), ("/a", 2, 10)]), named(&[("/a", 1), ("/a", 2)]));
        // Too large: the one before no longer counts either.
        assert_eq!(kept(&[("/a", 1, 10), ("/a", 1, 1_001)]), named(&[]));
        // A topic's bytes, then all together.
        assert_eq!(kept(&[("/a", 1, 600), ("/a", 2, 600)]), named(&[("/a", 2)]));
        let many = [("/a", 1, 900), ("/b", 1, 900), ("/c", 1, 900), ("/d", 1, 900), ("/e", 1, 900)];
        assert_eq!(kept(&many), named(&[("/b", 1), ("/c", 1), ("/d", 1), ("/e", 1)]));
        let writers: Vec<_> = (0..100).map(|writer| ("/a", writer, 0)).collect();
        assert_eq!(kept(&writers).len(), WRITERS_MAX);
        let topics: Vec<String> = (0..500).map(|at| format!("/{at}")).collect();
        let topics: Vec<_> = topics.iter().map(|topic| (topic.as_str(), 1, 0)).collect();
        assert_eq!(kept(&topics).len(), 500);
    }
}
