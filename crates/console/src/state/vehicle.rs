//! One vehicle as the console knows it: its last head, its picture, its incidents, and the faults of its messages.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use telltale_engine::time::{Since, Span, Timestamp};
use telltale_fleet::message::{
    Batch, Cause, Content, Epoch, Head, Incident, Malformed, Mark, Message, VehicleId, possible_ms,
};
use telltale_web::texts::{ID, MESSAGE, NAME, VALUE, clean};

use super::contact::LATE_AFTER;
use super::incidents::{INCIDENTS_MAX, cleaned};
use super::picture::Picture;
use super::recordings::Transfer;

/// Two vehicles with one name are shown for this long after both were heard.
const TWO_FOR: Span = Span::from_secs(600);

/// A vehicle's clock that is wrong by less is not worth a word.
const SKEW_MIN_MS: u64 = 5000;

#[derive(Debug)]
pub struct Vehicle {
    pub id: VehicleId,
    /// `None` if it was never heard.
    pub head: Option<Heard>,
    pub picture: Picture,
    pub incidents: BTreeMap<u64, Incident>,
    /// Of these incidents.
    pub recordings: BTreeMap<u64, Transfer>,
    /// The key of the last batch of its log.
    log_key: String,
    /// The last place before which it said goodbye.
    goodbye: Option<Mark>,
    /// When two were heard by this name.
    two_at: Option<Timestamp>,
    /// How many of its messages were not taken, and why the last one was not.
    pub refused: Option<(u64, Malformed)>,
    /// The unpacked bytes of it that are read before others have their turn, and since when. Negative after a large one.
    allowance: (i64, Timestamp),
    /// When it was asked last to tell each change at once.
    looked_at: Option<Timestamp>,
}

/// A vehicle that somebody looks at is asked this often for live data. It tells them for a minute then.
const LOOK_AGAIN: Span = Span::from_secs(30);

/// Unpacked bytes of a vehicle that are read at once, and in each second after that. A batch that a fleet's vehicle
/// makes takes far less; small ones that unpack to much would keep the console from hearing the others.
const READ_AT_ONCE: i64 = 16 << 20;
const READ_IN_A_SECOND: i64 = 2 << 20;

/// A head, and when it came.
#[derive(Debug, Clone)]
pub struct Heard {
    pub head: Head,
    mark: Mark,
    key: String,
    pub at: Since,
    /// By how much the vehicle's clock is ahead of the hub's, in milliseconds.
    skew_ms: i64,
}

/// The record of a vehicle on the disk.
#[derive(Debug, Serialize, Deserialize)]
pub struct Kept {
    epoch: Epoch,
    n: u64,
    key: String,
    head: Head,
    has_left: bool,
    skew_ms: i64,
    /// By the console's wall clock.
    heard_ms: i64,
}

/// When a message was sent and taken.
#[derive(Debug, Clone, Copy)]
pub struct Times {
    /// Of the console.
    pub heard: Since,
    pub now: Timestamp,
    /// By the hub's clock, in milliseconds since 1970.
    pub stored_ms: i64,
}

impl Vehicle {
    pub fn new(id: VehicleId) -> Vehicle {
        Vehicle {
            id,
            head: None,
            picture: Picture::default(),
            incidents: BTreeMap::new(),
            recordings: BTreeMap::new(),
            log_key: String::new(),
            goodbye: None,
            two_at: None,
            refused: None,
            allowance: (READ_AT_ONCE, Timestamp::ZERO),
            looked_at: None,
        }
    }

    /// Somebody looks at it. Returns whether it must be asked for live data.
    pub fn look(&mut self, now: Timestamp) -> bool {
        let is_due = self.looked_at.is_none_or(|at| now.since(at) >= LOOK_AGAIN);
        if is_due {
            self.looked_at = Some(now);
        }
        is_due
    }

    fn allowed(&self, now: Timestamp) -> i64 {
        let (left, since) = self.allowance;
        let passed_ms = i64::try_from(now.since(since).as_millis()).unwrap_or(i64::MAX);
        left.saturating_add(passed_ms.saturating_mul(READ_IN_A_SECOND) / 1000).min(READ_AT_ONCE)
    }

    /// Whether more of it is read now.
    pub fn may_tell(&self, now: Timestamp) -> bool {
        self.allowed(now) > 0
    }

    pub fn has_told(&mut self, bytes: usize, now: Timestamp) {
        self.allowance = (self.allowed(now).saturating_sub_unsigned(bytes as u64), now);
    }

    /// Takes the one head of a batch from the stream of heads. Returns whether it is news.
    pub fn take_head(&mut self, batch: &Batch, times: Times) -> bool {
        let [Message { content: Content::Head(head), .. }] = &*batch.messages else { return false };
        let mark = batch.messages[0].mark();
        if let Some(known) = &self.head
            && known.key == batch.key
        {
            if mark.epoch < known.mark.epoch {
                // An older run that still tells: the newer one is another vehicle. The one that goes on is shown.
                self.two_at = Some(times.now);
                if known.at.age(times.now) <= LATE_AFTER {
                    return false;
                }
            } else if mark < known.mark {
                return false;
            }
        }
        if self.picture.end.is_some_and(|end| end.epoch != mark.epoch) {
            // The picture is of another run.
            self.picture.is_whole = false;
        }
        self.head = Some(Heard {
            head: bounded(head),
            mark,
            key: clean(&batch.key, 2 * VALUE),
            at: times.heard,
            skew_ms: batch.sent.saturating_sub(possible_ms(times.stored_ms)),
        });
        true
    }

    /// Takes the key of a batch of the log. With another one the vehicle was enrolled again, and its picture begins anew.
    pub fn take_key(&mut self, key: &str) {
        let key = clean(key, 2 * VALUE);
        if self.log_key != key {
            (self.picture, self.log_key) = (Picture::default(), key);
        }
    }

    /// Takes a message of the log. Returns the number of an incident that is new or changed.
    pub fn take(&mut self, message: &Message) -> Option<u64> {
        // After a clock that was ahead, or with a new outbox, the present run has a lower number than the last one.
        let is_present = self.head.as_ref().is_some_and(|heard| heard.mark.epoch == message.epoch);
        if is_present && self.picture.end.is_some_and(|end| message.epoch < end.epoch) {
            self.picture = Picture::default();
        }
        self.picture.take(message);
        match &message.content {
            Content::Goodbye => {
                self.goodbye = self.goodbye.max(Some(message.mark()));
                None
            }
            Content::Incident(incident) => {
                self.take_incident(incident);
                Some(incident.number)
            }
            _ => None,
        }
    }

    pub fn take_incident(&mut self, incident: &Incident) {
        self.incidents.insert(incident.number, cleaned(incident));
        while let Some(number) = self.surplus() {
            self.incidents.remove(&number);
            self.recordings.remove(&number);
        }
    }

    /// The oldest incident that is too many. One with its recording here stays, up to as many again.
    fn surplus(&self) -> Option<u64> {
        let surplus = self.incidents.len().saturating_sub(INCIDENTS_MAX);
        let mut oldest = self.incidents.keys().take(surplus).copied();
        if surplus > INCIDENTS_MAX {
            oldest.next()
        } else {
            oldest.find(|number| !self.has_recording(*number))
        }
    }

    pub fn refuse(&mut self, why: Malformed) {
        let (count, last) = self.refused.get_or_insert((0, why.clone()));
        *count = count.saturating_add(1);
        *last = why;
    }

    /// It said goodbye, and nothing after that.
    pub fn has_left(&self) -> bool {
        self.head.as_ref().is_some_and(|heard| {
            heard.head.ending
                || self.goodbye.is_some_and(|mark| mark.epoch == heard.mark.epoch && mark >= heard.mark)
        })
    }

    /// Two vehicles tell by this name.
    pub fn is_two(&self, now: Timestamp) -> bool {
        self.two_at.is_some_and(|at| now.since(at) <= TWO_FOR)
    }

    /// The last message of its log that its last head names, and when that head was made by its own clock, in milliseconds since
    /// 1970. `wall_ms` is the present.
    pub fn last_told(&self, wall_ms: i64, now: Timestamp) -> Option<(Mark, i64)> {
        let heard = self.head.as_ref()?;
        let age_ms = i64::try_from(heard.at.age(now).as_millis()).unwrap_or(i64::MAX);
        let last = Mark { epoch: heard.mark.epoch, n: heard.head.last };
        Some((last, wall_ms.saturating_sub(age_ms).saturating_add(heard.skew_ms)))
    }

    /// By how much its clock is ahead, if that is worth a word, in milliseconds.
    pub fn skew_ms(&self) -> Option<i64> {
        let skew = self.head.as_ref()?.skew_ms;
        (skew.unsigned_abs() > SKEW_MIN_MS).then_some(skew)
    }

    /// Since when it shows its state, by the hub's clock, in milliseconds since 1970.
    pub fn since_ms(&self) -> Option<i64> {
        let heard = self.head.as_ref()?;
        Some(heard.head.since.saturating_sub(self.skew_ms().unwrap_or(0)))
    }

    pub fn kept(&self, wall_ms: i64, now: Timestamp) -> Option<Kept> {
        let heard = self.head.as_ref()?;
        let age_ms = i64::try_from(heard.at.age(now).as_millis()).unwrap_or(i64::MAX);
        Some(Kept {
            epoch: heard.mark.epoch,
            n: heard.mark.n,
            key: heard.key.clone(),
            head: heard.head.clone(),
            has_left: self.has_left(),
            skew_ms: heard.skew_ms,
            heard_ms: wall_ms.saturating_sub(age_ms),
        })
    }

    /// As it was kept, at a time of the wall clock.
    pub fn of_kept(id: VehicleId, kept: Kept, wall_ms: i64, now: Timestamp) -> Vehicle {
        let mark = Mark { epoch: kept.epoch, n: kept.n };
        let age = u64::try_from(wall_ms.saturating_sub(kept.heard_ms)).unwrap_or(0);
        let heard = Heard {
            head: kept.head,
            mark,
            key: kept.key,
            at: Since::of_age(Span::from_millis(age), now),
            skew_ms: kept.skew_ms,
        };
        let goodbye = kept.has_left.then_some(mark);
        Vehicle { head: Some(heard), goodbye, ..Vehicle::new(id) }
    }
}

/// With bounds, and without letters that act.
fn bounded(head: &Head) -> Head {
    let cause = head.cause.as_ref();
    Head {
        name: clean(&head.name, NAME),
        cause: cause.map(|it| Cause { node: clean(&it.node, ID), words: clean(&it.words, MESSAGE) }),
        since: possible_ms(head.since),
        version: clean(&head.version, VALUE),
        config: clean(&head.config, 2 * VALUE),
        ..*head
    }
}
