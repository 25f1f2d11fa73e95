//! The line to the hub: NATS over TLS. Requests of JetStream are plain requests here, so that each answer is read with
//! bounds: the hub may be anybody who took it over.

use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use async_nats::{Client, HeaderMap, RequestErrorKind, Subscriber};
use bytes::Bytes;
use futures_util::StreamExt as _;
use serde::Deserialize;
use telltale_engine::time::Span;

use crate::connection::{self, said_of};
use crate::delivery::Answer;
use crate::gate::{Gate, Pace};
use crate::identity::Identity;
use crate::message::{BATCH_BYTES_MAX, VehicleId};

/// The stream of all logs.
pub const LOG_STREAM: &str = "LOG";

/// A request for live data counts for this long at most.
pub const LIVE_FOR_MAX: Span = Span::from_secs(60);

/// Recordings that one wish may ask for.
pub const WANTED_AT_ONCE: usize = 16;

/// Bytes of an answer, or of a wish, that are read.
const ANSWER_BYTES_MAX: usize = 4096;

/// A slow line takes this long for the largest batch at 100 kbit/s.
const ANSWERED_WITHIN: Duration = Duration::from_secs(25);

/// After two of these without an answer the line is given up.
const PING_EVERY: Duration = Duration::from_secs(10);

/// The codes of JetStream for another last message than the expected one.
const WRONG_LAST: [u64; 2] = [10_071, 10_164];

/// The subjects of a vehicle.
#[derive(Debug, Clone)]
pub struct Subjects {
    pub head: String,
    pub log: String,
    pub live: String,
    pub want: String,
    /// The beginning of those of pieces.
    pub inc: String,
}

impl Subjects {
    pub fn of(id: &VehicleId) -> Subjects {
        Subjects::with(id.as_str())
    }

    /// The subjects of a vehicle, or with `*` of all vehicles.
    pub(crate) fn with(id: &str) -> Subjects {
        let subject = |end: &str| format!("tt.1.{id}.{end}");
        Subjects {
            head: subject("head"),
            log: subject("log"),
            live: subject("live"),
            want: subject("want"),
            inc: subject("inc"),
        }
    }

    /// Of a piece of a recording; `*` for all pieces.
    pub fn piece(&self, sha256: &str, number: impl fmt::Display) -> String {
        format!("{}.{sha256}.{number}", self.inc)
    }

    /// Where the last message of the log is asked for.
    pub fn own_last(&self) -> String {
        format!("$JS.API.DIRECT.GET.{LOG_STREAM}.{}", self.log)
    }
}

/// The beginning of the subjects of answers to a vehicle, or to a console of this name.
pub fn inbox(name: &str) -> String {
    format!("_INBOX.{name}")
}

/// How the hub is reached.
#[derive(Debug, Clone)]
pub struct Hub {
    /// `tls://HOST:PORT`
    pub url: String,
    /// The certificates that sign the hub's certificate.
    pub ca: PathBuf,
}

/// Why there is no line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NoLine {
    /// The hub does not admit this identity.
    Refused,
    Unreachable(String),
}

impl fmt::Display for NoLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NoLine::Refused => f.write_str("the hub does not admit this identity"),
            NoLine::Unreachable(why) => f.write_str(why),
        }
    }
}

/// A wish from the hub: a span and numbers. This is all that anybody there can make a vehicle do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Want {
    /// Somebody looks at the vehicle: tell each change at once for this long.
    pub live: Option<Span>,
    /// The numbers of incidents with wanted recordings.
    pub incidents: Vec<u64>,
}

impl Want {
    /// Reads a wish; `None` if it is none.
    pub fn read(payload: &[u8]) -> Option<Want> {
        #[derive(Deserialize)]
        struct Wish {
            live_s: Option<u64>,
            #[serde(default)]
            incidents: Vec<u64>,
        }
        let payload = payload.get(..payload.len().min(ANSWER_BYTES_MAX + 1))?;
        let wish: Wish =
            (payload.len() <= ANSWER_BYTES_MAX).then(|| serde_json::from_slice(payload).ok())??;
        let live = wish.live_s.map(|it| Span::from_secs(it.min(LIVE_FOR_MAX.as_millis() / 1000)));
        let is_one = live.is_some() || !wish.incidents.is_empty();
        let is_small = wish.incidents.len() <= WANTED_AT_ONCE;
        (is_one && is_small).then_some(Want { live, incidents: wish.incidents })
    }
}

/// A message of the log as it lies at the hub.
#[derive(Debug)]
pub struct Stored {
    pub sequence: u64,
    pub packed: Bytes,
}

/// What the hub says of the last message of the log.
#[derive(Debug)]
pub enum OwnLast {
    Nothing,
    Stored(Stored),
    Unknown(Answer),
}

/// An open line. It ends with the first fault; then another is made.
#[derive(Debug)]
pub struct Line {
    client: Client,
    subjects: Subjects,
    wants: Subscriber,
    gate: Gate,
}

impl Line {
    /// # Errors
    /// The hub is not reached, is another one than the certificate says, or does not admit this vehicle.
    pub async fn open(hub: &Hub, id: &VehicleId, identity: &Identity) -> Result<Line, NoLine> {
        let options = connection::options(identity, id.as_str())
            .request_timeout(Some(ANSWERED_WITHIN))
            .ping_interval(PING_EVERY)
            .subscription_capacity(16);
        let (client, gate) = connection::open(hub, Pace::Slow, options).await?;
        let subjects = Subjects::of(id);
        let wants = client
            .subscribe(subjects.want.clone())
            .await
            .map_err(|error| NoLine::Unreachable(error.to_string()))?;
        Ok(Line { client, subjects, wants, gate })
    }

    /// A handle for requests, which may outlive the line.
    pub fn requests(&self) -> Requests {
        Requests { client: self.client.clone(), subjects: self.subjects.clone() }
    }

    /// The next wish; `None` for a message that is none.
    ///
    /// # Errors
    /// Why the line is over.
    pub async fn next(&mut self) -> Result<Option<Want>, String> {
        tokio::select! {
            why = self.gate.ended() => Err(why),
            message = self.wants.next() => Ok(Want::read(&message.ok_or("the line was cut")?.payload)),
        }
    }
}

/// What a vehicle asks of the hub.
#[derive(Debug, Clone)]
pub struct Requests {
    client: Client,
    subjects: Subjects,
}

impl Requests {
    /// Tells the head, which replaces the one before.
    pub async fn head(&self, packed: Vec<u8>) {
        // On a line that is cut nothing arrives: another head follows on the next.
        let _ = self.client.publish(self.subjects.head.clone(), packed.into()).await;
    }

    /// Tells those who look.
    pub async fn live(&self, packed: Vec<u8>) {
        let _ = self.client.publish(self.subjects.live.clone(), packed.into()).await;
    }

    /// Appends a batch to the log, if the last message there has this number.
    pub async fn log(&self, after: u64, packed: Vec<u8>) -> Answer {
        self.append(self.subjects.log.clone(), after, packed).await
    }

    /// Stores a piece of a recording. [`Answer::WrongLast`]: it is there already.
    pub async fn piece(&self, sha256: &str, number: u64, piece: Vec<u8>) -> Answer {
        self.append(self.subjects.piece(sha256, number), 0, piece).await
    }

    async fn append(&self, subject: String, after: u64, payload: Vec<u8>) -> Answer {
        let mut headers = HeaderMap::new();
        headers.insert("Nats-Expected-Last-Subject-Sequence", after.to_string().as_str());
        let sent = self.client.request_with_headers(subject, headers, payload.into());
        match sent.await {
            Ok(answer) => stored(&answer.payload),
            Err(error) if error.kind() == RequestErrorKind::NoResponders => Answer::Refused,
            Err(_) => Answer::Silence,
        }
    }

    /// Reads the last message of the log.
    pub async fn own_last(&self) -> OwnLast {
        let answer = match self.client.request(self.subjects.own_last(), Bytes::new()).await {
            Ok(answer) => answer,
            Err(error) if error.kind() == RequestErrorKind::NoResponders => {
                return OwnLast::Unknown(Answer::Refused);
            }
            Err(_) => return OwnLast::Unknown(Answer::Silence),
        };
        if answer.status.is_some_and(|status| status.as_u16() == 404) {
            return OwnLast::Nothing;
        }
        match said_of(&answer, "Nats-Sequence").and_then(|it| it.parse().ok()) {
            Some(sequence) if answer.payload.len() <= BATCH_BYTES_MAX => {
                OwnLast::Stored(Stored { sequence, packed: answer.payload })
            }
            // A message that this program never made; what follows goes after it.
            Some(sequence) => OwnLast::Stored(Stored { sequence, packed: Bytes::new() }),
            None => OwnLast::Unknown(Answer::Refused),
        }
    }

    /// Waits until everything has left this program.
    pub async fn flush(&self) {
        let _ = self.client.flush().await;
    }
}

/// The answer of JetStream to a message.
fn stored(payload: &[u8]) -> Answer {
    #[derive(Deserialize)]
    struct Ack {
        seq: Option<u64>,
        error: Option<Fault>,
    }
    #[derive(Deserialize)]
    struct Fault {
        err_code: Option<u64>,
    }
    if payload.len() > ANSWER_BYTES_MAX {
        return Answer::Refused;
    }
    match serde_json::from_slice(payload) {
        Ok(Ack { error: Some(fault), .. }) if fault.err_code.is_some_and(|it| WRONG_LAST.contains(&it)) => {
            Answer::WrongLast
        }
        Ok(Ack { error: None, seq: Some(number) }) => Answer::Stored(number),
        _ => Answer::Refused,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wish_is_for_live_data_of_a_minute_at_most_and_for_few_recordings() {
        let want = |live, incidents: &[u64]| Some(Want { live, incidents: incidents.to_vec() });
        assert_eq!(Want::read(br#"{"live_s":10,"stop":true}"#), want(Some(Span::from_secs(10)), &[]));
        assert_eq!(Want::read(br#"{"live_s":86400}"#), want(Some(LIVE_FOR_MAX), &[]));
        assert_eq!(Want::read(br#"{"incidents":[12,13]}"#), want(None, &[12, 13]));
        for none in [
            &br#"{"stop":true}"#[..],
            b"",
            b"live",
            br#"{"live_s":-1}"#,
            br#"{"live_s":"9"}"#,
            br#"{"incidents":[]}"#,
            br#"{"incidents":["../12"]}"#,
            br#"{"incidents":[-1]}"#,
            br#"{"incidents":[1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17]}"#,
        ] {
            assert_eq!(Want::read(none), None, "{}", String::from_utf8_lossy(none));
        }
        let long = format!(r#"{{"live_s":1}}{}"#, " ".repeat(ANSWER_BYTES_MAX));
        assert_eq!(Want::read(long.as_bytes()), None);
    }

    #[test]
    fn an_answer_of_the_hub_is_read_with_care() {
        for (answer, meant) in [
            (r#"{"stream":"LOG","seq":7}"#, Answer::Stored(7)),
            (
                r#"{"error":{"code":400,"err_code":10071,"description":"wrong last sequence: 5"}}"#,
                Answer::WrongLast,
            ),
            (r#"{"error":{"code":400,"err_code":10164}}"#, Answer::WrongLast),
            (r#"{"error":{"code":503,"err_code":10077},"seq":0}"#, Answer::Refused),
            (r#"{"seq":-7}"#, Answer::Refused),
            ("", Answer::Refused),
        ] {
            assert_eq!(stored(answer.as_bytes()), meant, "{answer}");
        }
        assert_eq!(stored(&[b' '; ANSWER_BYTES_MAX + 1]), Answer::Refused);
    }
}
