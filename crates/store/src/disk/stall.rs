//! Finds a disk that hangs. Such a disk reports no error and does not answer: the caller waits, and so does
//! the probe. So another thread looks at how long the store's thread has been busy with one job.

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use tokio::sync::watch;

use super::health::{Fault, report};
use telltale_clock::Clock;
use telltale_engine::time::{Span, Timestamp};

/// Longer than SQLite waits for another process that writes.
const ANSWERS_WITHIN: Span = Span::from_secs(3);

const LOOK_EVERY: Duration = Duration::from_millis(250);

/// Watches how long the store's thread has been busy with one job.
#[derive(Debug)]
pub(crate) struct JobWatch {
    job: Mutex<Job>,
    fault: watch::Sender<Fault>,
    /// The report of a hanging disk.
    report: String,
}

/// The present job of the store's thread.
#[derive(Debug, Default)]
struct Job {
    /// When it began; `None` while there is no job.
    since: Option<Timestamp>,
    /// It was reported as hanging.
    is_reported: bool,
}

impl JobWatch {
    /// Watches a store for as long as the store lives.
    pub(crate) fn start(
        fault: watch::Sender<Fault>,
        folder: Option<&Path>,
        clock: Clock,
    ) -> std::io::Result<Arc<JobWatch>> {
        let disk = folder.map_or_else(
            || "the database".to_owned(),
            |folder| format!("the disk of the data folder {}", folder.display()),
        );
        let report = format!("{disk} has not answered for {} s", ANSWERS_WITHIN.as_millis() / 1000);
        let watch = Arc::new(JobWatch { job: Mutex::default(), fault, report });
        let watched = Arc::downgrade(&watch);
        std::thread::Builder::new().name("store watch".to_owned()).spawn(move || run(&watched, clock))?;
        Ok(watch)
    }

    /// The next job begins. Returns whether the one before was reported as hanging.
    pub(crate) fn begin(&self, now: Timestamp) -> bool {
        std::mem::replace(&mut *self.lock(), Job { since: Some(now), is_reported: false }).is_reported
    }

    /// There is no job. Returns whether the last one was reported as hanging.
    pub(crate) fn idle(&self) -> bool {
        std::mem::take(&mut *self.lock()).is_reported
    }

    fn look(&self, now: Timestamp) {
        let mut job = self.lock();
        let hangs = job.since.is_some_and(|since| now.since(since) >= ANSWERS_WITHIN);
        if hangs && !job.is_reported {
            job.is_reported = true;
            report(&self.fault, Some(&self.report));
        }
    }

    fn lock(&self) -> MutexGuard<'_, Job> {
        self.job.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn run(watched: &Weak<JobWatch>, clock: Clock) {
    while let Some(watch) = watched.upgrade() {
        watch.look(clock.now());
        drop(watch);
        std::thread::sleep(LOOK_EVERY);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use tokio::sync::oneshot;
    use tokio::task::JoinHandle;

    use super::*;
    use crate::{DemoSecrets, Store, StoreError};

    /// A job that does something and then hangs until the sender is dropped.
    async fn hang(
        store: &Store,
        first: &'static str,
    ) -> (mpsc::Sender<()>, JoinHandle<Result<(), StoreError>>) {
        let (begun, begins) = oneshot::channel();
        let (answer, answered) = mpsc::channel();
        let store = store.clone();
        let hanging = tokio::spawn(async move {
            store
                .call(move |database| {
                    database.connection.execute_batch(first)?;
                    begun.send(()).unwrap();
                    assert!(answered.recv().is_err());
                    Ok(())
                })
                .await
        });
        begins.await.unwrap();
        (answer, hanging)
    }

    #[tokio::test]
    async fn a_disk_that_hangs_is_a_fault_until_it_answers() {
        let (clock, hand) = Clock::with_hand();
        let store = Store::in_memory(clock, DemoSecrets::Refused).unwrap();
        let mut fault = store.fault();
        for _ in 0..2 {
            let (answer, hanging) = hang(&store, "").await;
            let waits = store.clone();
            let waiting = tokio::spawn(async move { waits.call(|_| Ok(())).await });
            hand.advance(ANSWERS_WITHIN - Span::from_secs(1));
            assert_eq!(*fault.borrow(), None);
            hand.advance(Span::from_secs(1));
            let said = fault.wait_for(Option::is_some).await.unwrap().clone().unwrap();
            assert!(said.contains("has not answered for 3 s"), "{said}");
            drop(answer);
            fault.wait_for(Option::is_none).await.unwrap();
            hanging.await.unwrap().unwrap();
            waiting.await.unwrap().unwrap();
        }
    }

    #[tokio::test]
    async fn a_disk_that_failed_while_it_hung_is_told_for_what_it_is() {
        let (clock, hand) = Clock::with_hand();
        let store = Store::in_memory(clock, DemoSecrets::Refused).unwrap();
        let mut fault = store.fault();
        let (answer, hanging) = hang(&store, "DROP TABLE beat").await;
        hand.advance(ANSWERS_WITHIN);
        fault.wait_for(Option::is_some).await.unwrap();
        drop(answer);
        let is_of_table = |fault: &Fault| fault.as_deref().is_some_and(|fault| fault.contains("beat"));
        fault.wait_for(is_of_table).await.unwrap();
        hanging.await.unwrap().unwrap();
    }
}
