//! Runs a simulated machine in real time: it publishes over DDS and obeys the requests that it hears.

pub(in crate::cli) mod in_process;
pub(in crate::cli) mod machine;
mod orders;
mod robot_wire;
pub(super) mod shuttle_wire;

use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::{Interval, MissedTickBehavior};

use crate::clock::{self, Clock};
use crate::config::Loaded;
use crate::engine::time::{Span, Timestamp};
use crate::msg::messages::GidSize;
use crate::ros::{BridgeError, BridgeOptions, Publisher};
use crate::sim::machine::STEP;
use crate::web::FaultSwitch;
use machine::{Kind, Machine, SEED};
use orders::Orders;

/// Switches that may wait for the machine: far more than it has faults.
pub const SWITCHES: usize = 64;

/// How often the publisher is asked whether it still works.
const LOOK: Duration = Duration::from_millis(500);

/// The wait for participants that announce how long a gid is. Without any, gids are as long as in today's
/// distributions.
const ASKING: Span = Span::from_secs(3);

/// The machine with DDS participants of its own: one to publish, one to listen.
pub struct Vehicle {
    machine: Machine,
    publisher: Publisher,
    orders: Orders,
    /// Its nodes, as they were announced last.
    announced: Vec<&'static str>,
    /// Its nodes are subscribed to topics.
    subscribes: bool,
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
        kind: Kind,
        clock: Clock,
    ) -> Result<Vehicle, BridgeError> {
        let opened = clock.now();
        let machine = Machine::new(kind, SEED, loaded, opened);
        let publisher = publisher(options, &machine).await?;
        let orders = Orders::listen(options, &loaded.publishing, clock).await?;
        let (announced, options) = (Vec::new(), options.clone());
        Ok(Vehicle { machine, publisher, orders, announced, subscribes: false, opened, options, clock })
    }

    /// Subscribes its nodes to topics, as the graph of a real machine has it. Each message is then received once
    /// more, which a demo has no use for.
    ///
    /// # Errors
    /// No type has such a name.
    pub fn subscribe(&mut self) -> Result<(), BridgeError> {
        self.subscribes = true;
        subscribe(&mut self.publisher, &self.machine)
    }

    /// Drives, obeys and takes faults until their sender is gone, then leaves DDS.
    pub async fn run(mut self, mut faults: mpsc::Receiver<FaultSwitch>) {
        let mut steps = every(Duration::from(STEP));
        let mut looks = every(LOOK);
        loop {
            tokio::select! {
                fault = faults.recv() => match fault {
                    Some(FaultSwitch { name, active }) => self.machine.set_fault(name, active),
                    None => break,
                },
                order = self.orders.next() => self.machine.obey(order),
                _ = steps.tick() => {
                    self.publish().await;
                    self.announce().await;
                }
                _ = looks.tick() => self.reopen_if_stopped().await,
            }
        }
        self.publisher.shutdown().await;
        self.orders.shutdown().await;
    }

    /// Publishes the messages until now. A reader loses what it does not take in time, as on a vehicle.
    async fn publish(&mut self) {
        let now = self.clock.now();
        let wall = self.clock.wall();
        for (topic, body) in self.machine.advance(now, |at| clock::wall_at(wall, now, at)) {
            if let Err(error) = self.publisher.publish(topic, body).await {
                tracing::debug!("the simulation: {error}");
            }
        }
    }

    /// Announces the nodes, if they have changed.
    async fn announce(&mut self) {
        let nodes = self.machine.nodes();
        if nodes == self.announced {
            return;
        }
        let alone = self.clock.now() >= self.opened + ASKING;
        let Some(size) = self.orders.gid_size().or(alone.then_some(GidSize::Bytes16)) else { return };
        let entities: Vec<_> = nodes.iter().map(|node| (*node, self.machine.topics_of(node))).collect();
        if let Err(error) = self.publisher.announce(&entities, size).await {
            tracing::debug!("the simulation: {error}");
        }
        self.announced = nodes;
    }

    /// Opens the publisher again after a stop with Ctrl-Z.
    async fn reopen_if_stopped(&mut self) {
        if !self.publisher.has_stopped() {
            return;
        }
        let opened = publisher(&self.options, &self.machine).await.and_then(|mut publisher| {
            if self.subscribes {
                subscribe(&mut publisher, &self.machine)?;
            }
            Ok(publisher)
        });
        match opened {
            Ok(publisher) => {
                self.announced.clear();
                std::mem::replace(&mut self.publisher, publisher).shutdown().await;
            }
            Err(error) => tracing::warn!("the simulation cannot publish: {error}"),
        }
    }
}

/// A participant that offers the topics of a machine.
pub(in crate::cli) async fn publisher(
    options: &BridgeOptions,
    machine: &Machine,
) -> Result<Publisher, BridgeError> {
    let mut publisher = Publisher::open(options, &[]).await?;
    for (topic, type_name, quality) in machine.offers() {
        publisher.offer(topic, type_name, quality)?;
    }
    publisher.offer_announcements();
    Ok(publisher)
}

fn subscribe(publisher: &mut Publisher, machine: &Machine) -> Result<(), BridgeError> {
    for node in machine.nodes() {
        for topic in machine.subscriptions_of(node) {
            let offer = machine.offers().into_iter().find(|(offered, ..)| *offered == topic);
            if let Some((_, type_name, _)) = offer {
                publisher.subscribe(node, topic, type_name)?;
            }
        }
    }
    Ok(())
}

fn every(period: Duration) -> Interval {
    let mut interval = tokio::time::interval(period);
    interval.set_missed_tick_behavior(MissedTickBehavior::Skip);
    interval
}
