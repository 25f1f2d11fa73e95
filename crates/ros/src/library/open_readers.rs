//! The readers of a DDS process, and what they have received.

use std::collections::{BTreeMap, BTreeSet};
use std::task::{Context, Poll};

use rustdds::dds::ReadError;
use rustdds::no_key::SimpleDataReader;
use rustdds::{Subscriber, Topic};

use super::child::refused;
use super::qos::{self, Via};
use super::raw_bytes::RawAdapter;
use super::wire::{self, Frame, FromChild};
use super::{Found, RawSample, SAMPLE_BYTES, SampleId, WINDOW_BYTES};
use telltale_msg::sample_bytes::{Guid, RawBody};

/// A writer that discovery does not know is looked for again only after news of discovery.
const UNKNOWN_MAX: usize = 1024;
/// A smaller sample comes in one packet, or in few.
const LARGE_BYTES: usize = 64 << 10;

/// A reader, and the bytes that were passed up and not taken yet.
pub struct OpenReader {
    pub id: u32,
    pub reader: SimpleDataReader<RawBody, RawAdapter>,
    pub topic: Topic,
    pub via: Via,
    pub in_flight: usize,
    /// The bytes of its largest sample; `None` before the first one.
    pub largest: Option<usize>,
}

impl OpenReader {
    /// Whether it may hold much of samples that will never be complete.
    fn may_hold_fragments(&self) -> bool {
        self.via == Via::BestEffort && self.largest.is_none_or(|bytes| bytes >= LARGE_BYTES)
    }
}

/// All readers, and the writers that the parent knows.
#[derive(Default)]
pub struct OpenReaders {
    pub readers: Vec<OpenReader>,
    /// Endpoints that the parent knows.
    pub told: BTreeMap<Guid, Found>,
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
            }
            for known in self.readers.iter().filter(|known| known.in_flight < WINDOW_BYTES) {
                known.reader.set_waker(Some(context.waker().clone()));
            }
            // A sample that came between the look and the waker would wake nobody.
            strangers = self.take(samples)?;
        }
        if samples.is_empty() { Poll::Pending } else { Poll::Ready(Ok(strangers)) }
    }

    /// Replaces the readers that may hold fragments of lost samples: the library keeps 128 incomplete samples for each
    /// writer, whole in size, until no fragment has come for 10 s. Returns the new ones.
    ///
    /// # Errors
    /// The library refuses one.
    pub fn drop_fragments(&mut self, subscriber: &Subscriber) -> Result<Vec<(u32, Guid)>, String> {
        let mut replaced = Vec::new();
        for known in self.readers.iter_mut().filter(|known| known.may_hold_fragments()) {
            known.reader = qos::reader(subscriber, &known.topic, known.via).map_err(refused)?;
            replaced.push((known.id, known.reader.guid().to_bytes()));
        }
        Ok(replaced)
    }

    fn take(&mut self, samples: &mut Frame) -> Result<bool, String> {
        let mut strangers = false;
        for hearing in &mut self.readers {
            // `None` is also returned for a sample without data; the next one may follow.
            let mut nothing = 0;
            while nothing < 2 && hearing.in_flight < WINDOW_BYTES && !samples.is_full() {
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
                        if !self.told.contains_key(&writer) && self.unknown.len() < UNKNOWN_MAX {
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
