//! Follows the hub: what it gives out becomes the state, and what changes in that is written to the disk.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use telltale_clock::{Clock, unix_ms};
use telltale_fleet::identity::Identity;
use telltale_fleet::line::{Hub, NoLine};
use telltale_fleet::message::{Batch, Malformed, VehicleId};
use telltale_fleet::reading::{Logs, Read, Reading};
use tokio::sync::watch;

use crate::kept::{Changes, Store};
use crate::state::{Arrived, Fleet};

/// The hub is tried again after this time.
const RECONNECT_AFTER: Duration = Duration::from_secs(1);

/// Changes wait this long for the disk.
const WRITE_EVERY: Duration = Duration::from_secs(2);

/// The state of all vehicles, for everybody who shows it. Clones are the same.
#[derive(Debug, Clone)]
pub struct Shared {
    fleet: Arc<Mutex<Fleet>>,
    /// Where logs can be asked for; `None` while the hub is away.
    logs: watch::Sender<Option<Logs>>,
    pub clock: Clock,
}

impl Shared {
    pub fn new(fleet: Fleet, clock: Clock) -> Shared {
        Shared { fleet: Arc::new(Mutex::new(fleet)), logs: watch::channel(None).0, clock }
    }

    /// For a moment, as all wait for it.
    pub fn fleet(&self) -> MutexGuard<'_, Fleet> {
        self.fleet.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn logs(&self) -> Option<Logs> {
        self.logs.borrow().clone()
    }

    /// Somebody looks at the present of a vehicle, which tells each change at once for a minute then.
    pub async fn look(&self, id: &VehicleId) {
        let Some(logs) = self.logs() else { return };
        if self.fleet().look(id, self.clock.now()) {
            // On a line that is cut it is asked again later.
            let _ = logs.look(id).await;
        }
    }

    /// Reads the hub, and another line after each fault, until it is aborted.
    pub async fn follow(self, hub: Hub, identity: Identity) {
        loop {
            let from_ms = self.fleet().log_from_ms(unix_ms(self.clock.wall()));
            let why = match Reading::open(&hub, &identity, from_ms).await {
                Ok(mut reading) => {
                    tracing::info!("the hub is reached");
                    self.logs.send_replace(Some(reading.logs()));
                    self.fleet().line_opened(self.clock.now());
                    let why = self.read(&mut reading).await;
                    self.logs.send_replace(None);
                    why
                }
                Err(NoLine::Refused) => "the hub does not admit this console".to_owned(),
                Err(NoLine::Unreachable(why)) => why,
            };
            if self.fleet().line().why != why {
                tracing::warn!("the hub is away: {why}");
            }
            self.fleet().line_ended(&why, self.clock.now());
            tokio::time::sleep(RECONNECT_AFTER).await;
        }
    }

    async fn read(&self, reading: &mut Reading) -> String {
        loop {
            match reading.next().await {
                Ok(read) => self.take(read),
                Err(why) => return why,
            }
        }
    }

    fn take(&self, read: Read) {
        let now = self.clock.now();
        let is_read = self.fleet().reads(&read.id, now);
        let (bytes, batch) =
            if is_read { Batch::weigh(&read.packed, &read.id) } else { (0, Err(Malformed::TooMuch)) };
        if let Err(why) = &batch {
            tracing::debug!(vehicle = %read.id, "a message is not taken: {why}");
        }
        let Read { stream, id, stored_ms, age, .. } = read;
        let mut fleet = self.fleet();
        fleet.take(Arrived { stream, id: id.clone(), batch, stored_ms, age }, now);
        fleet.has_read(&id, bytes, now);
    }

    /// Writes what changes to the disk until `end` turns true, and once more then.
    pub async fn keep(self, mut store: Store, mut end: watch::Receiver<bool>) {
        loop {
            let is_over = tokio::time::timeout(WRITE_EVERY, end.wait_for(|end| *end)).await.is_ok();
            let changes = Changes::of(&mut self.fleet(), &self.clock);
            let writing = tokio::task::spawn_blocking(move || {
                let written = store.write(&changes);
                (store, written, changes.unwritten)
            });
            let Ok((back, written, unwritten)) = writing.await else { return };
            store = back;
            if let Err(error) = written {
                tracing::error!("the vehicles' last states are not kept: {error}");
                self.fleet().put_back(unwritten);
            }
            if is_over {
                return;
            }
        }
    }
}
