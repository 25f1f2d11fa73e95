//! Messages and tokens from the callbacks of the Zenoh library, until they are passed up. A callback never waits: of more messages
//! than a reader keeps the oldest are dropped, and their numbers show it.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use tokio::sync::Notify;
use zenoh::bytes::ZBytes;
use zenoh::query::Query;

use super::attachment::Attachment;
use super::graph::Graph;
use super::names::{Channel, Part};
use crate::transport::wire::{Frame, FromChild};
use crate::transport::{BODY_BYTES_MAX, RawSample, SampleId, WINDOW_BYTES};
use telltale_msg::cdr::{Endian, Fault, FaultKind};
use telltale_msg::sample_bytes::{Guid, RawBody};

/// Bytes of messages that wait for one reader, beside the newest message.
const WAITING_BYTES_MAX: usize = 32 << 20;
/// Publishers of one reader that are remembered with the number of their newest message.
const PUBLISHERS_MAX: usize = 256;
/// Calls that are not answered yet.
const CALLS_MAX: usize = 256;

#[derive(Debug, Default)]
pub struct Heard {
    state: Mutex<State>,
    pub wake: Notify,
}

#[derive(Debug, Default)]
pub struct State {
    pub graph: Graph,
    pub queues: BTreeMap<u32, Queue>,
    /// Calls of our services, by client and number.
    pub calls: VecDeque<(SampleId, Query)>,
    pub news: Vec<FromChild>,
    /// The newest beat that the router has answered, and the newest question about lost tokens.
    pub echo: u64,
    pub confirmed: u64,
    /// The number of the follower that counts, and of the tokens that it holds.
    pub following: u64,
    pub there: usize,
    /// The router dropped messages, because this line was too slow. Any publisher's may be among them.
    pub dropped: bool,
    /// The library can no longer be used.
    pub broken: Option<String>,
}

/// The messages of one reader.
#[derive(Debug)]
pub struct Queue {
    pub channel: Option<(Channel, Part)>,
    depth: usize,
    waiting: VecDeque<RawSample>,
    bytes: usize,
    /// Bytes that were passed up and not taken yet.
    in_flight: usize,
    /// Messages without an attachment, which have no number.
    unnumbered: i64,
    /// The number of the newest message of each publisher that the graph knows.
    newest: BTreeMap<Guid, i64>,
}

impl Heard {
    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state, and wakes the process.
    pub fn with<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        let changed = change(&mut self.state());
        self.wake.notify_one();
        changed
    }

    /// A message for a reader. A reply is related to its request.
    pub fn hear(
        &self,
        reader: u32,
        payload: &ZBytes,
        attachment: Option<&ZBytes>,
        reply: Option<(Guid, SampleId)>,
    ) {
        let attached = attachment.and_then(|bytes| Attachment::read(&bytes.to_bytes()));
        let body = body(&payload.to_bytes());
        self.with(|state| {
            let State { graph, queues, dropped, .. } = state;
            let Some(queue) = queues.get_mut(&reader) else { return };
            let sample = match attached {
                Some(attached) => RawSample {
                    // A reply repeats the id of the client.
                    writer: match (reply, graph.writer(&attached.gid)) {
                        (Some((server, _)), _) => server,
                        (None, Some(known)) => {
                            *dropped |= queue.note(known, attached.sequence);
                            known
                        }
                        (None, None) => attached.gid,
                    },
                    sequence: attached.sequence,
                    source: attached.source(),
                    related: reply.map(|(_, request)| request),
                    body,
                },
                None => {
                    queue.unnumbered += 1;
                    RawSample {
                        writer: [0; 16],
                        sequence: queue.unnumbered,
                        source: None,
                        related: None,
                        body,
                    }
                }
            };
            queue.push(sample);
        });
    }

    /// A call of a service that we offer. The oldest of too many ends without an answer.
    pub fn hear_call(&self, reader: u32, query: Query) {
        let attached = query.attachment().and_then(|bytes| Attachment::read(&bytes.to_bytes()));
        let (Some(attached), Some(payload)) = (attached, query.payload().cloned()) else { return };
        let writer = self.state().graph.writer(&attached.gid).unwrap_or(attached.gid);
        let id = SampleId { writer, sequence: attached.sequence };
        self.with(|state| {
            if state.calls.len() >= CALLS_MAX {
                state.calls.pop_front();
            }
            state.calls.push_back((id, query));
        });
        let attachment = ZBytes::from(attached.bytes());
        self.hear(reader, &payload, Some(&attachment), None);
    }
}

impl State {
    /// A token is there or gone.
    pub fn token(&mut self, follower: u64, key: &str, is_there: bool) {
        if follower != self.following {
            return;
        }
        if is_there {
            self.there += 1;
            self.graph.add(key);
        } else {
            self.there = self.there.saturating_sub(1);
            self.graph.lose(key);
        }
    }

    /// Passes up what waits, as far as its readers have room.
    pub fn take(&mut self, frame: &mut Frame) {
        for (reader, queue) in &mut self.queues {
            while queue.in_flight < WINDOW_BYTES && !frame.is_full() {
                let Some(sample) = queue.waiting.pop_front() else { break };
                let weight = sample.weight();
                queue.bytes -= weight;
                queue.in_flight += weight;
                frame.news(&FromChild::Sample { reader: *reader, sample });
            }
        }
    }

    pub fn open(&mut self, reader: u32, depth: usize, channel: Option<(Channel, Part)>) {
        let (waiting, depth) = (VecDeque::new(), depth.max(1));
        let queue =
            Queue { channel, depth, waiting, bytes: 0, in_flight: 0, unnumbered: 0, newest: BTreeMap::new() };
        self.queues.insert(reader, queue);
    }

    /// So many bytes of a reader were taken.
    pub fn taken(&mut self, reader: u32, bytes: usize) {
        if let Some(queue) = self.queues.get_mut(&reader) {
            queue.in_flight = queue.in_flight.saturating_sub(bytes);
        }
    }

    /// Keeps more messages of a channel.
    pub fn deepen(&mut self, channel: &(Channel, Part), depth: usize) {
        for queue in self.queues.values_mut().filter(|queue| queue.channel.as_ref() == Some(channel)) {
            queue.depth = queue.depth.max(depth);
        }
    }

    /// The call with this id, which is answered now.
    pub fn call(&mut self, id: &SampleId) -> Option<Query> {
        let place = self.calls.iter().position(|(known, _)| known == id)?;
        self.calls.remove(place).map(|(_, query)| query)
    }

    /// The readers of a channel.
    pub fn readers(&self, channel: &(Channel, Part)) -> Vec<u32> {
        let read = self.queues.iter().filter(|(_, queue)| queue.channel.as_ref() == Some(channel));
        read.map(|(id, _)| *id).collect()
    }
}

impl Queue {
    /// Notes the number of a message. Returns whether some before it are missing. Once there are more publishers than are
    /// remembered, all are forgotten.
    fn note(&mut self, writer: Guid, sequence: i64) -> bool {
        if self.newest.len() >= PUBLISHERS_MAX {
            self.newest.clear();
        }
        let before = self.newest.insert(writer, sequence);
        before.is_some_and(|before| sequence.saturating_sub(before) > 1)
    }

    pub fn push(&mut self, sample: RawSample) {
        self.bytes += sample.weight();
        self.waiting.push_back(sample);
        while self.waiting.len() > self.depth || self.bytes > WAITING_BYTES_MAX && self.waiting.len() > 1 {
            let Some(oldest) = self.waiting.pop_front() else { break };
            self.bytes -= oldest.weight();
        }
    }
}

/// The body of a message, behind the four bytes of its encapsulation.
fn body(payload: &[u8]) -> RawBody {
    let fault = |what| Err(Fault { at: 0, what });
    let Some(([first, second, ..], body)) = payload.split_first_chunk::<4>() else {
        return fault(FaultKind::Encoding([0xff, 0xff]));
    };
    if body.len() > BODY_BYTES_MAX {
        return fault(FaultKind::TooLarge { bytes: body.len(), limit: BODY_BYTES_MAX });
    }
    match (first, second) {
        (0, 0) => Ok((Bytes::copy_from_slice(body), Endian::Big)),
        (0, 1) => Ok((Bytes::copy_from_slice(body), Endian::Little)),
        _ => fault(FaultKind::Encoding([*first, *second])),
    }
}
