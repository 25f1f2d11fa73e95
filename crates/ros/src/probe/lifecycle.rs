//! Watchdogs of lifecycle nodes: calls `get_state` of each again and again. Nothing else of a node is called.

use std::future::poll_fn;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;

use super::EVERY_MIN;
use crate::discovery::graph::service_topics;
use crate::discovery::nodes::Nodes;
use crate::every;
use crate::library::qos::Via;
use crate::library::spdp::prefix;
use crate::library::{Participant, Quality, RawSample, Reader, ReaderEvent, Writer};
use crate::outbox::stopped;
use telltale_clock::Clock;
use telltale_engine::input::Input;
use telltale_engine::model::monitors::{ProbeTarget, WatchdogSpec};
use telltale_engine::model::sample::{Probe, ProbeOutcome};
use telltale_msg::lifecycle::{self, GET_STATE};
use telltale_msg::received::Stamped;
use telltale_msg::services::Correlation;
use telltale_msg::subscription::Plan;

/// Replies that the library keeps. Those to other clients come too.
const DEPTH: usize = 16;

#[derive(Clone)]
pub struct LifecycleContext {
    pub participant: Participant,
    pub inputs: mpsc::Sender<Stamped>,
    pub nodes: watch::Receiver<Nodes>,
    pub clock: Clock,
}

/// Runs the watchdogs of lifecycle nodes of the plan until it is stopped. A new plan restarts all of them.
pub async fn run(
    context: LifecycleContext,
    mut plan: watch::Receiver<Arc<Plan>>,
    mut stop: watch::Receiver<bool>,
) {
    loop {
        let mut tasks = JoinSet::new();
        let watchdogs = plan.borrow_and_update().watchdogs.clone();
        for spec in watchdogs {
            if let ProbeTarget::Lifecycle { name } = &spec.target {
                let client = Client::new(&context, name);
                tasks.spawn(watch(spec, client, context.inputs.clone()));
            }
        }
        tokio::select! {
            () = stopped(&mut stop) => return,
            Ok(()) = plan.changed() => {}
        }
        tasks.shutdown().await;
    }
}

async fn watch(spec: Arc<WatchdogSpec>, mut client: Client, inputs: mpsc::Sender<Stamped>) {
    let period = Duration::from_nanos(spec.every.as_nanos()).max(EVERY_MIN);
    let mut looks = every(period);
    loop {
        looks.tick().await;
        let outcome = client.ask(period).await;
        let input = Input::Probe(Probe { source: spec.clone(), outcome });
        if inputs.send(Stamped::new(input, client.clock.now())).await.is_err() {
            return;
        }
    }
}

/// The client of one node's service.
struct Client {
    participant: Participant,
    nodes: watch::Receiver<Nodes>,
    clock: Clock,
    service: String,
    request_topic: String,
    requests: Writer,
    replies: Reader,
    /// Names us to servers of Cyclone DDS.
    id: u64,
    /// Of the last request, and of its sample.
    sequence: i64,
}

impl Client {
    fn new(context: &LifecycleContext, node: &str) -> Client {
        let LifecycleContext { participant, nodes, clock, .. } = context.clone();
        let service = format!("/{}/{GET_STATE}", node.trim_start_matches('/'));
        let [request_topic, reply_topic] = service_topics(&service);
        let [requests, replies] = lifecycle::dds_types();
        // Of the end of the prefix: its beginning is the same for all participants of a vendor.
        let id = prefix(&participant.guid()).last_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
        Client {
            requests: participant.writer(&request_topic, &requests, Quality::Command),
            replies: participant.reader(&reply_topic, &replies, Via::Reliable, DEPTH),
            participant,
            nodes,
            clock,
            service,
            request_topic,
            id,
            sequence: 0,
        }
    }

    /// Calls once. The first call can be lost although the service was seen: the next one is not.
    async fn ask(&mut self, patience: Duration) -> ProbeOutcome {
        let start = self.clock.now();
        let known = self.nodes.borrow().ask_service(&self.service, start);
        if known != ProbeOutcome::Announced {
            return known;
        }
        let server = self.participant.seen().readers_of(&self.request_topic).next().map(|it| it.guid);
        let Some(server) = server else {
            return ProbeOutcome::Impossible("its service is being discovered still".into());
        };
        self.sequence += 1;
        let request = lifecycle::request(&server, self.id, self.sequence);
        if let Err(error) = self.requests.write(request).await {
            return ProbeOutcome::Impossible(error.into());
        }
        match tokio::time::timeout(patience, self.state()).await {
            Ok(lifecycle::ACTIVE) => ProbeOutcome::Answered { after: self.clock.now().since(start) },
            Ok(state) => ProbeOutcome::Inactive { state: lifecycle::state_name(state).into() },
            Err(_) => ProbeOutcome::Missed(format!("no answer within {patience:?}").into()),
        }
    }

    /// The state in the reply to the last request. Replies to other clients and to earlier requests are passed over.
    async fn state(&mut self) -> u8 {
        loop {
            let heard = poll_fn(|context| self.replies.poll(context)).await;
            if let ReaderEvent::Sample(sample) = heard
                && let Some(state) = self.reply(&sample)
            {
                return state;
            }
        }
    }

    fn reply(&self, sample: &RawSample) -> Option<u8> {
        let (body, endian) = sample.body.as_ref().ok()?;
        let (correlation, state) = lifecycle::reply(body, *endian, &sample.writer)?;
        let is_ours = match correlation {
            Correlation::Header { client, sequence } => (client, sequence) == (self.id, self.sequence),
            Correlation::Sample => sample.related.is_some_and(|related| {
                prefix(&related.writer) == prefix(&self.participant.guid())
                    && related.sequence == self.sequence
            }),
        };
        is_ours.then_some(state)
    }
}
