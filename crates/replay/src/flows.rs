//! How many messages of each topic a recording holds up to an instant, and how fast they came.

use std::collections::BTreeMap;
use std::sync::Arc;

use telltale_engine::time::Span;
use telltale_record::file::Channel;

/// Topics that are counted.
const TOPICS_MAX: usize = 1024;
/// Messages of so long count together, and of longer where there are too many of these.
const BUCKET: Span = Span::from_millis(100);
const BUCKETS_MAX: usize = 500_000;
/// A rate is that of this time before the instant.
const RATE_OVER: Span = Span::from_secs(5);

/// The messages of all topics, by their time of receipt.
#[derive(Debug)]
pub struct Flows {
    topics: BTreeMap<Arc<str>, Flow>,
    bucket_ns: u64,
    buckets: usize,
    first_ns: u64,
}

#[derive(Debug)]
struct Flow {
    type_name: Arc<str>,
    buckets: Vec<Bucket>,
}

#[derive(Debug, Clone, Copy)]
struct Bucket {
    /// How many of these times lie between 1970 and it.
    number: u64,
    count: u32,
    bytes: u64,
    last_ns: u64,
}

/// A topic at an instant.
#[derive(Debug, Clone, PartialEq)]
pub struct FlowThen {
    pub topic: Arc<str>,
    pub type_name: Arc<str>,
    /// Messages since the recording began.
    pub messages: u64,
    /// Messages and bytes a second, over the last five seconds.
    pub rate_hz: f64,
    pub bytes_per_s: f64,
    /// Nanoseconds since 1970, of the last one up to then; `None`: there was none yet.
    pub last_ns: Option<u64>,
}

impl Default for Flows {
    fn default() -> Flows {
        Flows { topics: BTreeMap::new(), bucket_ns: BUCKET.as_nanos(), buckets: 0, first_ns: u64::MAX }
    }
}

impl Flows {
    /// A message that was received at this time, in nanoseconds since 1970; `within`: not before the recording began.
    pub fn count(&mut self, channel: &Channel, at_ns: u64, bytes: usize, within: bool) {
        if at_ns == 0 || self.topics.len() >= TOPICS_MAX && !self.topics.contains_key(&channel.topic) {
            return;
        }
        if within {
            self.first_ns = self.first_ns.min(at_ns);
        }
        let flow = self
            .topics
            .entry(channel.topic.clone())
            .or_insert_with(|| Flow { type_name: channel.type_name.clone(), buckets: Vec::new() });
        let new = Bucket { number: at_ns / self.bucket_ns, count: 1, bytes: bytes as u64, last_ns: at_ns };
        self.buckets += usize::from(add(&mut flow.buckets, new));
        if self.buckets > BUCKETS_MAX {
            self.coarsen();
        }
    }

    fn coarsen(&mut self) {
        self.bucket_ns = self.bucket_ns.saturating_mul(2);
        self.buckets = 0;
        for flow in self.topics.values_mut() {
            let finer = std::mem::take(&mut flow.buckets);
            for bucket in finer {
                add(&mut flow.buckets, Bucket { number: bucket.number / 2, ..bucket });
            }
            flow.buckets.shrink_to_fit();
            self.buckets += flow.buckets.len();
        }
    }

    /// All topics of the recording up to this time, in nanoseconds since 1970, by name.
    pub fn at(&self, at_ns: u64) -> Vec<FlowThen> {
        let since_ns = at_ns.saturating_sub(RATE_OVER.as_nanos()).max(self.first_ns.min(at_ns));
        let seconds = at_ns.saturating_sub(since_ns).max(self.bucket_ns) as f64 / 1e9;
        let then = |(topic, flow): (&Arc<str>, &Flow)| {
            let until = flow.buckets.partition_point(|bucket| bucket.last_ns <= at_ns);
            let heard = &flow.buckets[..until];
            let late = &heard[heard.partition_point(|bucket| bucket.last_ns <= since_ns)..];
            let sum = |buckets: &[Bucket]| buckets.iter().map(|it| u64::from(it.count)).sum::<u64>();
            FlowThen {
                topic: topic.clone(),
                type_name: flow.type_name.clone(),
                messages: sum(heard),
                rate_hz: sum(late) as f64 / seconds,
                bytes_per_s: late.iter().map(|it| it.bytes).sum::<u64>() as f64 / seconds,
                last_ns: heard.last().map(|bucket| bucket.last_ns),
            }
        };
        self.topics.iter().map(then).collect()
    }
}

/// Adds messages at the end: those behind later ones count with these. Returns whether there is a bucket more.
fn add(buckets: &mut Vec<Bucket>, new: Bucket) -> bool {
    match buckets.last_mut() {
        Some(last) if new.number <= last.number => {
            last.count = last.count.saturating_add(new.count);
            last.bytes += new.bytes;
            last.last_ns = last.last_ns.max(new.last_ns);
            false
        }
        _ => {
            buckets.push(new);
            true
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    fn channel(topic: &str) -> Channel {
        Channel::cdr(topic, "std_msgs/msg/Bool", None)
    }

    #[test]
    fn a_topic_is_as_fast_as_in_the_last_seconds_and_as_old_as_its_last_message() {
        let mut flows = Flows::default();
        for tick in 0..200 {
            flows.count(&channel("/fast"), 1000 * S + tick * S / 10, 100, true);
            if tick < 100 {
                flows.count(&channel("/ends"), 1000 * S + tick * S / 10, 10, true);
            }
        }
        flows.count(&channel("/late"), 1015 * S, 1, true);
        flows.count(&channel("/timeless"), 0, 1, true);
        let at = |second| flows.at(second * S);
        let of = |second, topic: &str| at(second).into_iter().find(|it| *it.topic == *topic).unwrap();
        assert_eq!(at(1010).len(), 3);
        assert!((of(1010, "/fast").rate_hz - 10.0).abs() < 0.3, "{:?}", of(1010, "/fast"));
        assert!((of(1010, "/fast").bytes_per_s - 1000.0).abs() < 30.0);
        assert_eq!(of(1016, "/ends").rate_hz, 0.0);
        assert_eq!(of(1016, "/ends").last_ns, Some(1009 * S + 900_000_000));
        assert_eq!(of(1014, "/late").last_ns, None);
        assert_eq!((of(1016, "/late").messages, of(1016, "/ends").messages), (1, 100));
        // In the first seconds, over the time that there is.
        assert!((of(1002, "/fast").rate_hz - 10.0).abs() < 0.6, "{:?}", of(1002, "/fast"));
        assert!(at(900).iter().all(|it| it.messages == 0 && it.rate_hz == 0.0));
    }

    #[test]
    fn a_long_recording_takes_bounded_memory() {
        let mut flows = Flows::default();
        for tick in 0..2 * BUCKETS_MAX as u64 {
            flows.count(&channel("/always"), 1000 * S + tick * S / 10, 1, true);
        }
        assert!(flows.buckets <= BUCKETS_MAX && flows.topics["/always"].buckets.len() == flows.buckets);
        let end = flows.at(u64::MAX).remove(0);
        assert_eq!(end.messages, 2 * BUCKETS_MAX as u64);
        for number in 0..2 * TOPICS_MAX {
            flows.count(&channel(&format!("/{number}")), S, 1, true);
        }
        assert_eq!(flows.topics.len(), TOPICS_MAX);
    }
}
