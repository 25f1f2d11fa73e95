//! Records that the disk has not taken yet. They are written with the next change that the disk takes,
//! before the records of that change. With a queue for each purpose they would get out of order.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

use super::audit::limit::Limit;
use super::audit::{Action, Record, TELLTALE};
use super::{Caller, Database, StoreError};
use telltale_clock::Clock;
use telltale_engine::time::{Span, Timestamp};

/// Records that may wait. More are left out and counted.
const RECORDS_MAX: usize = 1024;
/// The share of callers from elsewhere, who need no login for it.
const FROM_ELSEWHERE_MAX: usize = 256;

/// A record that waited longer begins with the time of its event.
const ON_TIME: Span = Span::from_secs(1);

/// A failed write is tried again after this.
const AGAIN_AFTER: Span = Span::from_millis(500);

/// The records of a store that are not on the disk. The store's thread writes them.
#[derive(Debug, Default)]
pub(super) struct Unwritten(Mutex<Queue>);

#[derive(Debug, Default)]
struct Queue {
    waiting: VecDeque<Waiting>,
    left_out: u64,
    /// Bounds the records that anybody can cause before they come here.
    limit: Limit,
    /// After a failed write.
    again_at: Option<Timestamp>,
}

#[derive(Debug)]
struct Waiting {
    record: Record,
    at: Timestamp,
    wall: SystemTime,
    /// The disk has refused it, or the action that it records.
    was_refused: bool,
}

/// The records that are written now.
#[derive(Debug, Default)]
pub(super) struct Batch {
    pub records: Vec<Record>,
    taken: usize,
    left_out: u64,
}

impl Unwritten {
    /// Takes a record of something that has just happened. Returns whether it will be written: a record that
    /// anybody can cause may be one too many of its kind.
    pub(super) fn put(&self, record: Record, clock: &Clock) -> bool {
        let (now, mut queue) = (clock.now(), self.lock());
        let Some(omitted) = queue.limit.admit(now, &record) else { return false };
        for record in omitted.into_iter().chain([record]) {
            queue.push(Waiting { record, at: now, wall: clock.wall(), was_refused: false });
        }
        true
    }

    /// Takes the record of an action that the disk refused.
    pub(super) fn put_refused(&self, record: Record, clock: &Clock) {
        let (at, wall) = (clock.now(), clock.wall());
        self.lock().push(Waiting { record, at, wall, was_refused: true });
    }

    pub(super) fn batch(&self, now: Timestamp) -> Batch {
        let queue = self.lock();
        let mut records: Vec<Record> = queue.waiting.iter().map(|it| it.as_written(now)).collect();
        records.extend((queue.left_out > 0).then(|| {
            let what = if queue.left_out == 1 { "record" } else { "records" };
            let target = format!("{} {what} that could not be written", queue.left_out);
            Record::of(Action::Omitted, TELLTALE).on(target)
        }));
        Batch { records, taken: queue.waiting.len(), left_out: queue.left_out }
    }

    /// The batch is on the disk.
    pub(super) fn written(&self, batch: &Batch) {
        let mut queue = self.lock();
        queue.waiting.drain(..batch.taken);
        queue.left_out -= batch.left_out;
        queue.again_at = None;
    }

    /// The disk takes nothing. Returns whether a record is refused for the first time.
    fn refused(&self, now: Timestamp) -> bool {
        let mut queue = self.lock();
        queue.again_at = Some(now + AGAIN_AFTER);
        let first = queue.waiting.iter().any(|it| !it.was_refused);
        queue.waiting.iter_mut().for_each(|it| it.was_refused = true);
        first
    }

    pub(super) fn waiting(&self) -> usize {
        self.lock().waiting.len()
    }

    fn is_empty(&self) -> bool {
        let queue = self.lock();
        queue.waiting.is_empty() && queue.left_out == 0
    }

    /// Takes in how much the limit left out. Returns whether a write may be tried.
    fn is_due(&self, clock: &Clock) -> bool {
        let (now, mut queue) = (clock.now(), self.lock());
        for record in queue.limit.due(now) {
            queue.push(Waiting { record, at: now, wall: clock.wall(), was_refused: false });
        }
        queue.again_at.is_none_or(|again_at| now >= again_at)
    }

    fn lock(&self) -> MutexGuard<'_, Queue> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Queue {
    fn push(&mut self, new: Waiting) {
        let is_far = |it: &Waiting| it.record.by_anybody == Some(Caller::Elsewhere);
        let has_room = self.waiting.len() < RECORDS_MAX
            && (!is_far(&new) || self.waiting.iter().filter(|it| is_far(it)).count() < FROM_ELSEWHERE_MAX);
        if has_room { self.waiting.push_back(new) } else { self.left_out += 1 }
    }
}

impl Waiting {
    fn as_written(&self, now: Timestamp) -> Record {
        let record = self.record.clone();
        if !self.was_refused && now.since(self.at) < ON_TIME {
            return record;
        }
        let at = format!("at {}", humantime::format_rfc3339_seconds(self.wall));
        let target = if record.target.is_empty() { at } else { format!("{at}: {}", record.target) };
        record.on(target)
    }
}

impl Database {
    /// Writes the records that wait, and removes the sessions that ended before the disk knew. Returns
    /// whether there was anything to write.
    pub(super) fn write_waiting(&mut self) -> Result<bool, StoreError> {
        let ended = self.sessions.unwritten();
        if self.unwritten.is_empty() && ended.is_empty() {
            return Ok(false);
        }
        let written = self.write(&[], |transaction| {
            let mut delete = transaction.prepare_cached("DELETE FROM sessions WHERE token_hash = ?1")?;
            for key in &ended {
                delete.execute([key])?;
            }
            Ok(())
        });
        match &written {
            Ok(()) => self.sessions.written(ended.len()),
            Err(error) if self.unwritten.refused(self.clock.now()) => {
                tracing::error!(%error, "the audit log lacks records; they are written as soon as possible");
            }
            Err(_) => {}
        }
        written.map(|()| true)
    }

    /// Writes the records that wait, where no job does. After a failure it waits before it tries again.
    pub(super) fn write_waiting_if_due(&mut self) {
        if self.unwritten.is_due(&self.clock)
            && let Err(error) = self.write_waiting()
        {
            self.health.judge(&error);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DemoSecrets, Store};

    fn record(number: usize) -> Record {
        Record::of(Action::Acknowledge, "127.0.0.1").on(number.to_string())
    }

    #[test]
    fn what_waits_has_a_bound_and_the_rest_is_counted() {
        let (clock, unwritten) = (Clock::start(), Unwritten::default());
        let put = |count: usize| (0..count).for_each(|number| assert!(unwritten.put(record(number), &clock)));
        put(RECORDS_MAX + 11);
        let batch = unwritten.batch(clock.now());
        assert_eq!((batch.records.len(), &*batch.records[0].target), (RECORDS_MAX + 1, "0"));
        let last = batch.records.last().map(|it| (it.action, &*it.target));
        assert_eq!(last, Some((Action::Omitted, "11 records that could not be written")));
        // Others come while these are written.
        put(3);
        unwritten.written(&batch);
        let batch = unwritten.batch(clock.now());
        assert_eq!(
            batch.records,
            [Record::of(Action::Omitted, TELLTALE).on("3 records that could not be written")]
        );
        unwritten.written(&batch);
        assert!(unwritten.is_empty());
    }

    #[test]
    fn callers_from_elsewhere_leave_room_for_the_vehicle() {
        let (clock, hand) = Clock::with_hand();
        let unwritten = Unwritten::default();
        for _ in 0..2 * FROM_ELSEWHERE_MAX {
            unwritten.put(record(0).by_anybody(Caller::Elsewhere), &clock);
            hand.advance(Span::from_secs(10));
        }
        unwritten.put(record(1), &clock);
        let records = unwritten.batch(clock.now()).records;
        assert_eq!(records.len(), FROM_ELSEWHERE_MAX + 2);
    }

    #[test]
    fn a_late_record_begins_with_the_time_of_its_event() {
        let (clock, hand) = Clock::with_hand();
        let unwritten = Unwritten::default();
        unwritten.put_refused(Record::of(Action::Stop, "127.0.0.1"), &clock);
        unwritten.put(record(0), &clock);
        let targets = |unwritten: &Unwritten| {
            let records = unwritten.batch(clock.now()).records;
            [0, 1].map(|at: usize| records[at].target.clone())
        };
        let [stop, other] = targets(&unwritten);
        assert!(stop.starts_with("at 20") && !stop.contains(": "), "{stop}");
        assert_eq!(other, "0");
        hand.advance(ON_TIME);
        let [_, other] = targets(&unwritten);
        assert!(other.starts_with("at 20") && other.ends_with("Z: 0"), "{other}");
    }

    #[tokio::test]
    async fn what_the_disk_refused_is_written_with_the_next_change_and_before_it() {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Refused).unwrap();
        let run = async |sql: &'static str| {
            store.call(move |database| Ok(database.connection.execute_batch(sql)?)).await.unwrap();
        };
        run("CREATE TRIGGER full BEFORE INSERT ON audit BEGIN SELECT RAISE(ABORT, 'no room'); END").await;
        assert!(!store.record(record(1), None).await);
        store.note(record(2));
        run("DROP TRIGGER full").await;
        assert!(store.record(record(3), None).await);
        let log = store.audit_entries(None, 10).await.unwrap();
        let targets: Vec<_> = log.iter().rev().map(|it| it.target.rsplit(' ').next().unwrap_or("")).collect();
        assert_eq!(targets, ["1", "2", "3"]);
        assert!(log[2].target.starts_with("at 20") && log[0].target == "3");
    }
}
