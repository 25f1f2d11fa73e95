//! The readers of a DDS process, and what they have received.

use std::collections::{BTreeSet, HashSet};
use std::task::{Context, Poll};

use rustdds::dds::ReadError;
use rustdds::{Subscriber, Topic, TopicDescription as _};

use super::child::refused;
use super::qos::{self, RawReader};
use crate::transport::quality::Via;
use crate::transport::told::Told;
use crate::transport::wire::{self, Frame, FromChild};
use crate::transport::{RawSample, SAMPLE_BYTES, SampleId, WINDOW_BYTES};
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::sample_bytes::Guid;

/// A writer that discovery does not know is looked for again only after news of discovery.
const UNKNOWN_MAX: usize = 1024;
/// A smaller sample comes in one packet, or in few.
const LARGE_BYTES: usize = 64 << 10;
/// A replaced reader stays until the writers know the new one, so that nothing is lost. Meanwhile both hold fragments.
const OVERLAP: Span = Span::from_secs(1);

/// A reader, and the bytes that were passed up and not taken yet.
pub struct OpenReader {
    pub id: u32,
    pub reader: RawReader,
    /// Takes its place at this time. Until then it keeps its samples, because it may be the only one to receive them. The
    /// parent passes over those that came twice.
    next: Option<(RawReader, Timestamp)>,
    pub topic: Topic,
    pub via: Via,
    pub in_flight: usize,
    /// The bytes of its largest sample; `None` before the first one.
    largest: Option<usize>,
}

impl OpenReader {
    pub fn new(id: u32, reader: RawReader, topic: Topic, via: Via) -> OpenReader {
        OpenReader { id, reader, next: None, topic, via, in_flight: 0, largest: None }
    }

    fn is_small(&self) -> bool {
        self.largest.is_some_and(|bytes| bytes < LARGE_BYTES)
    }

    fn has_room(&self) -> bool {
        self.in_flight < WINDOW_BYTES
    }
}

/// All readers, and the writers that the parent knows.
#[derive(Default)]
pub struct OpenReaders {
    pub readers: Vec<OpenReader>,
    /// Endpoints that the parent knows.
    pub told: Told,
    pub unknown: BTreeSet<Guid>,
}

impl OpenReaders {
    /// Ready once something was received; it is in `samples` then. True if one of its writers is not known.
    pub fn poll(&mut self, context: &mut Context<'_>, samples: &mut Frame) -> Poll<Result<bool, String>> {
        let mut strangers = self.take(samples)?;
        if samples.is_empty() {
            for known in &self.readers {
                // Nobody reads these notifications, which pile up. That takes system calls, and nothing waits now.
                known.reader.drain_read_notifications();
                if let Some((next, _)) = &known.next {
                    next.drain_read_notifications();
                }
            }
            for known in self.readers.iter().filter(|known| known.has_room()) {
                known.reader.set_waker(Some(context.waker().clone()));
            }
            // A sample that came between the look and the waker would wake nobody.
            strangers = self.take(samples)?;
        }
        if samples.is_empty() { Poll::Pending } else { Poll::Ready(Ok(strangers)) }
    }

    /// Replaces the readers that may hold fragments of lost samples. Of each writer, the library keeps 128 incomplete
    /// samples, whole in size, until no fragment of them has come for 10 s: in the readers of that writer, and in all
    /// that read a writer of another participant with the same entity id. Returns the new ones. Those that have to miss
    /// no message are replaced later ([`OpenReaders::end_overlaps`]).
    ///
    /// # Errors
    /// The library refuses one.
    pub fn drop_fragments(
        &mut self,
        subscriber: &Subscriber,
        now: Timestamp,
    ) -> Result<Vec<(u32, Guid)>, String> {
        let with_alike = self.topics_with_entity_ids_of_large();
        let mut replaced = Vec::new();
        for known in self.readers.iter_mut().filter(|known| known.next.is_none()) {
            let is_large = known.via == Via::BestEffort && !known.is_small();
            if !is_large && !with_alike.contains(&known.topic.name()) {
                continue;
            }
            let next = qos::reader(subscriber, &known.topic, known.via).map_err(refused)?;
            if is_large {
                known.reader = next;
                replaced.push((known.id, known.reader.guid().to_bytes()));
            } else {
                known.next = Some((next, now + OVERLAP));
            }
        }
        Ok(replaced)
    }

    /// The topics with a writer that has the entity id of one whose messages may be large.
    fn topics_with_entity_ids_of_large(&self) -> HashSet<String> {
        let small: HashSet<_> =
            self.readers.iter().filter(|known| known.is_small()).map(|known| known.topic.name()).collect();
        let writers = || self.told.endpoints.values().filter(|found| found.writes);
        let large: HashSet<_> =
            writers().filter(|found| !small.contains(&found.topic)).map(|found| &found.guid[12..]).collect();
        writers().filter(|found| large.contains(&found.guid[12..])).map(|found| found.topic.clone()).collect()
    }

    /// Ends the readers whose successors the writers know. Returns the successors.
    ///
    /// # Errors
    /// The library can no longer read.
    pub fn end_overlaps(&mut self, now: Timestamp, samples: &mut Frame) -> Result<Vec<(u32, Guid)>, String> {
        let mut replaced = Vec::new();
        if !self.readers.iter().any(|known| known.next.as_ref().is_some_and(|(_, at)| *at <= now)) {
            return Ok(replaced);
        }
        self.take(samples)?;
        for known in &mut self.readers {
            // What it still holds is not lost.
            if known.has_room()
                && !samples.is_full()
                && let Some((next, _)) = known.next.take_if(|(_, at)| *at <= now)
            {
                known.reader = next;
                replaced.push((known.id, known.reader.guid().to_bytes()));
            }
        }
        Ok(replaced)
    }

    fn take(&mut self, samples: &mut Frame) -> Result<bool, String> {
        let mut strangers = false;
        for hearing in &mut self.readers {
            // `None` is also returned for a sample without data; the next one may follow.
            let mut nothing = 0;
            while nothing < 2 && hearing.has_room() && !samples.is_full() {
                match hearing.reader.try_take_one() {
                    Ok(Some(change)) => {
                        let sample = RawSample {
                            writer: change.writer_guid.to_bytes(),
                            sequence: i64::from(change.sequence_number),
                            source: change.source_timestamp().map(|stamp| stamp.to_ticks()),
                            related: change.related_sample_identity().map(|related| SampleId {
                                writer: related.writer_guid.to_bytes(),
                                sequence: i64::from(related.sequence_number),
                            }),
                            body: change.into_value(),
                        };
                        hearing.in_flight += sample.weight();
                        hearing.largest = hearing.largest.max(Some(sample.weight()));
                        let writer = sample.writer;
                        if !self.told.endpoints.contains_key(&writer) && self.unknown.len() < UNKNOWN_MAX {
                            strangers |= self.unknown.insert(writer);
                        }
                        samples.news(&FromChild::Sample { reader: hearing.id, sample });
                    }
                    Ok(None) => nothing += 1,
                    Err(ReadError::Poisoned { reason } | ReadError::Internal { reason }) => {
                        return Err(reason);
                    }
                    Err(error) => {
                        hearing.in_flight += SAMPLE_BYTES;
                        samples.news(&FromChild::Fault { reader: hearing.id, reason: wire::cut(&error) });
                    }
                }
            }
        }
        Ok(strangers)
    }
}
