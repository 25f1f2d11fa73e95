//! What a vehicle tells of itself, from the engine's snapshots: the head, keyframes, changes and alarms. Nobody's name
//! is in it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use telltale_engine::model::{NodeId, Stage};
use telltale_engine::snapshot::{Reason, Snapshot};
use telltale_engine::state::State;
use telltale_engine::time::Timestamp;

use crate::message::{Alarm, Cause, Content, Head, Node, NodeStates};

/// Characters of a node's words; the rest is cut.
pub const WORDS_CHARS_MAX: usize = 200;

/// The nodes of one message. A larger change takes several.
const NODES_MAX: usize = 2000;

/// What was told last, so that only changes follow.
#[derive(Debug, Default)]
pub struct Teller {
    /// The number of the snapshot's states that were told.
    seq: Option<u64>,
    stage: Option<Stage>,
    nodes: BTreeMap<Arc<str>, Shown>,
    alarms: BTreeMap<u64, (bool, bool)>,
    overall: Option<(State, Timestamp)>,
}

/// A change of this is news. Words alone are none: many hold a measured value.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Shown {
    state: State,
    own: State,
    cause: Option<Arc<str>>,
}

impl Teller {
    /// The states of all nodes. Changes count from here on.
    pub fn keyframe(&mut self, snapshot: &Snapshot) -> Vec<Content> {
        self.nodes.clear();
        self.stage = None;
        self.seq = None;
        let changed = self.changed(snapshot);
        self.note(snapshot);
        let mut parts = parts(snapshot.stage, changed).into_iter();
        let first = parts.next().unwrap_or(NodeStates { stage: snapshot.stage, nodes: Vec::new() });
        [Content::Keyframe(first)].into_iter().chain(parts.map(Content::Delta)).collect()
    }

    /// Alarms that are new or changed, then nodes that show something else than what was told.
    pub fn changes(&mut self, snapshot: &Snapshot) -> Vec<Content> {
        if !self.has_news(snapshot) {
            return Vec::new();
        }
        let mut news: Vec<Content> = self.changed_alarms(snapshot).into_iter().map(Content::Alarm).collect();
        let is_new_stage = self.stage != Some(snapshot.stage);
        let mut nodes = self.changed(snapshot);
        let here: BTreeSet<&Arc<str>> = snapshot.nodes().map(|node| snapshot.node_name(node)).collect();
        let gone: Vec<Arc<str>> = self.nodes.keys().filter(|name| !here.contains(name)).cloned().collect();
        for name in gone {
            self.nodes.remove(&name);
            nodes.push(Node {
                node: name.to_string(),
                state: State::Unknown,
                own: State::Unknown,
                cause: None,
                words: String::new(),
                gone: true,
            });
        }
        self.note(snapshot);
        let mut parts = parts(snapshot.stage, nodes);
        if parts.is_empty() && is_new_stage {
            parts.push(NodeStates { stage: snapshot.stage, nodes: Vec::new() });
        }
        news.extend(parts.into_iter().map(Content::Delta));
        news
    }

    /// Whether the states differ from what was told.
    pub fn has_news(&self, snapshot: &Snapshot) -> bool {
        self.seq != Some(snapshot.seq)
    }

    fn note(&mut self, snapshot: &Snapshot) {
        self.seq = Some(snapshot.seq);
        self.stage = Some(snapshot.stage);
    }

    fn changed(&mut self, snapshot: &Snapshot) -> Vec<Node> {
        let mut changed = Vec::new();
        for node in snapshot.nodes() {
            let (state, reason) = snapshot.shown(node);
            let cause = match reason {
                Some(Reason::Masked { by }) => by.first().map(|&cause| snapshot.node_name(cause).clone()),
                Some(Reason::NotRelevant(_)) | None => None,
            };
            let shown = Shown { state, own: snapshot.own(node), cause };
            let name = snapshot.node_name(node);
            if self.nodes.get(name) == Some(&shown) {
                continue;
            }
            changed.push(Node {
                node: name.to_string(),
                state,
                own: shown.own,
                cause: shown.cause.as_deref().map(str::to_owned),
                words: words(snapshot, node),
                gone: false,
            });
            self.nodes.insert(name.clone(), shown);
        }
        changed
    }

    fn changed_alarms(&mut self, snapshot: &Snapshot) -> Vec<Alarm> {
        let mut changed = Vec::new();
        for alarm in snapshot.alarms.iter() {
            let now = (alarm.active, alarm.acknowledged);
            if self.alarms.insert(alarm.id, now) != Some(now) {
                changed.push(Alarm {
                    number: alarm.id,
                    node: snapshot.node_name(alarm.node).to_string(),
                    active: alarm.active,
                    acknowledged: alarm.acknowledged,
                    words: words(snapshot, alarm.node),
                });
            }
        }
        let is_open = |number: &u64| snapshot.alarms.iter().any(|alarm| alarm.id == *number);
        let over: Vec<u64> = self.alarms.keys().filter(|number| !is_open(number)).copied().collect();
        for number in over {
            self.alarms.remove(&number);
            let (node, words) = (String::new(), String::new());
            changed.push(Alarm { number, node, active: false, acknowledged: true, words });
        }
        changed
    }

    /// The vehicle in one line, without what the caller knows better.
    pub fn head(&mut self, snapshot: &Snapshot, unix_ms: impl Fn(Timestamp) -> i64) -> Head {
        let since = match self.overall {
            Some((state, since)) if state == snapshot.overall => since,
            _ => snapshot.now,
        };
        self.overall = Some((snapshot.overall, since));
        // A WARNING is no root cause.
        let worst = || {
            let is_worst = |node: &NodeId| {
                matches!(node, NodeId::Module(_)) && snapshot.shown(*node).0 == snapshot.overall
            };
            (snapshot.overall > State::Ok).then(|| snapshot.nodes().find(is_worst)).flatten()
        };
        let cause = snapshot.roots.first().map(|root| root.node).or_else(worst);
        Head {
            name: snapshot.layout.vehicle_name.en.to_string(),
            state: snapshot.overall,
            cause: cause.map(|node| Cause {
                node: snapshot.node_name(node).to_string(),
                words: words(snapshot, node),
            }),
            since: unix_ms(since),
            stage: snapshot.stage,
            drives: snapshot.drives(),
            speed_kmh: snapshot.motion.speed_kmh,
            unacknowledged: snapshot.alarms.iter().filter(|it| !it.acknowledged).count() as u32,
            version: String::new(),
            config: String::new(),
            last: 0,
            ending: false,
        }
    }
}

/// Whether a head says something else than the one before, beyond figures that always change.
pub fn is_news(head: &Head, before: &Head) -> bool {
    let node = |head: &Head| head.cause.as_ref().map(|cause| cause.node.clone());
    (head.state, head.stage, head.unacknowledged, head.ending, node(head))
        != (before.state, before.stage, before.unacknowledged, before.ending, node(before))
        || head.config != before.config
}

fn parts(stage: Stage, nodes: Vec<Node>) -> Vec<NodeStates> {
    nodes.chunks(NODES_MAX).map(|nodes| NodeStates { stage, nodes: nodes.to_vec() }).collect()
}

/// What a node that is not OK says.
fn words(snapshot: &Snapshot, node: NodeId) -> String {
    match node {
        NodeId::Module(id) if snapshot.own(node) != State::Ok => {
            snapshot.module(id).1.report.message.chars().take(WORDS_CHARS_MAX).collect()
        }
        NodeId::Module(_) | NodeId::Group(_) => String::new(),
    }
}
