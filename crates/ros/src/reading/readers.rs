//! The DDS readers of one topic, of the kinds that fit its writers, and those that they replace.

use std::collections::VecDeque;
use std::task::{Context, Poll};
use std::time::{Duration, SystemTime};

use crate::transport::quality::Via;
use crate::transport::{Participant, RawSample, Reader, ReaderEvent};
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::sample_bytes::{Guid, RawBody};
use telltale_msg::subscription::Subscription;

/// Samples taken at once; more than the library keeps of a topic, so that no writer starves another when
/// the queue to the engine is full.
const BATCH_MAX: usize = 2 * DEPTH_MAX;
const BATCH_BYTES_MAX: usize = RETAINED_BYTES_MAX;

/// The library keeps the last `depth` samples of a topic, read or not. A flood of small messages needs a
/// deep history; with large messages that would fill the memory. So the depth starts small, and grows where
/// a backlog requires it and the size of the messages permits it. Images and point clouds start with the least: to
/// take it back needs a new participant, during which nothing is heard of any topic.
const DEPTH_START: usize = 256;
const DEPTH_MAX: usize = 4096;
const DEPTH_MIN: usize = 8;
const DEPTH_OF_RECORDED: usize = 64;
const RETAINED_BYTES: usize = 64 << 20;
/// With more bytes than this, a participant with a smaller depth replaces the present one, because a depth
/// can only grow.
const RETAINED_BYTES_MAX: usize = 2 * RETAINED_BYTES;

/// A replaced reader stays until the writers surely know the new one, so that nothing is lost; and for some time more
/// while the new one still receives older messages: a writer that keeps 1,000 of them needs 25 s.
const OVERLAP: Span = Span::from_secs(2);
const OVERLAP_MAX: Span = Span::from_secs(60);

/// One received message.
#[derive(Debug)]
pub struct Sample {
    pub writer: Guid,
    pub sequence: i64,
    pub via: Via,
    /// The source stamp by the publisher's wall clock, if there is one.
    pub source: Option<SystemTime>,
    pub body: RawBody,
}

pub struct Readers {
    participant: Participant,
    topic: String,
    type_name: String,
    depth: usize,
    readers: Vec<Reader>,
    /// The kinds of the current readers, and since when they are these.
    fitting: (Fitting, Timestamp),
    /// When it is looked whether the replaced ones can end.
    overlap_ends: Timestamp,
    /// Messages may be lost that are not sent again.
    missed: bool,
}

/// The kinds of readers that a topic needs, of which one or two exist at once.
pub type Fitting = &'static [Via];

impl Readers {
    /// Starts without a reader: a publisher that waits for one must not send its only message before the
    /// library knows that publisher.
    pub fn new(
        participant: Participant,
        subscription: &Subscription,
        depth: usize,
        now: Timestamp,
    ) -> Readers {
        let (topic, type_name) = (subscription.dds_topic.clone(), subscription.dds_type.clone());
        let fitting: (Fitting, Timestamp) = (&[], now);
        let readers = Vec::with_capacity(2);
        Readers { participant, topic, type_name, depth, readers, fitting, overlap_ends: now, missed: false }
    }

    /// Makes the readers that fit, and ends the others once the new ones had time to be found and are not catching up.
    /// To be called now and then. Returns whether the readers changed.
    pub fn follow(&mut self, fitting: Fitting, is_catching_up: bool, now: Timestamp) -> bool {
        if self.fitting.0 != fitting {
            self.fitting = (fitting, now);
            self.overlap_ends = now + OVERLAP;
        }
        let before = self.readers.len();
        for &via in fitting {
            if !self.readers.iter().any(|known| known.via() == via) {
                self.readers.push(self.participant.reader(&self.topic, &self.type_name, via, self.depth));
            }
        }
        let is_new = self.readers.len() != before;
        if !is_new && now >= self.overlap_ends {
            if is_catching_up && now.since(self.fitting.1) < OVERLAP_MAX {
                self.overlap_ends = now + OVERLAP;
            } else {
                self.readers.retain(|known| fitting.contains(&known.via()));
            }
        }
        is_new || self.readers.len() != before
    }

    /// The kinds of the current readers, once there are some.
    pub fn fitting(&self) -> Option<Fitting> {
        (!self.readers.is_empty()).then_some(self.fitting.0)
    }

    /// When to ask again whether the replaced readers can end.
    pub fn overlap_ends(&self) -> Option<Timestamp> {
        (self.readers.len() > self.fitting.0.len()).then_some(self.overlap_ends)
    }

    /// Whether one of them is reliable, so that lost samples are sent again.
    pub fn any_reliable(&self) -> bool {
        self.readers.iter().any(|reader| reader.via() != Via::BestEffort)
    }

    /// Whether the publishers are asked for the last messages that they keep.
    pub fn asks_for_last_value(&self) -> bool {
        self.readers.iter().any(|reader| reader.via() == Via::LastValue)
    }

    /// Lets the library keep more samples from now on.
    pub fn deepen(&mut self, depth: usize) {
        self.depth = depth;
        self.participant.deepen(&self.topic, &self.type_name, depth);
    }

    /// Whether messages may have been lost since this was asked last.
    pub fn may_have_missed(&mut self) -> bool {
        std::mem::take(&mut self.missed)
    }

    /// Ready once something was received: it is appended to `batch`, or to `faults` if it was not handed
    /// over.
    pub fn poll(
        &mut self,
        context: &mut Context<'_>,
        batch: &mut Vec<Sample>,
        faults: &mut Vec<String>,
    ) -> Poll<()> {
        let mut bytes = 0;
        for reader in &mut self.readers {
            let via = reader.via();
            while batch.len() + faults.len() < BATCH_MAX
                && bytes < BATCH_BYTES_MAX
                && let Poll::Ready(heard) = reader.poll(context)
            {
                match heard {
                    ReaderEvent::Sample(RawSample { writer, sequence, source, body, .. }) => {
                        bytes += body.as_ref().map_or(0, |(body, _)| body.len());
                        let source = source.map(wall_time);
                        batch.push(Sample { writer, sequence, via, source, body });
                    }
                    ReaderEvent::Fault(reason) => faults.push(reason),
                    ReaderEvent::Missed => self.missed = true,
                }
            }
        }
        if batch.is_empty() && faults.is_empty() && !self.missed { Poll::Pending } else { Poll::Ready(()) }
    }
}

/// Ticks are seconds in 32.32 bits since 1970.
fn wall_time(ticks: u64) -> SystemTime {
    let nanos = ((ticks & 0xffff_ffff) * 1_000_000_000) >> 32;
    SystemTime::UNIX_EPOCH + Duration::new(ticks >> 32, nanos as u32)
}

/// Follows the samples that the library keeps of a topic, and computes the depth that fits.
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
    /// Fewer samples need a new participant.
    Rebuild(usize),
}

impl Retention {
    pub fn new() -> Retention {
        Retention::with_depth(DEPTH_START)
    }

    /// For images and point clouds.
    pub fn of_large_messages() -> Retention {
        Retention::with_depth(DEPTH_MIN)
    }

    /// For what is only recorded, which may be of any size: of up to 2 MB each, so many can be kept.
    pub fn of_recorded_messages() -> Retention {
        Retention::with_depth(DEPTH_OF_RECORDED)
    }

    pub fn with_depth(depth: usize) -> Retention {
        Retention { depth, sizes: VecDeque::new(), bytes: 0 }
    }

    pub fn depth(&self) -> usize {
        self.depth
    }

    /// Takes the sizes of the samples that were received at once.
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
        if self.bytes > RETAINED_BYTES_MAX && self.depth > DEPTH_MIN {
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
        for bytes in [1_500_000, 10_000_000, 40_000_000] {
            let mut retention = Retention::of_large_messages();
            let advices = (0..100).map(|_| observe(&mut retention, 1, bytes)).collect::<Vec<_>>();
            assert!(advices.iter().all(|advice| *advice == Advice::Fits), "{advices:?}");
        }
    }
}
