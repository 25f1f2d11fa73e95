//! Telltale's services for other ROS 2 nodes: takes requests, has them done elsewhere, and answers each.
//!
//! They have a participant of their own, so that no client can delay what is read of the vehicle or sent to it.
//! Clients of Cyclone DDS and of Fast DDS are served at the same time. A flood is bounded by `limit`, and every
//! queue here has a bound.

mod answered;
mod limit;
mod server;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{mpsc, oneshot, watch};
use tokio::task::JoinHandle;

use super::engine_queue::stopped;
use super::options::interfaces::{self, AddressWatch};
use super::{BridgeOptions, Graph};
use crate::every;
use server::Server;
use telltale_clock::Clock;
use telltale_engine::model::service::Service;
use telltale_msg::services::Reply;

/// Calls that wait to be carried out. More are refused.
pub const CALLS_MAX: usize = 8;

/// How often the addresses are compared.
const LOOK: Duration = Duration::from_secs(1);
const RETRY: Duration = Duration::from_secs(1);

/// A request that somebody has to do.
#[derive(Debug)]
pub struct Call {
    pub service: Service,
    /// Empty for a service without an argument.
    pub argument: Box<str>,
    /// The caller by its node and participant. Nobody proves either.
    pub caller: Box<str>,
    pub reply: oneshot::Sender<Reply>,
}

/// The running services. They end when this is dropped.
#[derive(Debug)]
pub struct Services {
    stop: watch::Sender<bool>,
    offered: watch::Sender<BTreeSet<Service>>,
    task: JoinHandle<()>,
}

/// State that outlives a participant.
struct ServicesContext {
    options: BridgeOptions,
    calls: mpsc::Sender<Call>,
    graph: Graph,
    clock: Clock,
}

/// Starts to serve. Without services there is no participant.
pub fn start(
    options: BridgeOptions,
    offered: BTreeSet<Service>,
    calls: mpsc::Sender<Call>,
    graph: Graph,
    clock: Clock,
) -> Services {
    let (stop, stopping) = watch::channel(false);
    let (offered, wanted) = watch::channel(offered);
    let around = Arc::new(ServicesContext { options, calls, graph, clock });
    let task = tokio::spawn(run(around, wanted, stopping));
    Services { stop, offered, task }
}

impl Services {
    /// Offers other services from now on.
    pub fn follow(&self, services: BTreeSet<Service>) {
        self.offered.send_if_modified(|known| {
            let differs = *known != services;
            *known = services;
            differs
        });
    }

    /// Ends the services and waits for the library's threads.
    pub async fn shutdown(self) {
        // An error means that the task has ended by itself.
        let _ = self.stop.send(true);
        if let Err(panic) = self.task.await {
            tracing::error!("the services failed: {panic}");
        }
    }
}

/// Makes one participant after the other, while there are services.
async fn run(
    around: Arc<ServicesContext>,
    mut wanted: watch::Receiver<BTreeSet<Service>>,
    mut stop: watch::Receiver<bool>,
) {
    let mut refused = false;
    loop {
        let services = wanted.borrow_and_update().clone();
        if services.is_empty() {
            tokio::select! {
                () = stopped(&mut stop) => return,
                changed = wanted.changed() => if changed.is_err() { return },
            }
            continue;
        }
        match Server::open(around.clone(), &services).await {
            Ok(mut server) => {
                refused = false;
                tokio::select! {
                    () = server.serve() => {}
                    () = stopped(&mut stop) => {}
                    // A reload may have been asked for here: its client waits for the answer.
                    Ok(()) = wanted.changed() => server.finish().await,
                    () = addresses_change(&around.options) => {
                        tracing::warn!("the participant of the services is replaced: the addresses have changed");
                    }
                }
                server.close().await;
                if !*stop.borrow() && wanted.has_changed().is_ok_and(|changed| changed) {
                    continue;
                }
            }
            Err(error) if !std::mem::replace(&mut refused, true) => {
                tracing::error!("the services cannot be offered for now, trying again: {error}");
            }
            Err(_) => {}
        }
        tokio::select! {
            biased;
            () = stopped(&mut stop) => return,
            () = tokio::time::sleep(RETRY) => {}
        }
    }
}

/// Waits until the addresses are others than the participant was made with.
async fn addresses_change(options: &BridgeOptions) {
    let now = interfaces::addresses().unwrap_or_default();
    let mut addresses = AddressWatch::new(options.interface, &now);
    let mut looks = every(LOOK);
    loop {
        looks.tick().await;
        // An error while listing the interfaces says nothing about them.
        if interfaces::addresses().is_ok_and(|now| addresses.look(&now)) {
            return;
        }
    }
}
