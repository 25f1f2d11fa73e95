//! Lets the simulated shuttle drive in real time and publish over DDS.

use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::{Interval, MissedTickBehavior};

use crate::clock::Clock;
use crate::engine::model::{ACTIVE_SIGNAL, Model};
use crate::ros::{BridgeError, BridgeOptions, Publisher};
use crate::sim::shuttle::{Fault, Message, STEP, Shuttle};

/// Any will do; the same one makes each demo tell the same story.
const SEED: u64 = 1;

/// Switches that may wait for the shuttle: far more than it has faults.
pub const SWITCHES: usize = 64;

/// How often the publisher is asked whether it still works.
const LOOK: Duration = Duration::from_millis(500);

/// The shuttle with a DDS participant of its own.
pub struct Vehicle {
    shuttle: Shuttle,
    publisher: Publisher,
    options: BridgeOptions,
    active_topic: Box<str>,
    clock: Clock,
}

impl Vehicle {
    /// # Errors
    /// The interface is not there, or DDS gets no sockets.
    pub async fn open(options: &BridgeOptions, model: &Model, clock: Clock) -> Result<Vehicle, BridgeError> {
        let active = model.signals.iter().find(|signal| &*signal.name == ACTIVE_SIGNAL);
        let active_topic = active.map_or("/mission/active".into(), |signal| signal.source.topic.clone());
        let publisher = Publisher::open(options, &[&active_topic]).await?;
        let shuttle = Shuttle::new(SEED, clock.now());
        Ok(Vehicle { shuttle, publisher, options: options.clone(), active_topic, clock })
    }

    /// Drives and takes faults until their sender is gone, then leaves DDS.
    pub async fn run(mut self, mut faults: mpsc::Receiver<(Fault, bool)>) {
        let mut steps = every(Duration::from_nanos(STEP.as_nanos()));
        let mut looks = every(LOOK);
        loop {
            tokio::select! {
                fault = faults.recv() => match fault {
                    Some((fault, on)) => self.shuttle.set_fault(fault, on),
                    None => break,
                },
                _ = steps.tick() => {
                    for message in self.shuttle.advance(self.clock.now()) {
                        self.publish(&message).await;
                    }
                }
                _ = looks.tick() => self.reopen_if_stopped().await,
            }
        }
        self.publisher.shutdown().await;
    }

    /// What a reader does not take in time is lost to it, as on a vehicle.
    async fn publish(&self, message: &Message) {
        let published = match message {
            Message::Diagnostics(array) => self.publisher.diagnostics(array, self.clock.wall()).await,
            Message::Active(active) => self.publisher.boolean(&self.active_topic, *active).await,
        };
        if let Err(error) = published {
            tracing::debug!("the simulated shuttle: {error}");
        }
    }

    /// Whoever puts the demo to sleep with Ctrl-Z finds it awake again.
    async fn reopen_if_stopped(&mut self) {
        if !self.publisher.has_stopped() {
            return;
        }
        match Publisher::open(&self.options, &[&self.active_topic]).await {
            Ok(publisher) => std::mem::replace(&mut self.publisher, publisher).shutdown().await,
            Err(error) => tracing::warn!("the simulated shuttle cannot publish: {error}"),
        }
    }
}

fn every(period: Duration) -> Interval {
    let mut interval = tokio::time::interval(period);
    interval.set_missed_tick_behavior(MissedTickBehavior::Skip);
    interval
}
