//! The history of one vehicle, read from the log that lies at the hub.

use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::Response;
use serde::Deserialize;
use serde_json::{Value, json};
use telltale_engine::time::Span;
use telltale_fleet::history::{History, Unknown};
use telltale_fleet::message::{Batch, Message, VehicleId};
use telltale_fleet::reading::{From, Logs};
use telltale_web::common::{Asked, Moment, SignedIn, json_answer};
use telltale_web::texts::HttpError;

use super::Console;
use crate::state::time;

/// Messages of an answer, and batches that are read for it. The rest is asked for with the time of the last one.
const MESSAGES_MAX: usize = 10_000;
const BATCHES_MAX: usize = 5000;
/// Unpacked bytes of these batches.
const READ_BYTES_MAX: usize = 32 << 20;
/// Histories that are read at a time. Others wait, within the time of a request.
pub const AT_A_TIME: usize = 2;
const READ_WITHIN: Span = Span::from_secs(8);

/// Without a time to begin with: so far back.
const UNASKED_MS: i64 = 3_600_000;

/// A message may have been made this long before the hub took it and still be in a batch with later ones.
const MARGIN_MS: i64 = 15 * 60_000;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HistoryAsked {
    from: Option<Moment>,
    to: Option<Moment>,
}

/// What was read.
pub struct Known {
    history: History,
    pub contradictions: usize,
    pub refused: usize,
    /// The end was reached.
    pub is_whole: bool,
}

impl Known {
    /// The messages of a time, by the vehicle's clock.
    pub fn messages(&self, from: i64, to: i64) -> impl Iterator<Item = &Message> {
        self.history.messages().filter(move |message| (from..=to).contains(&message.at))
    }

    /// What is not known between the first and the last message that were read.
    pub fn unknown(&self) -> Vec<Unknown> {
        // What lies before the first message that was read was not asked for.
        let first = self.history.messages().next().map(Message::mark);
        let mut unknown = self.history.unknown();
        unknown.retain(|it| first.is_none_or(|first| it.from > first));
        unknown
    }
}

/// `GET /api/v1/vehicles/ID/history?from&to`: messages in their order, by the vehicle's clock.
pub async fn get(
    State(console): State<Console>,
    _: SignedIn,
    Path(id): Path<String>,
    Asked(asked): Asked<HistoryAsked>,
) -> Result<Response, HttpError> {
    let id = VehicleId::new(&id).ok_or(HttpError::NotFound)?;
    let wall_ms = telltale_clock::unix_ms(console.clock.wall());
    let to = asked.to.map_or(i64::MAX, |Moment(ms)| ms);
    let from = asked.from.map_or(wall_ms.min(to).saturating_sub(UNASKED_MS), |Moment(ms)| ms);
    let known = known(&console, &id, from, to).await?;
    let messages: Vec<&Message> = known.messages(from, to).take(MESSAGES_MAX).collect();
    let is_whole = known.is_whole && messages.len() < MESSAGES_MAX;
    let answer = json!({
        "vehicle": id.as_str(), "from": time(from),
        "messages": messages.iter().map(|it| row(it)).collect::<Vec<_>>(),
        "unknown": known.unknown().iter().map(unknown).collect::<Vec<_>>(),
        "contradictions": known.contradictions, "refused": known.refused, "whole": is_whole,
    });
    Ok(json_answer(StatusCode::OK, &answer))
}

/// Reads what a vehicle told of a time by its own clock, in milliseconds since 1970.
///
/// # Errors
/// There is no such vehicle, or the hub does not answer.
pub async fn known(console: &Console, id: &VehicleId, from: i64, to: i64) -> Result<Known, HttpError> {
    let skew_ms = {
        let fleet = console.shared.fleet();
        fleet.vehicle(id).ok_or(HttpError::NotFound)?.skew_ms().unwrap_or(0)
    };
    let logs = console.shared.logs().ok_or(HttpError::Unavailable)?;
    let stored_from = from.saturating_sub(skew_ms.max(0)).saturating_sub(MARGIN_MS);
    let until = console.clock.now() + READ_WITHIN;
    let read = console.clock.by(until, async {
        let _turn = console.histories.acquire().await.map_err(|error| error.to_string())?;
        read(&logs, id, stored_from, to).await
    });
    read.await.ok_or(HttpError::TooSlow)?.map_err(|why| {
        tracing::warn!("a history cannot be read: {why}");
        HttpError::Unavailable
    })
}

async fn read(logs: &Logs, id: &VehicleId, from_ms: i64, to: i64) -> Result<Known, String> {
    let mut known = Known { history: History::default(), contradictions: 0, refused: 0, is_whole: false };
    let mut from = From::Time(from_ms);
    let mut read_bytes = 0;
    for _ in 0..BATCHES_MAX {
        let Some((number, packed)) = logs.next(id, from).await? else {
            known.is_whole = true;
            break;
        };
        from = From::After(number);
        let (bytes, batch) = Batch::weigh(&packed, id);
        match batch {
            Ok(batch) => {
                // What follows is later still.
                let is_over = batch.messages.iter().all(|it| it.at > to.saturating_add(MARGIN_MS));
                known.contradictions += known.history.take(batch).contradictions;
                if is_over {
                    known.is_whole = true;
                    break;
                }
            }
            Err(_) => known.refused += 1,
        }
        read_bytes += bytes;
        if read_bytes > READ_BYTES_MAX {
            break;
        }
    }
    Ok(known)
}

fn row(message: &Message) -> Value {
    let mut row = json!(message);
    row["at"] = Value::from(time(message.at));
    row
}

/// The gaps between the first and the last message that were read.
fn unknown(it: &Unknown) -> Value {
    json!({ "epoch": it.from.epoch.to_string(), "n": it.from.n, "to": it.to, "why": it.why })
}
