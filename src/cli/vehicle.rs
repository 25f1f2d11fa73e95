//! Lets the simulated shuttle drive in real time and publish over DDS.

use tokio::sync::mpsc;
use tokio::time::MissedTickBehavior;

use crate::clock::Clock;
use crate::engine::model::{ACTIVE_SIGNAL, Model};
use crate::ros::{BridgeError, BridgeOptions, PublishError, Publisher};
use crate::sim::shuttle::{Fault, Message, STEP, Shuttle};

/// Any will do; the same one makes each demo tell the same story.
const SEED: u64 = 1;

/// Switches that may wait for the shuttle: far more than it has faults.
pub const SWITCHES: usize = 64;

/// The shuttle with a DDS participant of its own.
pub struct Vehicle {
    shuttle: Shuttle,
    publisher: Publisher,
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
        Ok(Vehicle { shuttle: Shuttle::new(SEED, clock.now()), publisher, active_topic, clock })
    }

    /// Drives and takes faults until their sender is gone, then leaves DDS.
    pub async fn run(mut self, mut faults: mpsc::Receiver<(Fault, bool)>) {
        let mut steps = tokio::time::interval(std::time::Duration::from_nanos(STEP.as_nanos()));
        steps.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let mut complained = false;
        loop {
            tokio::select! {
                fault = faults.recv() => match fault {
                    Some((fault, on)) => self.shuttle.set_fault(fault, on),
                    None => break,
                },
                _ = steps.tick() => {
                    for message in self.shuttle.advance(self.clock.now()) {
                        if let Err(error) = self.publish(&message).await
                            && !std::mem::replace(&mut complained, true)
                        {
                            tracing::warn!("the simulated shuttle: {error}");
                        }
                    }
                }
            }
        }
        self.publisher.shutdown().await;
    }

    async fn publish(&self, message: &Message) -> Result<(), PublishError> {
        match message {
            Message::Diagnostics(array) => self.publisher.diagnostics(array, self.clock.wall()).await,
            Message::Active(active) => self.publisher.boolean(&self.active_topic, *active).await,
        }
    }
}
