//! The three ways to record something: before it is done ([`Store::write_ahead`]), after it has happened
//! ([`Store::record`]), and after it has happened without a wait ([`Store::note`]).

use std::time::Duration;

use tokio::time::timeout;

use super::Record;
use crate::{Caller, Store, StoreError, VehicleMemory};
use telltale_engine::time::{Span, Timestamp};

/// [`Store::record`] waits no longer for the disk: a page hears of it within the two seconds for which it
/// waits.
pub const RECORDED_WITHIN: Span = Span::from_millis(800);

impl Store {
    /// Writes an action that is about to be done, with the vehicle's state after it, by `until` or not at
    /// all. When this returns, both are on the disk; only then may the action be done.
    ///
    /// A disk that answers after `until` may have written the action, which is not done. That is recorded
    /// then. `place` is held until the disk has answered.
    ///
    /// # Errors
    /// Why the action must not be done. A record of that is kept.
    pub async fn write_ahead(
        &self,
        record: &Record,
        memory: Option<VehicleMemory>,
        until: Timestamp,
        place: impl Send + 'static,
    ) -> Result<(), StoreError> {
        let (store, ahead) = (self.clone(), record.clone());
        let mut writing = Box::pin(async move {
            let job = store.call(move |database| {
                if database.clock.now() >= until {
                    return Err(StoreError::TooLate);
                }
                database.write_ahead(memory, ahead)
            });
            job.await
        });
        let refused = |error: &StoreError| match error {
            StoreError::TooLate => record.clone().refused(StoreError::TooLate.to_string()),
            _ => record.clone().refused("it could not be written"),
        };
        let Some(written) = self.clock.by(until, &mut writing).await else {
            tracing::error!("the disk does not answer, so an action is not done");
            let (store, not_done) = (self.clone(), refused(&StoreError::TooLate));
            tokio::spawn(async move {
                let _place = place;
                // Whether it was written or not, it was not done.
                let _ = writing.await;
                store.unwritten.put_refused(not_done, &store.clock);
            });
            return Err(StoreError::TooLate);
        };
        written.inspect_err(|error| {
            tracing::error!(%error, "an action cannot be written, so it is not done");
            self.unwritten.put_refused(refused(error), &self.clock);
        })
    }

    /// Records what has happened, with the vehicle's state after it. Returns whether it is on the disk. If
    /// the disk does not take it within [`RECORDED_WITHIN`], the record waits in memory.
    pub async fn record(&self, record: Record, memory: Option<VehicleMemory>) -> bool {
        let caller = record.by_anybody.unwrap_or(Caller::Vehicle);
        let is_refusal = record.refusal.is_some();
        if !self.unwritten.put(record, &self.clock) {
            return false;
        }
        let writing = self.call_from(caller, move |database| {
            database.remember(memory)?;
            // A refusal need not be on the disk to stay a refusal.
            if is_refusal { Ok(()) } else { database.health.check_keeps() }
        });
        let within = Duration::from(RECORDED_WITHIN);
        matches!(timeout(within, writing).await, Ok(Ok(())))
    }

    /// Records what has happened, within a second and without a wait.
    pub fn note(&self, record: Record) {
        self.unwritten.put(record, &self.clock);
    }
}

#[cfg(test)]
impl Store {
    /// [`Store::record`] without its limit of time: a test writes on a disk of any speed.
    pub(crate) async fn record_in_time(&self, record: Record) {
        assert!(self.unwritten.put(record, &self.clock));
        self.call(|database| database.write_waiting().map(drop)).await.unwrap();
    }
}
