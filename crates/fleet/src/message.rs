//! What a vehicle tells: the messages of a log, packed in batches. A batch is zstd over lines of JSON: a head that
//! names the vehicle, then the messages in their order. Everything that comes from the hub is hostile and read with bounds.

use std::fmt;
use std::io::Read as _;

use serde::{Deserialize, Serialize};
use telltale_engine::model::Stage;
use telltale_engine::state::State;

/// The format. Within it there are only additions: unknown keys and kinds are no errors.
pub const FORMAT: u32 = 1;

/// Bytes of a packed batch.
pub const BATCH_BYTES_MAX: usize = 256 * 1024;

/// Bytes to which a batch may unpack.
pub const UNPACKED_BYTES_MAX: usize = 4 << 20;

/// Messages of a batch.
pub const BATCH_MESSAGES_MAX: usize = 4096;

/// Bytes of one packed message; the rest of a batch is for its head.
pub const MESSAGE_BYTES_MAX: usize = 240 * 1024;

/// Bytes of a piece of a recording.
pub const PIECE_BYTES: usize = 64 * 1024;

/// Bytes of a recording that is sent to a fleet. A hub has 2.5 GB for pieces by default.
pub const RECORDING_BYTES_MAX: u64 = 1 << 30;

/// Characters of the name of a vehicle in subjects.
pub const ID_CHARS_MAX: usize = 64;

/// No vehicle makes so many messages in one run.
const PLACE_MAX: u64 = 1 << 53;

/// Times outside of 2020 to 2100 are wrong, in milliseconds since 1970.
const TIMES_MS: std::ops::Range<i64> = 1_577_836_800_000..4_102_444_800_000;

/// A batch that asks for more memory than 2^this bytes is refused.
const WINDOW_LOG_MAX: u32 = 22;

/// Fast, and of a batch of small messages not much larger than the slow levels.
const ZSTD_LEVEL: i32 = 3;

/// The name of a vehicle in subjects: `[a-z0-9_-]{1,64}`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VehicleId(String);

impl VehicleId {
    /// `None` if a subject cannot hold it.
    pub fn new(text: &str) -> Option<VehicleId> {
        let is_plain = |it: u8| it.is_ascii_lowercase() || it.is_ascii_digit() || it == b'_' || it == b'-';
        let fits = (1..=ID_CHARS_MAX).contains(&text.len()) && text.bytes().all(is_plain);
        fits.then(|| VehicleId(text.to_owned()))
    }

    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for VehicleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// One run of a vehicle's program. Later runs are larger, and the random part tells two vehicles with one identity apart.
/// As text 16 hexadecimal digits, which sort as the epochs do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Epoch {
    pub start: u32,
    pub nonce: u32,
}

impl fmt::Display for Epoch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:08x}{:08x}", self.start, self.nonce)
    }
}

impl From<Epoch> for String {
    fn from(epoch: Epoch) -> String {
        epoch.to_string()
    }
}

impl TryFrom<String> for Epoch {
    type Error = String;

    fn try_from(text: String) -> Result<Epoch, String> {
        let is_hex = text.len() == 16 && text.bytes().all(|it| matches!(it, b'0'..=b'9' | b'a'..=b'f'));
        let part = |digits: &str| u32::from_str_radix(digits, 16).ok();
        match (is_hex.then(|| part(&text[..8])).flatten(), is_hex.then(|| part(&text[8..])).flatten()) {
            (Some(start), Some(nonce)) => Ok(Epoch { start, nonce }),
            _ => Err("an epoch has 16 hexadecimal digits".into()),
        }
    }
}

/// The place of a message in a vehicle's log. Messages are ordered by it, and never by a clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Mark {
    pub epoch: Epoch,
    pub n: u64,
}

/// One message of a vehicle's log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Message {
    pub epoch: Epoch,
    /// Counts from 1 in each epoch.
    pub n: u64,
    /// By the vehicle's wall clock, in milliseconds since 1970.
    pub at: i64,
    #[serde(flatten)]
    pub content: Content,
}

impl Message {
    pub fn mark(&self) -> Mark {
        Mark { epoch: self.epoch, n: self.n }
    }

    /// The last place that it stands for: a gap stands for many.
    pub fn end(&self) -> Mark {
        match self.content {
            Content::Gap(Gap { to, .. }) => Mark { epoch: self.epoch, n: to },
            _ => self.mark(),
        }
    }
}

/// What a message tells.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Content {
    /// The vehicle in one line. It is on a subject of its own and has no place in the log.
    Head(Head),
    /// The states of all nodes.
    Keyframe(NodeStates),
    /// The nodes that show something else than in the messages before.
    Delta(NodeStates),
    Alarm(Alarm),
    /// The end of the vehicle's audit log, so that a vehicle that rewrites its past is found.
    AuditHead(AuditHead),
    Incident(Incident),
    Recording(Recording),
    /// Messages that are not known any more.
    Gap(Gap),
    /// The program ended as it was asked to.
    Goodbye,
    /// A kind of a later version.
    #[serde(other)]
    Unknown,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Head {
    pub name: String,
    pub state: State,
    /// Its first root cause, or its first WARNING.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<Cause>,
    /// Since when it shows this state, in milliseconds since 1970.
    pub since: i64,
    pub stage: Stage,
    /// It drives, or may at any moment. A machine without stages is always active and never drives.
    #[serde(default)]
    pub drives: bool,
    /// `None` if the speed is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_kmh: Option<u32>,
    /// Alarms that nobody acknowledged.
    pub unacknowledged: u32,
    pub version: String,
    /// SHA-256 of the configuration's files, in hexadecimal digits.
    pub config: String,
    /// The last message of the log when this was made; 0 if there is none.
    pub last: u64,
    /// The program is about to end as it was asked to.
    #[serde(default)]
    pub ending: bool,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cause {
    pub node: String,
    pub words: String,
}

/// The stage, and the states of all nodes or of the changed ones.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct NodeStates {
    pub stage: Stage,
    pub nodes: Vec<Node>,
}

/// A node with what it shows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Node {
    pub node: String,
    pub state: State,
    /// As if nothing were masked.
    pub own: State,
    /// The root cause that masks it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// What it says, if it is not OK.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub words: String,
    /// It left: it is shown no more.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub gone: bool,
}

/// The present state of an alarm.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Alarm {
    pub number: u64,
    pub node: String,
    pub active: bool,
    pub acknowledged: bool,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub words: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AuditHead {
    /// The number of the last record.
    pub record: u64,
    /// Its hash, in hexadecimal digits.
    pub hash: String,
}

/// The summary of an incident.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Incident {
    pub number: u64,
    /// In milliseconds since 1970.
    pub since: i64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<i64>,
    pub stage: String,
    pub causes: Vec<String>,
    pub triggers: u64,
    pub version: String,
    pub config: String,
    /// Of its recording.
    pub bytes: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
}

/// The recording of an incident comes in pieces after this, or why it does not come.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Recording {
    pub incident: u64,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub pieces: Option<Pieces>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<NotSent>,
}

/// A file in pieces.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pieces {
    /// Of the file, in hexadecimal digits.
    pub sha256: String,
    pub bytes: u64,
    /// How many there are. All but the last have [`PIECE_BYTES`].
    pub pieces: u64,
}

impl Pieces {
    /// `None` if it has no hash, no bytes, or more than any recording has.
    pub fn of(sha256: &str, bytes: u64) -> Option<Pieces> {
        let is_hash = sha256.len() == 64 && sha256.bytes().all(|it| matches!(it, b'0'..=b'9' | b'a'..=b'f'));
        let fits = (1..=RECORDING_BYTES_MAX).contains(&bytes);
        let pieces = bytes.div_ceil(PIECE_BYTES as u64);
        (is_hash && fits).then(|| Pieces { sha256: sha256.to_owned(), bytes, pieces })
    }

    /// The bytes of the piece with this number; the first is 0, and beyond the last one there are none.
    pub fn len_of(&self, number: u64) -> usize {
        let before = number.saturating_mul(PIECE_BYTES as u64);
        usize::try_from(self.bytes.saturating_sub(before)).unwrap_or(usize::MAX).min(PIECE_BYTES)
    }
}

/// Why a recording is not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NotSent {
    /// The configuration says so.
    Never,
    /// There is no such incident, or its recording was removed.
    Gone,
    /// It is still written.
    NotFinished,
    TooLarge,
    /// A word of a later version.
    #[serde(other)]
    Unknown,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Gap {
    /// The last message that is missing; the first is that of the gap.
    pub to: u64,
    pub why: GapReason,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GapReason {
    /// The vehicle had no room for more.
    Overflow,
    /// It waited for the hub for too long.
    TooOld,
    /// The hub lost what the vehicle did not have any more.
    Lost,
    /// The vehicle's disk did not take it.
    Disk,
    /// The message was larger than a batch.
    TooLarge,
    /// A word of a later version.
    #[serde(other)]
    Unknown,
}

/// Messages of one vehicle, as they go to the hub.
#[derive(Debug, Clone, PartialEq)]
pub struct Batch {
    pub id: VehicleId,
    /// The vehicle's public key.
    pub key: String,
    /// By the vehicle's wall clock, in milliseconds since 1970.
    pub sent: i64,
    pub messages: Vec<Message>,
}

/// The first line of a batch.
#[derive(Debug, Serialize, Deserialize)]
struct First {
    v: u32,
    id: String,
    key: String,
    sent: i64,
}

/// Why a batch is not taken.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Malformed {
    #[error("it has {0} bytes, and at most {BATCH_BYTES_MAX} are read")]
    TooLarge(usize),
    #[error("it unpacks to more than {UNPACKED_BYTES_MAX} bytes")]
    TooLargeUnpacked,
    #[error("it is not packed with zstd")]
    NotPacked,
    #[error("line {0} of it is no message")]
    NoMessage(usize),
    #[error("it has format {0}, and this program reads format {FORMAT}")]
    Format(u32),
    #[error("it is of another vehicle")]
    ForeignId,
    #[error("one of its times is not between 2020 and 2100")]
    Time,
    #[error("it has no messages")]
    Empty,
    #[error("it has more than {BATCH_MESSAGES_MAX} messages")]
    TooMany,
    #[error("its messages are not in their order")]
    Order,
    #[error("it comes after more than this vehicle may tell in this time, and was not read")]
    TooMuch,
    #[error("the recording of its incident {0}: {1}")]
    Recording(u64, &'static str),
}

impl Batch {
    /// The place of its last message.
    pub fn end(&self) -> Option<Mark> {
        self.messages.last().map(Message::end)
    }

    /// Packs a batch of messages that are JSON already, each without a line break. `None` if it is too large.
    pub fn pack(id: &VehicleId, key: &str, sent: i64, messages: &[&str]) -> Option<Vec<u8>> {
        let first = First { v: FORMAT, id: id.0.clone(), key: key.to_owned(), sent };
        let mut lines = serde_json::to_string(&first).expect("texts and numbers are JSON");
        for message in messages {
            lines.push('\n');
            lines.push_str(message);
        }
        if lines.len() > UNPACKED_BYTES_MAX || messages.len() > BATCH_MESSAGES_MAX {
            return None;
        }
        packed(lines.as_bytes()).filter(|packed| packed.len() <= BATCH_BYTES_MAX)
    }

    /// Reads what [`pack`](Self::pack) made, or what anybody sent on the subject of the vehicle `id`.
    ///
    /// # Errors
    /// Any byte of it is not as it should be.
    pub fn unpack(bytes: &[u8], id: &VehicleId) -> Result<Batch, Malformed> {
        Batch::read(&unpacked(bytes)?, id)
    }

    /// The same, with the bytes that it unpacked to. One that does not unpack counts as the largest.
    pub fn weigh(bytes: &[u8], id: &VehicleId) -> (usize, Result<Batch, Malformed>) {
        match unpacked(bytes) {
            Ok(text) => (text.len(), Batch::read(&text, id)),
            Err(malformed) => (UNPACKED_BYTES_MAX, Err(malformed)),
        }
    }

    fn read(text: &str, id: &VehicleId) -> Result<Batch, Malformed> {
        let mut lines = text.split('\n');
        let first: First = line(lines.next().unwrap_or_default(), 1)?;
        if first.v != FORMAT {
            return Err(Malformed::Format(first.v));
        }
        if first.id != id.0 {
            return Err(Malformed::ForeignId);
        }
        let mut messages: Vec<Message> = Vec::new();
        for (text, number) in lines.zip(2..) {
            if messages.len() == BATCH_MESSAGES_MAX {
                return Err(Malformed::TooMany);
            }
            let message: Message = line(text, number)?;
            let is_possible = (1..=PLACE_MAX).contains(&message.n)
                && !matches!(message.content, Content::Gap(Gap { to, .. }) if !(message.n..=PLACE_MAX).contains(&to));
            if !is_possible || messages.last().is_some_and(|last| last.end() >= message.mark()) {
                return Err(Malformed::Order);
            }
            messages.push(message);
        }
        let times = messages.iter().map(|it| it.at).chain([first.sent]);
        if !times.into_iter().all(|time| TIMES_MS.contains(&time)) {
            return Err(Malformed::Time);
        }
        if messages.is_empty() {
            return Err(Malformed::Empty);
        }
        Ok(Batch { id: id.clone(), key: first.key, sent: first.sent, messages })
    }
}

/// A time as a message may have it: of a clock out of all bounds, the nearest possible time.
pub fn possible_ms(ms: i64) -> i64 {
    ms.clamp(TIMES_MS.start, TIMES_MS.end - 1)
}

/// The number of bytes that a message takes alone.
pub fn packed_len(message: &str) -> Option<usize> {
    packed(message.as_bytes()).map(|it| it.len())
}

fn packed(bytes: &[u8]) -> Option<Vec<u8>> {
    zstd::bulk::compress(bytes, ZSTD_LEVEL).ok()
}

fn unpacked(bytes: &[u8]) -> Result<String, Malformed> {
    if bytes.len() > BATCH_BYTES_MAX {
        return Err(Malformed::TooLarge(bytes.len()));
    }
    let mut reader = zstd::stream::read::Decoder::with_buffer(bytes).map_err(|_| Malformed::NotPacked)?;
    reader.window_log_max(WINDOW_LOG_MAX).map_err(|_| Malformed::NotPacked)?;
    let mut text = Vec::new();
    let taken = reader.take(UNPACKED_BYTES_MAX as u64 + 1).read_to_end(&mut text);
    taken.map_err(|_| Malformed::NotPacked)?;
    if text.len() > UNPACKED_BYTES_MAX {
        return Err(Malformed::TooLargeUnpacked);
    }
    String::from_utf8(text).map_err(|_| Malformed::NoMessage(1))
}

fn line<'a, T: Deserialize<'a>>(text: &'a str, number: usize) -> Result<T, Malformed> {
    serde_json::from_str(text).map_err(|_| Malformed::NoMessage(number))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id() -> VehicleId {
        VehicleId::new("shuttle-03").expect("it is plain")
    }

    const SENT: i64 = 1_780_000_000_000;

    fn of_lines(lines: &str) -> Result<Batch, Malformed> {
        Batch::unpack(&packed(lines.as_bytes()).expect("it is small"), &id())
    }

    const FIRST: &str = r#"{"v":1,"id":"shuttle-03","key":"UA","sent":1780000000000,"later":true}"#;

    fn message(n: u64, content: Content) -> Message {
        Message { epoch: Epoch { start: 7, nonce: 9 }, n, at: SENT, content }
    }

    #[test]
    fn a_batch_is_read_as_it_was_packed() {
        let nodes = vec![Node {
            node: "lidar/front".into(),
            state: State::Ignore,
            own: State::Error,
            cause: Some("power/bus".into()),
            words: "no data\nfor 3 s".into(),
            gone: false,
        }];
        let messages = vec![
            message(1, Content::Keyframe(NodeStates { stage: Stage::Active, nodes: nodes.clone() })),
            message(2, Content::Gap(Gap { to: 5, why: GapReason::Overflow })),
            message(6, Content::Goodbye),
        ];
        let json: Vec<String> =
            messages.iter().map(|it| serde_json::to_string(it).expect("it is JSON")).collect();
        let json: Vec<&str> = json.iter().map(String::as_str).collect();
        let packed = Batch::pack(&id(), "UA", SENT, &json).expect("it is small");
        let batch = Batch::unpack(&packed, &id()).expect("it is well-formed");
        assert_eq!(batch, Batch { id: id(), key: "UA".into(), sent: SENT, messages });
    }

    #[test]
    fn what_a_later_version_adds_is_no_error() {
        let line = r#"{"epoch":"0000000700000009","n":3,"at":1780000000000,"kind":"weather","rain":[1]}"#;
        let batch = of_lines(&format!("{FIRST}\n{line}")).expect("additions are read over");
        assert_eq!(batch.messages, [message(3, Content::Unknown)]);
    }

    #[test]
    fn what_is_hostile_is_refused_with_its_reason() {
        let line =
            |n: u64| format!(r#"{{"epoch":"0000000700000009","n":{n},"at":1780000000000,"kind":"goodbye"}}"#);
        let with_first =
            |from: &str, to: &str| of_lines(&format!("{}\n{}", FIRST.replace(from, to), line(1)));
        assert_eq!(with_first("\"v\":1", "\"v\":2"), Err(Malformed::Format(2)));
        assert_eq!(with_first("shuttle-03", "shuttle-04"), Err(Malformed::ForeignId));
        assert_eq!(with_first("1780000000000", "17"), Err(Malformed::Time));
        assert_eq!(with_first("\"sent\"", "\"set\""), Err(Malformed::NoMessage(1)));
        assert_eq!(of_lines(FIRST), Err(Malformed::Empty));
        assert_eq!(of_lines(&format!("{FIRST}\n{}\n{}", line(2), line(2))), Err(Malformed::Order));
        assert_eq!(of_lines(&format!("{FIRST}\n{}", line(0))), Err(Malformed::Order));
        let gap = line(5).replace("goodbye\"", "gap\",\"to\":4,\"why\":\"lost\"");
        assert_eq!(of_lines(&format!("{FIRST}\n{gap}")), Err(Malformed::Order));
        let at = line(1).replace("1780000000000", "9999999999999");
        assert_eq!(of_lines(&format!("{FIRST}\n{at}")), Err(Malformed::Time));
        let epoch = line(1).replace("0000000700000009", "+00000070000000é");
        assert_eq!(of_lines(&format!("{FIRST}\n{epoch}")), Err(Malformed::NoMessage(2)));
        assert_eq!(of_lines(&format!("{FIRST}\n{}", "[".repeat(100_000))), Err(Malformed::NoMessage(2)));
        let many: String = (1..=BATCH_MESSAGES_MAX as u64 + 1).map(|n| format!("\n{}", line(n))).collect();
        assert_eq!(of_lines(&format!("{FIRST}{many}")), Err(Malformed::TooMany));
        assert_eq!(of_lines(&" ".repeat(UNPACKED_BYTES_MAX + 1)), Err(Malformed::TooLargeUnpacked));
        assert_eq!(Batch::unpack(b"{}", &id()), Err(Malformed::NotPacked));
        let large = BATCH_BYTES_MAX + 1;
        assert_eq!(Batch::unpack(&vec![0; large], &id()), Err(Malformed::TooLarge(large)));
    }

    #[test]
    fn an_id_is_what_a_subject_can_hold() {
        let most = "a".repeat(ID_CHARS_MAX);
        for good in ["shuttle-03", "a", "_", most.as_str()] {
            assert!(VehicleId::new(good).is_some(), "{good}");
        }
        for bad in ["", "Shuttle", "a.b", "a*", ">", "ä", "a b", &format!("{most}a")] {
            assert!(VehicleId::new(bad).is_none(), "{bad}");
        }
    }
}
