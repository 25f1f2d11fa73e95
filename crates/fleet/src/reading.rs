//! The console's line to the hub: it reads the streams of heads and logs. Requests of
//! JetStream are plain requests, as on the vehicle's line, and each answer is read with bounds.

use std::sync::Arc;
use std::time::Duration;

use async_nats::{Client, ConnectOptions, Event, Message, ServerError, Subscriber};
use bytes::Bytes;
use futures_util::StreamExt as _;
use serde::Deserialize;
use telltale_clock::{of_unix_ms, unix_ms};
use telltale_engine::time::Span;
use tokio::sync::watch;
use tokio::time::timeout;

use crate::connection::{self, said_of};
use crate::fetching::Pieces;
use crate::gate::{Gate, Pace};
use crate::hub::{has, make_heads};
use crate::identity::Identity;
use crate::line::{Hub, LIVE_FOR_MAX, LOG_STREAM, NoLine, Subjects};
use crate::message::VehicleId;

/// The stream of all heads.
pub const HEAD_STREAM: &str = "HEAD";

/// Messages that are asked for at once. A subscription has room for those of both streams.
const PULLED_AT_ONCE: usize = 64;
const PULLED_BYTES: usize = 8 << 20;
const PULL_LASTS: Duration = Duration::from_secs(20);

/// The hub says this often that it is there, and is away after a longer silence.
const BEAT_EVERY: Duration = Duration::from_secs(1);
const SILENCE_MAX: Duration = Duration::from_secs(4);

const ANSWERED_WITHIN: Duration = Duration::from_secs(5);
const ANSWER_BYTES_MAX: usize = 64 * 1024;

/// The hub forgets a reader that asks for nothing.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(60);

/// A stream that a console reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    Head,
    Log,
}

impl Stream {
    const fn name(self) -> &'static str {
        match self {
            Stream::Head => HEAD_STREAM,
            Stream::Log => LOG_STREAM,
        }
    }
}

/// A message as it lies at the hub.
#[derive(Debug)]
pub struct Read {
    pub stream: Stream,
    pub id: VehicleId,
    pub packed: Bytes,
    pub sequence: u64,
    /// When the hub took it, by its clock, in milliseconds since 1970.
    pub stored_ms: i64,
    /// How long it lay there when this line began; zero if it came later.
    pub age: Span,
}

/// An open line. It ends with the first fault; then another is made.
#[derive(Debug)]
pub struct Reading {
    client: Client,
    inbox: String,
    messages: Subscriber,
    gate: Gate,
    head: Reader,
    log: Reader,
}

/// One stream as the hub gives it out.
#[derive(Debug)]
struct Reader {
    stream: Stream,
    /// Where more messages are asked for.
    next: String,
    /// Messages that were asked for and did not come yet.
    wanted: usize,
    /// When it began, by the hub's clock, in milliseconds since 1970.
    began_ms: i64,
}

impl Reading {
    /// Reads the last head of each vehicle, the log from a time of the hub's clock on, and all that follows.
    ///
    /// # Errors
    /// The hub is not reached, does not admit this console, or has no streams.
    pub async fn open(hub: &Hub, console: &Identity, log_from_ms: i64) -> Result<Reading, NoLine> {
        let options = options(console).subscription_capacity(3 * PULLED_AT_ONCE);
        let (client, gate) = connection::open(hub, Pace::Any, options).await?;
        let inbox = client.new_inbox();
        let subscribed = client.subscribe(format!("{inbox}.*")).await;
        let messages = subscribed.map_err(|error| NoLine::Unreachable(error.to_string()))?;
        make_heads(&client).await.map_err(|error| NoLine::Unreachable(error.to_string()))?;
        // The stream has one head of each vehicle.
        let all = serde_json::json!({ "deliver_policy": "all" });
        let head = Reader::begin(&client, Stream::Head, all).await?;
        let from = humantime::format_rfc3339_millis(of_unix_ms(log_from_ms)).to_string();
        let log = Reader::begin(
            &client,
            Stream::Log,
            serde_json::json!({ "deliver_policy": "by_start_time", "opt_start_time": from }),
        );
        let log = log.await?;
        Ok(Reading { client, inbox, messages, gate, head, log })
    }

    /// A handle for questions, which may outlive the line.
    pub fn logs(&self) -> Logs {
        Logs { client: self.client.clone(), gate: None }
    }

    /// The next message. What nobody can have sent as a vehicle is passed over.
    ///
    /// # Errors
    /// Why the line is of no use any more.
    pub async fn next(&mut self) -> Result<Read, String> {
        loop {
            for reader in [&mut self.head, &mut self.log] {
                reader.ask(&self.client, &self.inbox).await?;
            }
            let message = tokio::select! {
                why = self.gate.ended() => return Err(why),
                message = timeout(SILENCE_MAX, self.messages.next()) => message,
            };
            let message = message.map_err(|_| "the hub is silent")?.ok_or("the line was cut")?;
            // A message has the vehicle's subject, and what the hub says of a stream the subject that was asked with.
            let is_of_head = [".head", ".HEAD"].iter().any(|end| message.subject.ends_with(end));
            let reader = if is_of_head { &mut self.head } else { &mut self.log };
            if let Some(read) = reader.take(message)? {
                return Ok(read);
            }
        }
    }
}

impl Reader {
    /// Lets the hub remember a reader of a stream.
    async fn begin(client: &Client, stream: Stream, policy: serde_json::Value) -> Result<Reader, NoLine> {
        #[derive(Deserialize)]
        struct Made {
            name: Option<String>,
            created: Option<String>,
            error: Option<Fault>,
        }
        #[derive(Deserialize)]
        struct Fault {
            #[serde(default)]
            description: String,
        }
        let unreachable = |why: String| NoLine::Unreachable(format!("the stream {}: {why}", stream.name()));
        let mut config = serde_json::json!({
            "ack_policy": "none", "replay_policy": "instant", "mem_storage": true, "num_replicas": 1,
            "inactive_threshold": nanos(FORGOTTEN_AFTER),
        });
        if let (Some(config), Some(policy)) = (config.as_object_mut(), policy.as_object()) {
            config.extend(policy.clone());
        }
        let wanted = serde_json::json!({ "stream_name": stream.name(), "config": config }).to_string();
        let subject = format!("$JS.API.CONSUMER.CREATE.{}", stream.name());
        let answer = client.request(subject, wanted.into()).await;
        let answer = answer.map_err(|error| unreachable(error.to_string()))?;
        let made: Made = Some(&answer.payload)
            .filter(|payload| payload.len() <= ANSWER_BYTES_MAX)
            .and_then(|payload| serde_json::from_slice(payload).ok())
            .ok_or_else(|| unreachable("its answer cannot be read".into()))?;
        match (made.name, made.created.and_then(|it| humantime::parse_rfc3339(&it).ok()), made.error) {
            (Some(name), Some(created), None) if name.bytes().all(|it| it.is_ascii_alphanumeric()) => {
                let next = format!("$JS.API.CONSUMER.MSG.NEXT.{}.{name}", stream.name());
                Ok(Reader { stream, next, wanted: 0, began_ms: unix_ms(created) })
            }
            (_, _, Some(fault)) => Err(unreachable(fault.description.chars().take(200).collect())),
            _ => Err(unreachable("its answer cannot be read".into())),
        }
    }

    /// Asks for more, if nothing is awaited.
    async fn ask(&mut self, client: &Client, inbox: &str) -> Result<(), String> {
        if self.wanted > 0 {
            return Ok(());
        }
        let wanted = serde_json::json!({
            "batch": PULLED_AT_ONCE, "max_bytes": PULLED_BYTES, "expires": nanos(PULL_LASTS),
            "idle_heartbeat": nanos(BEAT_EVERY),
        });
        let reply = format!("{inbox}.{}", self.stream.name());
        let asked = client.publish_with_reply(self.next.clone(), reply, wanted.to_string().into()).await;
        asked.map_err(|error| error.to_string())?;
        self.wanted = PULLED_AT_ONCE;
        Ok(())
    }

    fn take(&mut self, message: Message) -> Result<Option<Read>, String> {
        match message.status.map(|status| status.as_u16()) {
            // The hub is there.
            Some(100) => return Ok(None),
            // What was asked for is over: there is no more, or time or bytes are used up.
            Some(404 | 408) => {
                self.wanted = 0;
                return Ok(None);
            }
            Some(409) if message.description.as_deref().is_some_and(is_complete) => {
                self.wanted = 0;
                return Ok(None);
            }
            Some(status) => {
                let why: String = message.description.unwrap_or_default().chars().take(100).collect();
                return Err(format!("the hub gives no more of {} ({status} {why})", self.stream.name()));
            }
            None => {}
        }
        self.wanted = self.wanted.saturating_sub(1);
        let Some((sequence, stored_ns)) = message.reply.as_deref().and_then(place) else { return Ok(None) };
        let Some(id) = vehicle_of(self.stream, &message.subject) else { return Ok(None) };
        let stored_ms = i64::try_from(stored_ns / 1_000_000).unwrap_or(i64::MAX);
        let age = u64::try_from(self.began_ms.saturating_sub(stored_ms)).unwrap_or(0);
        let age = Span::from_millis(age);
        Ok(Some(Read { stream: self.stream, id, packed: message.payload, sequence, stored_ms, age }))
    }
}

/// Whether nothing is wrong: all that was asked for came, or its bytes.
fn is_complete(description: &str) -> bool {
    ["MaxBytes", "Batch Completed"].iter().any(|it| description.contains(it))
}

/// Questions about what lies at the hub.
#[derive(Debug, Clone)]
pub struct Logs {
    client: Client,
    /// The line, where it is there for these questions alone.
    gate: Option<Arc<Gate>>,
}

/// A message of a log.
#[derive(Debug)]
pub struct Found {
    /// Its number in the stream of all logs.
    pub number: u64,
    /// When the hub took it, by its clock, in milliseconds since 1970, if it says so.
    pub stored_ms: Option<i64>,
    pub packed: Bytes,
}

/// Where the next message of a log is looked for.
#[derive(Debug, Clone, Copy)]
pub enum From {
    /// Taken by the hub at this time or later, in milliseconds since 1970.
    Time(i64),
    /// After the message with this number.
    After(u64),
}

impl Logs {
    /// A line for questions alone.
    ///
    /// # Errors
    /// The hub is not reached, does not let this identity read logs, or has none.
    pub async fn open(hub: &Hub, console: &Identity) -> Result<Logs, NoLine> {
        let (refuse, mut refused) = watch::channel(false);
        let options = options(console).event_callback(move |event| {
            if matches!(event, Event::ServerError(ServerError::Other(why)) if is_refusal(&why)) {
                refuse.send_replace(true);
            }
            std::future::ready(())
        });
        let (client, gate) = connection::open(hub, Pace::Any, options).await?;
        // A key of a vehicle is admitted, and may not ask.
        let has_logs = tokio::select! {
            Ok(_) = refused.wait_for(|is_refused| *is_refused) => return Err(NoLine::Refused),
            asked = has(&client, LOG_STREAM) => asked,
        };
        match has_logs {
            Ok(true) => Ok(Logs { client, gate: Some(Arc::new(gate)) }),
            Ok(false) => {
                Err(NoLine::Unreachable("it has no logs: `telltale fleet streams` makes them".into()))
            }
            Err(error) => Err(NoLine::Unreachable(error.to_string())),
        }
    }

    /// The next message of a vehicle's log; `None` at the end.
    ///
    /// # Errors
    /// The hub does not answer.
    pub async fn next(&self, id: &VehicleId, from: From) -> Result<Option<Found>, String> {
        let subject = Subjects::of(id).log;
        let wanted = match from {
            From::Time(ms) => {
                let at = humantime::format_rfc3339_millis(of_unix_ms(ms)).to_string();
                serde_json::json!({ "start_time": at, "next_by_subj": subject })
            }
            From::After(number) => {
                serde_json::json!({ "seq": number.saturating_add(1), "next_by_subj": subject })
            }
        };
        self.get(&wanted).await
    }

    /// The last message of a vehicle's log; `None` if there is no log of it.
    ///
    /// # Errors
    /// The hub does not answer.
    pub async fn last(&self, id: &VehicleId) -> Result<Option<Found>, String> {
        self.get(&serde_json::json!({ "last_by_subj": Subjects::of(id).log })).await
    }

    /// Somebody looks at a vehicle: asks it to tell each change at once for a minute.
    ///
    /// # Errors
    /// The line is over.
    pub async fn look(&self, id: &VehicleId) -> Result<(), String> {
        let wanted = serde_json::json!({ "live_s": LIVE_FOR_MAX.as_millis() / 1000 }).to_string();
        let told = self.client.publish(Subjects::of(id).want, wanted.into()).await;
        told.map_err(|error| error.to_string())
    }

    /// The pieces of recordings, on the same line.
    pub fn pieces(&self) -> Pieces {
        Pieces::over(self.client.clone(), self.gate.clone())
    }

    async fn get(&self, wanted: &serde_json::Value) -> Result<Option<Found>, String> {
        let asked =
            self.client.request(format!("$JS.API.DIRECT.GET.{LOG_STREAM}"), wanted.to_string().into());
        let found = asked.await.map_err(|error| error.to_string())?;
        match found.status.map(|status| status.as_u16()) {
            Some(404) => return Ok(None),
            Some(status) => return Err(format!("status {status}")),
            None => {}
        }
        let number = said_of(&found, "Nats-Sequence").and_then(|it| it.parse().ok());
        let number = number.ok_or("an answer without a number")?;
        let stored = said_of(&found, "Nats-Time-Stamp").and_then(|it| humantime::parse_rfc3339(it).ok());
        Ok(Some(Found { number, stored_ms: stored.map(unix_ms), packed: found.payload }))
    }
}

fn options(console: &Identity) -> ConnectOptions {
    connection::options(console, "console")
        .request_timeout(Some(ANSWERED_WITHIN))
        .ping_interval(Duration::from_secs(2))
}

fn is_refusal(why: &str) -> bool {
    why.to_ascii_lowercase().contains("permissions violation")
}

fn nanos(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

/// The vehicle of a subject.
fn vehicle_of(stream: Stream, subject: &str) -> Option<VehicleId> {
    let end = match stream {
        Stream::Head => ".head",
        Stream::Log => ".log",
    };
    VehicleId::new(subject.strip_prefix("tt.1.")?.strip_suffix(end)?)
}

/// The number of a message in its stream and the time of the hub in nanoseconds, from the subject of its
/// acknowledgement: `$JS.ACK.STREAM.READER.TIMES.NUMBER.COUNT.TIME.LEFT`, with two more parts after `ACK` from some hubs.
fn place(reply: &str) -> Option<(u64, u64)> {
    let parts: Vec<&str> = reply.split('.').collect();
    let first = match parts.len() {
        9 => 2,
        11.. => 4,
        _ => return None,
    };
    (parts[..2] == ["$JS", "ACK"]).then_some(())?;
    Some((parts[first + 3].parse().ok()?, parts[first + 5].parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_place_of_a_message_is_in_the_subject_of_its_acknowledgement() {
        assert_eq!(
            place("$JS.ACK.LOG.c1.1.77.3.1795000000000000000.0"),
            Some((77, 1_795_000_000_000_000_000))
        );
        assert_eq!(
            place("$JS.ACK._.hash.LOG.c1.1.77.3.1795000000000000000.0.rnd"),
            Some((77, 1_795_000_000_000_000_000))
        );
        for none in ["", "$JS.ACK.LOG", "_INBOX.a.b.c.d.e.f.g.h", "$JS.ACK.LOG.c1.1.x.3.1.0"] {
            assert_eq!(place(none), None, "{none}");
        }
    }

    #[test]
    fn a_subject_names_a_vehicle() {
        let id = |stream, subject| vehicle_of(stream, subject).map(|id| id.as_str().to_owned());
        assert_eq!(id(Stream::Head, "tt.1.shuttle-03.head").as_deref(), Some("shuttle-03"));
        for none in ["tt.1.a.log", "tt.1..head", "tt.1.a.b.head", "tt.2.a.head", "a.head"] {
            assert_eq!(id(Stream::Head, none), None, "{none}");
        }
    }
}
