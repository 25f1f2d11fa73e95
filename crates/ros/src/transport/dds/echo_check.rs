//! Finds a deaf DDS process: it sends numbered beats to itself through the network and notes the newest
//! that came back.

use std::sync::Arc;

use rustdds::no_key::SimpleDataReader;
use rustdds::{DomainParticipant, RTPSEntity as _, Subscriber};

use super::child::refused;
use super::discovered;
use super::qos::{self, RawWriter};
use super::raw_bytes::RawAdapter;
use crate::transport::quality::{Quality, Via};
use telltale_msg::sample_bytes::RawBody;

/// The writer and reader with which this participant hears itself, through the library's thread that sends
/// and receives.
pub struct EchoCheck {
    pub writer: Arc<RawWriter>,
    reader: SimpleDataReader<RawBody, RawAdapter>,
    pub writing: bool,
    /// The last beat that was sent, and the newest that was heard: a late beat is an old beat.
    pub said: u64,
    pub heard: u64,
}

impl EchoCheck {
    pub fn open(participant: &DomainParticipant, subscriber: &Subscriber) -> Result<EchoCheck, String> {
        let name = discovered::echo_topic(&participant.guid().to_bytes());
        let topic = qos::create_topic(participant, &name, "telltale::Alive", 1).map_err(refused)?;
        let reader = qos::reader(subscriber, &topic, Via::BestEffort).map_err(refused)?;
        let writer = qos::writer(participant, &topic, Quality::BestEffort).map_err(refused)?;
        Ok(EchoCheck { writer: Arc::new(writer), reader, writing: false, said: 0, heard: 0 })
    }

    pub fn listen(&mut self) {
        self.reader.drain_read_notifications();
        while let Ok(Some(heard)) = self.reader.try_take_one() {
            if heard.writer_guid == self.writer.guid()
                && let Ok((body, _)) = heard.into_value()
                && let Ok(beat) = body[..].try_into().map(u64::from_le_bytes)
                && beat <= self.said
            {
                self.heard = self.heard.max(beat);
            }
        }
    }

    /// Whether the beat before the last one has not come back yet.
    pub fn is_late(&self) -> bool {
        self.heard + 1 < self.said
    }
}
