//! Announces Telltale's node in the ROS 2 graph, so that `ros2 node list` shows it, and follows the
//! announcements of other nodes.
//!
//! Nothing is announced before the size of a gid is known: an announcement of the wrong size makes other
//! processes throw.

use crate::every;
use crate::transport::NODES_TOPIC;
use std::collections::BTreeSet;
use std::future::poll_fn;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;

use super::nodes::{self, Nodes};
use crate::engine_queue::stopped;
use crate::transport::quality::Via;
use crate::transport::{Participant, Quality, ReaderEvent, Seen, Writer};
use telltale_clock::Clock;
use telltale_msg::cdr::Endian;
use telltale_msg::messages::{self, GidSize, NodeEntities, PARTICIPANT_ENTITIES_INFO};
use telltale_msg::sample_bytes::Guid;
use telltale_msg::subscription::Plan;

/// Samples of the topic that the library keeps: one for each participant, in case all announce at once.
const DEPTH: usize = 512;
/// How often nodes are removed whose participants are gone.
const LOOK: Duration = Duration::from_secs(1);

pub struct PresenceContext {
    pub nodes: watch::Sender<Nodes>,
    /// The size of a gid, as soon as it is known.
    pub gid_size: watch::Sender<Option<GidSize>>,
    pub clock: Clock,
    /// Our node's name in the graph.
    pub node: String,
    pub plan: watch::Receiver<Arc<Plan>>,
}

/// Announces our node and follows other nodes until it is stopped.
pub async fn run(participant: Participant, around: PresenceContext, mut stop: watch::Receiver<bool>) {
    around.nodes.send_replace(Nodes::new(around.clock.now()));
    let nodes = &around.nodes;
    tokio::select! {
        () = stopped(&mut stop) => {}
        () = announce(&participant, &around.node, around.gid_size.subscribe(), nodes) => {}
        () = listen(&participant, &around, nodes) => {}
    }
    around.nodes.send_replace(Nodes::default());
}

/// A writer of announcements. It keeps the last one for late joiners, as every rmw does.
pub fn announcer(participant: &Participant) -> Writer {
    participant.writer(NODES_TOPIC, &type_name(), Quality::LastValue)
}

/// Without end.
async fn announce(
    participant: &Participant,
    node: &str,
    mut size: watch::Receiver<Option<GidSize>>,
    nodes: &watch::Sender<Nodes>,
) {
    let writer = announcer(participant);
    let mut own_readers = participant.own_readers();
    let known = size.wait_for(Option::is_some).await.ok().and_then(|size| *size);
    let Some(size) = known else { return std::future::pending().await };
    let own = writer.guid().await;
    loop {
        let readers: Vec<Guid> = own_readers.borrow_and_update().iter().copied().collect();
        let node = NodeEntities { name: node, readers: &readers, writers: &[] };
        let body = messages::encode_nodes(participant.guid(), &[node], size);
        // Not every network lets a participant hear itself.
        nodes.send_modify(|nodes| nodes.announce(own, &body, Endian::Little, Some(size)));
        if let Err(error) = writer.write(body).await {
            tracing::warn!("the node was not announced to ROS 2: {error}");
        }
        if own_readers.changed().await.is_err() {
            // Nothing changes any more; the writer keeps the last announcement for late joiners.
            return std::future::pending().await;
        }
    }
}

/// Takes the announcements of other participants, for ever. The first tells the size of a gid, if it is not
/// known.
async fn listen(participant: &Participant, around: &PresenceContext, nodes: &watch::Sender<Nodes>) {
    let learn = &around.gid_size;
    let mut plan = around.plan.clone();
    plan.mark_changed();
    let mut reader = participant.reader(NODES_TOPIC, &type_name(), Via::LastValue, DEPTH);
    let mut looks = every(LOOK);
    loop {
        tokio::select! {
            biased;
            Ok(()) = plan.changed() => {
                let named = plan.borrow_and_update().nodes.clone();
                nodes.send_modify(|nodes| nodes.keep_places(named));
            }
            _ = looks.tick() => {
                let (guids, services) = seen(&participant.seen());
                let is_searching = participant.is_searching();
                nodes.send_modify(|nodes| {
                    nodes.update(&participant.guid(), guids, services);
                    if is_searching {
                        nodes.search_on(around.clock.now());
                    }
                });
            }
            heard = poll_fn(|context| reader.poll(context)) => {
                let ReaderEvent::Sample(sample) = heard else { continue };
                let Ok((body, endian)) = sample.body else { continue };
                learn.send_if_modified(|size| {
                    let known = size.is_some();
                    *size = size.or_else(|| GidSize::of_message(&body, endian));
                    size.is_some() && !known
                });
                let size = *learn.borrow();
                nodes.send_modify(|nodes| nodes.announce(sample.writer, &body, endian, size));
            }
        }
    }
}

/// The writers of announcements that discovery knows, and the services that a node serves.
fn seen(seen: &Seen) -> (BTreeSet<Guid>, BTreeSet<Box<str>>) {
    let announcing = seen.writers_of(NODES_TOPIC).map(|writer| writer.guid).collect();
    let readers = seen.readers().map(|reader| (&*reader.topic, reader.guid));
    let writers = seen.writers().map(|writer| (&*writer.topic, writer.guid));
    (announcing, nodes::services(readers, writers))
}

/// A name with three parts always has a name on the wire.
fn type_name() -> String {
    messages::dds_type_name(PARTICIPANT_ENTITIES_INFO).unwrap_or_default()
}
