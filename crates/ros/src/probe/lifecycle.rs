//! Watchdogs of lifecycle nodes: calls `get_state` of each again and again. Nothing else of a node is called.

use std::collections::{BTreeMap, BTreeSet};
use std::future::poll_fn;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use futures_util::FutureExt as _;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;

use super::EVERY_MIN;
use crate::discovery::graph::service_topics;
use crate::discovery::nodes::Nodes;
use crate::engine_queue::stopped;
use crate::every;
use crate::transport::ids::prefix;
use crate::transport::quality::Via;
use crate::transport::{Participant, Quality, RawSample, Reader, ReaderEvent, SampleId, Writer};
use telltale_clock::Clock;
use telltale_engine::input::Input;
use telltale_engine::model::monitors::{ProbeTarget, WatchdogSpec};
use telltale_engine::model::sample::{Probe, ProbeOutcome};
use telltale_msg::lifecycle::{self, GET_STATE};
use telltale_msg::received::Stamped;
use telltale_msg::sample_bytes::Guid;
use telltale_msg::services::Correlation;
use telltale_msg::subscription::Plan;

/// Replies that the library keeps. Those to other clients come too.
const DEPTH: usize = 16;

/// Replies that are passed over before a call; in a flood the rest is passed over after it.
const PASSED_OVER_MAX: usize = 10_000;

/// Clients of this process so far: each has a number of its own.
static CLIENTS: AtomicU64 = AtomicU64::new(0);

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
    let period = Duration::from(spec.every).max(EVERY_MIN);
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
    reply_topic: String,
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
        let own = prefix(&participant.guid()).last_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
        let id = own.wrapping_add(CLIENTS.fetch_add(1, Ordering::Relaxed));
        Client {
            requests: participant.writer(&request_topic, &requests, Quality::Command),
            replies: participant.reader(&reply_topic, &replies, Via::Reliable, DEPTH),
            participant,
            nodes,
            clock,
            service,
            request_topic,
            reply_topic,
            id,
            sequence: 0,
        }
    }

    /// Calls once. The first call can be lost although the service was seen: the next one is not. Of several nodes with this
    /// name the one in the worst state counts; one that does not answer beside another may have been started again.
    async fn ask(&mut self, patience: Duration) -> ProbeOutcome {
        let start = self.clock.now();
        let known = self.nodes.borrow().ask_service(&self.service, start);
        if known != ProbeOutcome::Announced {
            return known;
        }
        let servers = self.servers();
        let Some(form) = servers.iter().max_by_key(|server| lifecycle::has_header(server)) else {
            return ProbeOutcome::Impossible("its service is being discovered still".into());
        };
        let own = self.requests.guid().await;
        // What came since the last call replies to others, or too late.
        for _ in 0..PASSED_OVER_MAX {
            if poll_fn(|context| self.replies.poll(context)).now_or_never().is_none() {
                break;
            }
        }
        self.sequence += 1;
        let request = lifecycle::request(form, self.id, self.sequence);
        if let Err(error) = self.requests.write(request).await {
            return ProbeOutcome::Impossible(error.into());
        }
        let (mut states, mut after) = (BTreeMap::new(), None);
        let all = async {
            while states.len() < servers.len() {
                let (server, state) = self.state(&own).await;
                states.insert(server, state);
                after = Some(self.clock.now().since(start));
            }
        };
        // The states until then count.
        let _ = tokio::time::timeout(patience, all).await;
        match (states.values().find(|state| **state != lifecycle::ACTIVE), after) {
            (Some(state), _) => ProbeOutcome::Inactive { state: lifecycle::state_name(*state).into() },
            (None, Some(after)) => ProbeOutcome::Answered { after },
            (None, None) => ProbeOutcome::Missed(format!("no answer within {patience:?}").into()),
        }
    }

    /// The readers of requests whose participants write replies too. Others only listen.
    fn servers(&self) -> BTreeSet<Guid> {
        let seen = self.participant.seen();
        let replying: BTreeSet<_> = seen.writers_of(&self.reply_topic).map(|it| prefix(&it.guid)).collect();
        let readers = seen.readers_of(&self.request_topic).map(|it| it.guid);
        readers.filter(|reader| replying.contains(&prefix(reader))).collect()
    }

    /// The state in a reply to the last request, and the writer of that reply. Replies to other clients and to earlier
    /// requests are passed over.
    async fn state(&mut self, own: &Guid) -> (Guid, u8) {
        loop {
            let heard = poll_fn(|context| self.replies.poll(context)).await;
            if let ReaderEvent::Sample(sample) = heard
                && let Some(state) = self.reply(&sample, own)
            {
                return (sample.writer, state);
            }
        }
    }

    /// The state in this sample, if it replies to the last request, which the writer `own` wrote.
    fn reply(&self, sample: &RawSample, own: &Guid) -> Option<u8> {
        let (body, endian) = sample.body.as_ref().ok()?;
        let (correlation, state) = lifecycle::reply(body, *endian, &sample.writer)?;
        let is_ours = match correlation {
            Correlation::Header { client, sequence } => (client, sequence) == (self.id, self.sequence),
            Correlation::Sample => sample.related == Some(SampleId { writer: *own, sequence: self.sequence }),
        };
        is_ours.then_some(state)
    }
}
