//! Runs the simulated shuttle in real time: it publishes over DDS and obeys the requests that it hears.

mod orders;
pub(super) mod wire;

use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::{Interval, MissedTickBehavior};

use crate::clock::{self, Clock};
use crate::config::Loaded;
use crate::engine::time::{Span, Timestamp};
use crate::msg::messages::GidSize;
use crate::ros::{BridgeError, BridgeOptions, Publisher};
use crate::sim::shuttle::{Departure, Fault, STEP, Sent, Shuttle};
use orders::Orders;
use wire::Wire;

/// The seed of the simulation: with the same one, each demo runs alike.
const SEED: u64 = 1;

/// Switches that may wait for the shuttle: far more than it has faults.
pub const SWITCHES: usize = 64;

/// How often the publisher is asked whether it still works.
const LOOK: Duration = Duration::from_millis(500);

/// The wait for participants that announce how long a gid is. Without any, gids are as long as in today's
/// distributions.
const ASKING: Span = Span::from_secs(3);

/// The shuttle with DDS participants of its own: one to publish, one to listen.
pub struct Vehicle {
    shuttle: Shuttle,
    publisher: Publisher,
    orders: Orders,
    wire: Wire,
    /// Its nodes, as they were announced last.
    announced: Vec<&'static str>,
    opened: Timestamp,
    options: BridgeOptions,
    clock: Clock,
}

impl Vehicle {
    /// # Errors
    /// The interface is not there, or DDS gets no sockets.
    pub async fn open(
        options: &BridgeOptions,
        loaded: &Loaded,
        departure: Departure,
        clock: Clock,
    ) -> Result<Vehicle, BridgeError> {
        let wire = Wire::of(&loaded.model);
        let publisher = publisher(options, &wire).await?;
        let orders = Orders::listen(options, &loaded.publishing, clock).await?;
        let opened = clock.now();
        let shuttle = Shuttle::new(SEED, opened, &loaded.model.driving.stops, departure);
        let (announced, options) = (Vec::new(), options.clone());
        Ok(Vehicle { shuttle, publisher, orders, wire, announced, opened, options, clock })
    }

    /// Drives, obeys and takes faults until their sender is gone, then leaves DDS.
    pub async fn run(mut self, mut faults: mpsc::Receiver<(Fault, bool)>) {
        let mut steps = every(Duration::from_nanos(STEP.as_nanos()));
        let mut looks = every(LOOK);
        loop {
            tokio::select! {
                fault = faults.recv() => match fault {
                    Some((fault, on)) => self.shuttle.set_fault(fault, on),
                    None => break,
                },
                order = self.orders.next() => self.shuttle.obey(order),
                _ = steps.tick() => {
                    for sent in self.shuttle.advance(self.clock.now()) {
                        self.publish(&sent).await;
                    }
                    self.announce().await;
                }
                _ = looks.tick() => self.reopen_if_stopped().await,
            }
        }
        self.publisher.shutdown().await;
        self.orders.shutdown().await;
    }

    /// Publishes the messages. A reader loses what it does not take in time, as on a vehicle.
    async fn publish(&self, sent: &Sent) {
        let stamp = clock::wall_at(self.clock.wall(), self.clock.now(), sent.at);
        let (topic, body) = self.wire.encode(&sent.message, stamp);
        if let Err(error) = self.publisher.publish(topic, body).await {
            tracing::debug!("the simulated shuttle: {error}");
        }
    }

    /// Announces the nodes, if they have changed.
    async fn announce(&mut self) {
        let nodes = self.shuttle.nodes();
        if nodes == self.announced {
            return;
        }
        let alone = self.clock.now() >= self.opened + ASKING;
        let Some(size) = self.orders.gid_size().or(alone.then_some(GidSize::Bytes16)) else { return };
        let entities: Vec<_> = nodes.iter().map(|node| (*node, self.wire.topics_of(node))).collect();
        if let Err(error) = self.publisher.announce(&entities, size).await {
            tracing::debug!("the simulated shuttle: {error}");
        }
        self.announced = nodes;
    }

    /// Opens the publisher again after a stop with Ctrl-Z.
    async fn reopen_if_stopped(&mut self) {
        if !self.publisher.has_stopped() {
            return;
        }
        match publisher(&self.options, &self.wire).await {
            Ok(publisher) => {
                self.announced.clear();
                std::mem::replace(&mut self.publisher, publisher).shutdown().await;
            }
            Err(error) => tracing::warn!("the simulated shuttle cannot publish: {error}"),
        }
    }
}

async fn publisher(options: &BridgeOptions, wire: &Wire) -> Result<Publisher, BridgeError> {
    let mut publisher = Publisher::open(options, &[]).await?;
    for (topic, type_name, quality) in wire.offers() {
        publisher.offer(topic, type_name, quality)?;
    }
    publisher.offer_announcements();
    Ok(publisher)
}

fn every(period: Duration) -> Interval {
    let mut interval = tokio::time::interval(period);
    interval.set_missed_tick_behavior(MissedTickBehavior::Skip);
    interval
}
