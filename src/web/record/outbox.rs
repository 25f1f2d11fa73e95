//! Records that the disk refused when they were due. The task that stores the vehicle's state writes them
//! as soon as possible, together with that state: until then the disk may hold the record of an action that
//! was not done.

use std::sync::{MutexGuard, PoisonError};
use std::time::SystemTime;

use crate::store::audit::{Action, Record, TELLTALE};
use crate::web::AppState;

/// There are few, unless somebody taps on a broken disk; what comes past this is counted.
const OUTBOX_MAX: usize = 64;

/// The records, and how many more there were.
#[derive(Debug, Default)]
pub struct Outbox {
    records: Vec<Record>,
    omitted: u64,
}

impl Outbox {
    /// What is written later begins with when it was.
    fn add(&mut self, record: Record, at: SystemTime) {
        if self.records.len() >= OUTBOX_MAX {
            self.omitted += 1;
            return;
        }
        let at = format!("at {}", humantime::format_rfc3339_seconds(at));
        let target = if record.target.is_empty() { at } else { format!("{at}: {}", record.target) };
        self.records.push(record.on(target));
    }

    /// What is to be written, the number of those that were left out too.
    pub fn all(&self) -> Vec<Record> {
        let omitted = || format!("{} more actions and refusals", self.omitted);
        let omitted = (self.omitted > 0).then(|| Record::of(Action::Omitted, TELLTALE).on(omitted()));
        self.records.iter().cloned().chain(omitted).collect()
    }

    /// What there was is written.
    fn take_off(&mut self, written: &Outbox) {
        self.records.drain(..written.records.len());
        self.omitted -= written.omitted;
    }
}

impl AppState {
    /// Records something later.
    pub fn record_later(&self, record: Record) {
        let at = self.clock.wall();
        self.lock_outbox().add(record, at);
    }

    /// What waits now.
    pub fn waiting_records(&self) -> Outbox {
        let outbox = self.lock_outbox();
        Outbox { records: outbox.records.clone(), omitted: outbox.omitted }
    }

    /// This is on the disk. Only the task that follows the vehicle writes it.
    pub fn forget_written(&self, written: &Outbox) {
        self.lock_outbox().take_off(written);
    }

    fn lock_outbox(&self) -> MutexGuard<'_, Outbox> {
        self.outbox.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_waits_has_a_bound_and_the_rest_is_counted() {
        let mut outbox = Outbox::default();
        let record = |number: usize| Record::of(Action::Acknowledge, "127.0.0.1").on(number.to_string());
        let add = |outbox: &mut Outbox, count: usize| {
            (0..count).for_each(|number| outbox.add(record(number), SystemTime::UNIX_EPOCH));
        };
        outbox.add(Record::of(Action::Stop, "127.0.0.1"), SystemTime::UNIX_EPOCH);
        add(&mut outbox, 10 + OUTBOX_MAX);
        let all = outbox.all();
        assert_eq!(all.len(), OUTBOX_MAX + 1);
        assert_eq!(all[0].target, "at 1970-01-01T00:00:00Z");
        assert_eq!(all[1].target, "at 1970-01-01T00:00:00Z: 0");
        assert_eq!(
            (all[OUTBOX_MAX].action, &*all[OUTBOX_MAX].target),
            (Action::Omitted, "11 more actions and refusals")
        );
        // Others come while these are written.
        let written = Outbox { records: outbox.records.clone(), omitted: outbox.omitted };
        add(&mut outbox, 3);
        outbox.take_off(&written);
        let all = outbox.all();
        assert_eq!((all.len(), &*all[0].target), (1, "3 more actions and refusals"));
        let written = Outbox { records: outbox.records.clone(), omitted: outbox.omitted };
        outbox.take_off(&written);
        assert!(outbox.all().is_empty());
    }
}
