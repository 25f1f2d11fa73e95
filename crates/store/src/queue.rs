//! The queue of jobs for the database. Jobs from elsewhere have few places and wait for one another, so that
//! strangers never make the store busy for the vehicle's own displays.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};

use super::{Caller, Database, Store, StoreError};
use telltale_clock::latency::Latency;

/// Jobs that may wait for the database. A full queue refuses the next one: see [`StoreError::Busy`].
const JOBS_MAX: usize = 256;
/// The places for jobs from elsewhere and from unknown callers.
const STRANGERS_MAX: usize = 16;

pub(super) type Job = Box<dyn FnOnce(&mut Database) + Send>;

/// The queue of the store's thread. Clones share it.
#[derive(Debug, Clone)]
pub(super) struct Queue {
    jobs: Sender<Job>,
    places: Arc<Semaphore>,
    of_strangers: Arc<Semaphore>,
    latency: Latency,
}

/// The place of one job. The job holds it until it is done, even if nobody waits for its answer any more.
struct JobPlace {
    _place: OwnedSemaphorePermit,
    _of_stranger: Option<OwnedSemaphorePermit>,
}

impl Queue {
    pub(super) fn new() -> (Queue, Receiver<Job>) {
        let (jobs, queue) = channel();
        let semaphore = |places| Arc::new(Semaphore::new(places));
        (
            Queue {
                jobs,
                places: semaphore(JOBS_MAX),
                of_strangers: semaphore(STRANGERS_MAX),
                latency: Latency::default(),
            },
            queue,
        )
    }

    fn place(&self, of_stranger: Option<OwnedSemaphorePermit>) -> Result<JobPlace, StoreError> {
        let place = self.places.clone().try_acquire_owned().map_err(|_| StoreError::Busy)?;
        Ok(JobPlace { _place: place, _of_stranger: of_stranger })
    }
}

impl Store {
    /// How long jobs take, their waiting included.
    pub fn job_latency(&self) -> &Latency {
        &self.queue.latency
    }

    /// Jobs that wait, or are being done.
    pub fn jobs_waiting(&self) -> usize {
        JOBS_MAX.saturating_sub(self.queue.places.available_permits())
    }

    /// Records of the audit log that are not on the disk.
    pub fn records_unwritten(&self) -> usize {
        self.unwritten.waiting()
    }

    /// Runs `job` on the store's thread and waits for its answer.
    pub(super) async fn call<T: Send + 'static>(
        &self,
        job: impl FnOnce(&mut Database) -> Result<T, StoreError> + Send + 'static,
    ) -> Result<T, StoreError> {
        let place = self.queue.place(None)?;
        self.run_job(place, job).await
    }

    /// Runs `job` for this caller. Callers from elsewhere wait for a place.
    pub(super) async fn call_from<T: Send + 'static>(
        &self,
        caller: Caller,
        job: impl FnOnce(&mut Database) -> Result<T, StoreError> + Send + 'static,
    ) -> Result<T, StoreError> {
        if caller == Caller::Vehicle {
            return self.call(job).await;
        }
        let permit = self.queue.of_strangers.clone().acquire_owned().await;
        let place = self.queue.place(Some(permit.map_err(|_| StoreError::Ended)?))?;
        self.run_job(place, job).await
    }

    /// Runs a job that follows from an earlier one: it waits for a place instead of being refused.
    pub(super) async fn call_surely<T: Send + 'static>(
        &self,
        job: impl FnOnce(&mut Database) -> Result<T, StoreError> + Send + 'static,
    ) -> Result<T, StoreError> {
        let permit = self.queue.places.clone().acquire_owned().await;
        let place = JobPlace { _place: permit.map_err(|_| StoreError::Ended)?, _of_stranger: None };
        self.run_job(place, job).await
    }

    async fn run_job<T: Send + 'static>(
        &self,
        place: JobPlace,
        job: impl FnOnce(&mut Database) -> Result<T, StoreError> + Send + 'static,
    ) -> Result<T, StoreError> {
        let (reply, answer) = oneshot::channel();
        let (latency, given) = (self.queue.latency.clone(), self.clock.now());
        let job: Job = Box::new(move |database| {
            let came_to = job(database);
            latency.observe(database.clock.now().since(given));
            if let Err(error) = &came_to {
                database.health.judge(error);
            }
            drop(place);
            // A caller that went away no longer needs the answer.
            let _ = reply.send(came_to);
        });
        self.queue.jobs.send(job).map_err(|_| StoreError::Ended)?;
        answer.await.map_err(|_| StoreError::Ended)?
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::sync_channel;

    use super::*;
    use crate::audit::{Action, Record, TELLTALE};
    use crate::{DemoSecrets, Role};
    use telltale_clock::Clock;

    /// Lets every other task run until it waits.
    async fn turns() {
        for _ in 0..100 {
            tokio::task::yield_now().await;
        }
    }

    #[tokio::test]
    async fn strangers_fill_their_own_share_alone_whether_they_wait_or_not() {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Refused).unwrap();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        // The disk is slow.
        let (go_on, stuck) = sync_channel::<()>(0);
        let slow = tokio::spawn({
            let store = store.clone();
            async move { store.call(move |_| Ok(stuck.recv().is_ok())).await }
        });
        turns().await;
        let mut strangers = Vec::new();
        for number in 0..1000 {
            let store = store.clone();
            strangers.push(tokio::spawn(async move {
                match number % 4 {
                    0 => store.is_ready().await,
                    1 => store.has_users().await.is_ok(),
                    2 => store.knows_user("anna").await.is_ok(),
                    _ => store.find_user(Caller::Elsewhere, "anna").await.is_ok(),
                }
            }));
        }
        turns().await;
        // Callers that go away leave their jobs behind.
        strangers.drain(..500).for_each(|stranger| stranger.abort());
        turns().await;
        assert_eq!(store.queue.places.available_permits(), JOBS_MAX - 1 - STRANGERS_MAX);
        let operator = tokio::spawn({
            let store = store.clone();
            async move { store.record(Record::of(Action::Stop, TELLTALE), None).await }
        });
        turns().await;
        go_on.send(()).unwrap();
        assert!(slow.await.unwrap().unwrap());
        assert!(operator.await.unwrap(), "it is not busy because of strangers");
        for stranger in strangers {
            assert!(stranger.await.unwrap(), "each gets its turn");
        }
        assert_eq!(store.queue.places.available_permits(), JOBS_MAX);
    }

    #[tokio::test]
    async fn what_has_to_be_written_waits_where_others_are_refused() {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Refused).unwrap();
        let (go_on, stuck) = sync_channel::<()>(0);
        let mut stuck = Some(stuck);
        let others: Vec<_> = (0..JOBS_MAX)
            .map(|_| {
                let (store, stuck) = (store.clone(), stuck.take());
                let job = move |_: &mut Database| Ok(stuck.is_none_or(|stuck| stuck.recv().is_ok()));
                tokio::spawn(async move { store.call(job).await })
            })
            .collect();
        turns().await;
        assert!(matches!(store.call(|_| Ok(())).await, Err(StoreError::Busy)));
        let sure = tokio::spawn({
            let store = store.clone();
            async move { store.call_surely(|_| Ok(())).await }
        });
        turns().await;
        go_on.send(()).unwrap();
        sure.await.unwrap().unwrap();
        for other in others {
            assert!(other.await.unwrap().unwrap());
        }
    }
}
