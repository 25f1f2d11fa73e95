//! A disk that hangs fails nothing: it does not answer. The caller waits, and so does the probe,
//! so somebody else looks at how long the thread of the store has been at one thing.

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use tokio::sync::watch;

use super::health::{Fault, say};
use crate::clock::Clock;
use crate::engine::time::{Span, Timestamp};

/// Longer than the database waits for another process that writes.
const ANSWERS_WITHIN: Span = Span::from_secs(3);

const LOOK_EVERY: Duration = Duration::from_millis(250);

/// How the thread of the store gets on.
#[derive(Debug)]
pub(in crate::store) struct Pace {
    step: Mutex<Step>,
    fault: watch::Sender<Fault>,
    /// What is said of it.
    hangs: String,
}

#[derive(Debug, Default)]
struct Step {
    /// When it began; `None` while there is nothing to do.
    since: Option<Timestamp>,
    /// It was said to hang.
    is_told: bool,
}

impl Pace {
    /// Looks after a store for as long as that keeps the pace.
    pub(in crate::store) fn watch(
        fault: watch::Sender<Fault>,
        folder: Option<&Path>,
        clock: Clock,
    ) -> std::io::Result<Arc<Pace>> {
        let disk = folder.map_or_else(
            || "the database".to_owned(),
            |folder| format!("the disk of the data folder {}", folder.display()),
        );
        let hangs = format!("{disk} has not answered for {} s", ANSWERS_WITHIN.as_millis() / 1000);
        let pace = Arc::new(Pace { step: Mutex::default(), fault, hangs });
        let looked_at = Arc::downgrade(&pace);
        std::thread::Builder::new()
            .name("store watch".to_owned())
            .spawn(move || look_after(&looked_at, clock))?;
        Ok(pace)
    }

    /// The next thing begins. Tells whether the one before was said to hang.
    pub(in crate::store) fn step(&self, now: Timestamp) -> bool {
        std::mem::replace(&mut *self.lock(), Step { since: Some(now), is_told: false }).is_told
    }

    /// There is nothing to do. Tells whether what there was was said to hang.
    pub(in crate::store) fn rest(&self) -> bool {
        std::mem::take(&mut *self.lock()).is_told
    }

    fn look(&self, now: Timestamp) {
        let mut step = self.lock();
        let hangs = step.since.is_some_and(|since| now.since(since) >= ANSWERS_WITHIN);
        if hangs && !step.is_told {
            step.is_told = true;
            say(&self.fault, Some(&self.hangs));
        }
    }

    fn lock(&self) -> MutexGuard<'_, Step> {
        self.step.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn look_after(pace: &Weak<Pace>, clock: Clock) {
    while let Some(pace) = pace.upgrade() {
        pace.look(clock.now());
        drop(pace);
        std::thread::sleep(LOOK_EVERY);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use tokio::sync::oneshot;
    use tokio::task::JoinHandle;

    use super::*;
    use crate::store::audit::{Action, Record, TELLTALE};
    use crate::store::{DemoSecrets, Store, StoreError};

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
            let waiting = tokio::spawn(async move { waits.audit(Record::of(Action::Start, TELLTALE)).await });
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
