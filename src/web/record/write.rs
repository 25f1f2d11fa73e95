//! Writes records into the audit log, together with the vehicle's state, with a limit on the wait for the
//! disk.

use std::time::Duration;

use tokio::time::{Instant, timeout, timeout_at};

use crate::engine::restart::foresee::Foreseen;
use crate::engine::time::{Span, Timestamp};
use crate::store::audit::Record;
use crate::store::{StoreError, VehicleMemory};
use crate::web::AppState;

/// What is to be recorded and stands already waits no longer for others than this, and no longer for
/// the disk: a page hears of it within the two seconds for which it waits.
pub const RECORDED_WITHIN: Span = Span::from_millis(800);

/// Why something could not be written ahead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotWritten {
    /// The disk does not take it, or not in time.
    Storage,
    /// The store does not answer.
    Unavailable,
}

impl AppState {
    /// Writes down what is about to be done, until then or not at all. If the disk does not answer
    /// until then, what it holds is known later: that it was not done is written then. The place is
    /// free when the disk has answered.
    ///
    /// # Errors
    /// Why it must not be done.
    pub async fn write_ahead(
        &self,
        memory: Option<VehicleMemory>,
        record: &Record,
        until: Timestamp,
        place: impl Send + 'static,
    ) -> Result<(), NotWritten> {
        let (store, records) = (self.store.clone(), vec![record.clone()]);
        let mut writing = Box::pin(async move { store.write_ahead(memory, records, until).await });
        let not_done = record.clone().refused("the disk did not answer in time");
        let Some(written) = self.by(until, &mut writing).await else {
            tracing::error!("the disk does not answer, so an action is not done");
            let app = self.clone();
            tokio::spawn(async move {
                let _place = place;
                // Whether it was written or not, it was not done.
                let _ = writing.await;
                app.record_later(not_done);
            });
            return Err(NotWritten::Storage);
        };
        written.map_err(|error| {
            tracing::error!(%error, "an action cannot be kept, so it is not done");
            let is_late = matches!(error, StoreError::TooLate);
            self.record_later(if is_late {
                not_done
            } else {
                record.clone().refused("it could not be written")
            });
            if is_late || error.is_of_storage() { NotWritten::Storage } else { NotWritten::Unavailable }
        })
    }

    /// Records what stands already, and the vehicle if it is given. Tells whether it is on the disk;
    /// what the disk does not take waits and is written later.
    pub async fn record(&self, memory: Option<VehicleMemory>, record: Record) -> bool {
        let app = self.clone();
        let mut writing = Box::pin(async move {
            let written = match memory {
                Some(memory) => app.store.remember(memory, vec![record.clone()]).await,
                None => app.store.audit(record.clone()).await,
            };
            if let Err(error) = &written {
                let action = record.action.as_str();
                tracing::error!(%error, action, "the audit log lacks a record; it is written as soon as it can be");
                app.record_later(record);
            }
            written.is_ok()
        });
        match timeout(Duration::from_nanos(RECORDED_WITHIN.as_nanos()), &mut writing).await {
            Ok(is_written) => is_written,
            Err(_) => {
                tokio::spawn(writing);
                false
            }
        }
    }

    /// Waits until then at most.
    pub(in crate::web) async fn by<T>(&self, until: Timestamp, what: impl Future<Output = T>) -> Option<T> {
        timeout_at(Instant::from_std(self.clock.instant(until)), what).await.ok()
    }

    /// Records what has happened, without making anybody wait.
    pub fn note(&self, record: Record) {
        let app = self.clone();
        tokio::spawn(async move { app.record(None, record).await });
    }

    /// The vehicle as it will be.
    pub fn remembering(&self, foreseen: Foreseen) -> VehicleMemory {
        VehicleMemory { seq: foreseen.seq, at: self.clock.wall(), vehicle: foreseen.vehicle }
    }

    /// Whether what is granted can be written down.
    pub fn is_storage_ok(&self) -> bool {
        self.store.fault().borrow().is_none()
    }
}
