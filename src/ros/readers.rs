//! The DDS reader of one topic, of the kind that fits its writers, and the one that it replaces.

use std::collections::VecDeque;
use std::task::{Context, Poll};
use std::time::{Duration, SystemTime};

use rustdds::dds::{CreateResult, ReadError};
use rustdds::no_key::SimpleDataReader;
use rustdds::policy::{Durability, History, Reliability, ResourceLimits};
use rustdds::{
    DomainParticipant, QosPolicies, QosPolicyBuilder, Subscriber, Topic, TopicDescription, TopicKind,
};

use super::raw::{RawAdapter, RawBody};
use super::subscription::Subscription;
use super::writers::{Guid, Via};
use crate::engine::time::{Span, Timestamp};

/// Samples taken at once; more than the library keeps of a topic, so that no writer starves
/// another when the engine holds us back.
const BATCH_MAX: usize = 2 * DEPTH_MAX;
const BATCH_BYTES_MAX: usize = RETAINED_BYTES_MAX;

/// The library keeps the last `depth` samples of a topic, read or not. A flood of small messages
/// needs a deep history, large ones would fill the memory with it: so it starts shallow, and grows
/// where a backlog shows that it must and the size of the messages lets it.
const DEPTH_START: usize = 256;
const DEPTH_MAX: usize = 4096;
const DEPTH_MIN: usize = 8;
const RETAINED_BYTES: usize = 64 << 20;
/// With more than this, a participant with a smaller depth replaces the present one: a depth can
/// only grow.
const RETAINED_BYTES_MAX: usize = 2 * RETAINED_BYTES;

/// A reader that is replaced stays until the writers surely know the new one, so that nothing is lost.
const OVERLAP: Span = Span::from_secs(2);

/// One received message.
#[derive(Debug)]
pub struct Sample {
    pub writer: Guid,
    pub sequence: i64,
    pub via: Via,
    /// The publisher's wall clock, if it says.
    pub source: Option<SystemTime>,
    pub body: RawBody,
}

/// What may go wrong in the library itself.
#[derive(Debug)]
pub enum ReadFault {
    /// One sample was not handed over.
    Sample(String),
    /// The participant is beyond use.
    Broken(String),
}

pub struct Readers {
    participant: DomainParticipant,
    subscriber: Subscriber,
    topic: Topic,
    readers: Vec<(Via, SimpleDataReader<RawBody, RawAdapter>)>,
    /// The kind that is to stay, and since when it is there.
    fitting: (Via, Timestamp),
}

impl Readers {
    /// Starts without a reader: a publisher that waits for one must not send its only message before the
    /// library knows whose it is.
    pub fn new(
        participant: DomainParticipant,
        subscriber: Subscriber,
        subscription: &Subscription,
        depth: usize,
        now: Timestamp,
    ) -> CreateResult<Readers> {
        let topic = create_topic(&participant, &subscription.dds_topic, &subscription.dds_type, depth)?;
        let fitting = (Via::BestEffort, now);
        Ok(Readers { participant, subscriber, topic, readers: Vec::with_capacity(2), fitting })
    }

    /// Makes the reader that fits, and ends the others once it had time to be found. To be asked every
    /// now and then. Returns whether the readers are others now.
    pub fn follow(&mut self, via: Via, now: Timestamp) -> CreateResult<bool> {
        if self.fitting.0 != via {
            self.fitting = (via, now);
        }
        if !self.readers.iter().any(|(known, _)| *known == via) {
            let reader =
                self.subscriber.create_simple_datareader_no_key(&self.topic, Some(reader_qos(via)))?;
            self.readers.push((via, reader));
            return Ok(true);
        }
        let before = self.readers.len();
        if now.since(self.fitting.1) >= OVERLAP {
            self.readers.retain(|(known, _)| *known == via);
        }
        Ok(self.readers.len() != before)
    }

    /// The kind that is to stay, once there is one.
    pub fn fitting(&self) -> Option<Via> {
        (!self.readers.is_empty()).then_some(self.fitting.0)
    }

    /// When the readers that are replaced are to end.
    pub fn overlap_ends(&self) -> Option<Timestamp> {
        (self.readers.len() > 1).then(|| self.fitting.1 + OVERLAP)
    }

    /// Whether one of them has what is lost sent again.
    pub fn any_reliable(&self) -> bool {
        self.readers.iter().any(|(via, _)| *via != Via::BestEffort)
    }

    pub fn guids(&self) -> impl Iterator<Item = Guid> {
        self.readers.iter().map(|(_, reader)| reader.guid().to_bytes())
    }

    /// Lets the library keep more samples from now on.
    pub fn deepen(&self, depth: usize) -> CreateResult<()> {
        let type_name = self.topic.get_type().name().to_owned();
        create_topic(&self.participant, &self.topic.name(), &type_name, depth).map(drop)
    }

    /// Ready once something was received; it is appended to `batch`.
    pub fn poll(
        &mut self,
        context: &mut Context<'_>,
        batch: &mut Vec<Sample>,
        faults: &mut Vec<ReadFault>,
    ) -> Poll<()> {
        self.take(batch, faults);
        if batch.is_empty() && faults.is_empty() {
            for (_, reader) in &self.readers {
                reader.set_waker(Some(context.waker().clone()));
            }
            // What came between the look and the waker would wake nobody.
            self.take(batch, faults);
        }
        if batch.is_empty() && faults.is_empty() { Poll::Pending } else { Poll::Ready(()) }
    }

    fn take(&mut self, batch: &mut Vec<Sample>, faults: &mut Vec<ReadFault>) {
        let mut bytes = 0;
        for (via, reader) in &self.readers {
            reader.drain_read_notifications();
            // Nothing is also said for a sample that is no data; the next may follow.
            let mut nothing = 0;
            while nothing < 2
                && batch.len() < BATCH_MAX
                && bytes < BATCH_BYTES_MAX
                && faults.len() < BATCH_MAX
            {
                match reader.try_take_one() {
                    Ok(Some(change)) => {
                        let (writer, sequence) =
                            (change.writer_guid.to_bytes(), i64::from(change.sequence_number));
                        let source = change.source_timestamp().map(wall_time);
                        let body = change.into_value();
                        bytes += body.as_ref().map_or(0, |(body, _)| body.len());
                        batch.push(Sample { writer, sequence, via: *via, source, body });
                    }
                    Ok(None) => nothing += 1,
                    Err(ReadError::Poisoned { reason } | ReadError::Internal { reason }) => {
                        faults.push(ReadFault::Broken(reason));
                        return;
                    }
                    Err(error) => faults.push(ReadFault::Sample(error.to_string())),
                }
            }
        }
    }
}

/// Ticks are seconds in 32.32 bits since 1970.
fn wall_time(stamp: rustdds::Timestamp) -> SystemTime {
    let ticks = stamp.to_ticks();
    let nanos = ((ticks & 0xffff_ffff) * 1_000_000_000) >> 32;
    SystemTime::UNIX_EPOCH + Duration::new(ticks >> 32, nanos as u32)
}

/// Also tells the library how many samples of the topic it keeps, which can only grow.
pub fn create_topic(
    participant: &DomainParticipant,
    name: &str,
    type_name: &str,
    depth: usize,
) -> CreateResult<Topic> {
    let depth = i32::try_from(depth).unwrap_or(i32::MAX);
    let limits = ResourceLimits { max_samples: depth, max_instances: 1, max_samples_per_instance: depth };
    let qos = QosPolicyBuilder::new().history(History::KeepLast { depth }).resource_limits(limits).build();
    participant.create_topic(name.to_owned(), type_name.to_owned(), &qos, TopicKind::NoKey)
}

/// No deadline, no lifespan: whatever is asked for beyond what a writer offers breaks the match.
pub fn reader_qos(via: Via) -> QosPolicies {
    let qos = QosPolicyBuilder::new();
    let reliable = Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) };
    match via {
        Via::Reliable => qos.reliability(reliable).durability(Durability::Volatile),
        Via::LastValue => qos.reliability(reliable).durability(Durability::TransientLocal),
        Via::BestEffort => qos.best_effort().durability(Durability::Volatile),
    }
    .build()
}

/// Follows what the library keeps of a topic, and says which depth fits.
#[derive(Debug)]
pub struct Retention {
    depth: usize,
    /// Sizes of the last `depth` messages.
    sizes: VecDeque<usize>,
    bytes: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Advice {
    Fits,
    Deepen(usize),
    /// Only a new participant can keep fewer.
    Rebuild(usize),
}

impl Retention {
    pub fn new() -> Retention {
        Retention::with_depth(DEPTH_START)
    }

    pub fn with_depth(depth: usize) -> Retention {
        Retention { depth, sizes: VecDeque::new(), bytes: 0 }
    }

    pub fn depth(&self) -> usize {
        self.depth
    }

    /// Takes the sizes of what was received at once.
    pub fn observe(&mut self, received: impl ExactSizeIterator<Item = usize>) -> Advice {
        let backlog = received.len();
        for size in received {
            self.sizes.push_back(size);
            self.bytes += size;
        }
        while self.sizes.len() > self.depth {
            self.bytes -= self.sizes.pop_front().unwrap_or(0);
        }
        let mean = self.bytes.checked_div(self.sizes.len()).unwrap_or(0);
        if self.bytes > RETAINED_BYTES_MAX {
            return Advice::Rebuild((RETAINED_BYTES / mean.max(1)).clamp(DEPTH_MIN, DEPTH_MAX));
        }
        let deeper = (self.depth * 2).min(DEPTH_MAX);
        if backlog > self.depth / 4 && deeper > self.depth && deeper * mean <= RETAINED_BYTES {
            self.depth = deeper;
            return Advice::Deepen(deeper);
        }
        Advice::Fits
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn observe(retention: &mut Retention, messages: usize, bytes: usize) -> Advice {
        retention.observe(vec![bytes; messages].into_iter())
    }

    #[test]
    fn floods_of_small_messages_get_a_deep_history() {
        let mut retention = Retention::new();
        assert_eq!(observe(&mut retention, 10, 1000), Advice::Fits);
        let advices: Vec<_> = (0..5).map(|_| observe(&mut retention, 2000, 1000)).collect();
        assert_eq!(
            advices,
            [
                Advice::Deepen(512),
                Advice::Deepen(1024),
                Advice::Deepen(2048),
                Advice::Deepen(4096),
                Advice::Fits
            ]
        );
    }

    #[test]
    fn large_messages_never_fill_the_memory() {
        let mut retention = Retention::new();
        assert_eq!(observe(&mut retention, 120, 1_000_000), Advice::Fits, "deeper would be too much");
        let mut depth = 0;
        for _ in 0..20 {
            if let Advice::Rebuild(smaller) = observe(&mut retention, 1, 20_000_000) {
                depth = smaller;
                break;
            }
        }
        assert!((DEPTH_MIN..100).contains(&depth), "{depth}");
        let mut retention = Retention::with_depth(DEPTH_MIN);
        let advices = (0..100).map(|_| observe(&mut retention, 1, 10_000_000)).collect::<Vec<_>>();
        assert!(advices.iter().all(|advice| *advice == Advice::Fits), "{advices:?}");
    }
}
