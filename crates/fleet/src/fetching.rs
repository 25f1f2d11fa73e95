//! The console's side of recordings: asks vehicles for them by number, reads their pieces at the hub, and removes these.

use std::sync::Arc;

use async_nats::Client;
use bytes::Bytes;
use serde_json::json;

use crate::connection::said_of;
use crate::gate::Gate;
use crate::line::Subjects;
use crate::message::VehicleId;

/// The stream of the pieces of all recordings.
pub const PIECES_STREAM: &str = "INC";

/// The pieces of recordings at the hub.
#[derive(Debug, Clone)]
pub struct Pieces {
    client: Client,
    /// The line, where it is there for questions alone.
    _gate: Option<Arc<Gate>>,
}

/// A piece.
#[derive(Debug)]
pub struct Piece {
    /// Its number in the stream of all pieces.
    pub sequence: u64,
    pub bytes: Bytes,
}

impl Pieces {
    pub(crate) fn over(client: Client, gate: Option<Arc<Gate>>) -> Pieces {
        Pieces { client, _gate: gate }
    }

    /// Asks a vehicle for recordings, by their numbers. A vehicle that does not listen now does not hear it.
    ///
    /// # Errors
    /// The line is over.
    pub async fn want(&self, id: &VehicleId, incidents: &[u64]) -> Result<(), String> {
        let wanted = json!({ "incidents": incidents }).to_string();
        let told = self.client.publish(Subjects::of(id).want, wanted.into()).await;
        told.map_err(|error| error.to_string())
    }

    /// A piece of the recording with this SHA-256; `None` if it is not there.
    ///
    /// # Errors
    /// The hub does not answer.
    pub async fn read(&self, id: &VehicleId, sha256: &str, number: u64) -> Result<Option<Piece>, String> {
        let subject = Subjects::of(id).piece(sha256, number);
        let asked =
            self.client.request(format!("$JS.API.DIRECT.GET.{PIECES_STREAM}.{subject}"), Bytes::new());
        let found = asked.await.map_err(|error| error.to_string())?;
        match found.status.map(|status| status.as_u16()) {
            Some(404) => return Ok(None),
            Some(status) => return Err(format!("status {status}")),
            None => {}
        }
        let sequence = said_of(&found, "Nats-Sequence").and_then(|it| it.parse().ok());
        let sequence = sequence.ok_or("an answer without a number")?;
        Ok(Some(Piece { sequence, bytes: found.payload }))
    }

    /// Removes the pieces of a recording, or those with a smaller number in the stream.
    ///
    /// # Errors
    /// The hub does not answer.
    pub async fn remove(&self, id: &VehicleId, sha256: &str, before: Option<u64>) -> Result<(), String> {
        let mut wanted = json!({ "filter": Subjects::of(id).piece(sha256, "*") });
        if let Some(before) = before {
            wanted["seq"] = before.into();
        }
        let asked =
            self.client.request(format!("$JS.API.STREAM.PURGE.{PIECES_STREAM}"), wanted.to_string().into());
        asked.await.map(|_| ()).map_err(|error| error.to_string())
    }
}
