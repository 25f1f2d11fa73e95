//! Which alarms sound: one call for each fault as an operator sees it.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use crate::engine::model::NodeId;
use crate::engine::snapshot::{Alarm, Snapshot};
use crate::engine::time::{Span, Timestamp};

/// What a component raises within this time is one call.
const ONE_CALL: Span = Span::from_secs(5);

impl Snapshot {
    /// The numbers of the alarms that call by a sound, of those that are there and not acknowledged:
    /// of each component the oldest, and each that comes when the call before it is long over. One
    /// fault often shows in several modules of a component at nearly the same time. What one status
    /// raises in several components at once is one call, with the first number of it.
    pub fn audible(&self) -> Vec<u64> {
        let mut by_status: HashMap<&str, Vec<&Alarm>> = HashMap::new();
        for alarm in self.alarms.iter().filter(|alarm| !alarm.acknowledged) {
            if let Some(status) = self.status_of(alarm.node) {
                by_status.entry(status).or_default().push(alarm);
            }
        }
        let first = |alarm: &Alarm| {
            let same = self.status_of(alarm.node).and_then(|status| by_status.get(&**status));
            let others = same.into_iter().flatten().filter(|it| it.node != alarm.node && it.overlaps(alarm));
            others.map(|it| it.id).fold(alarm.id, u64::min)
        };
        let mut called: BTreeMap<NodeId, Timestamp> = BTreeMap::new();
        let mut numbers: Vec<u64> = Vec::new();
        for alarm in self.alarms.iter().filter(|alarm| alarm.active && !alarm.acknowledged) {
            let component = self.component(alarm.node);
            let is_late = called.get(&component).is_none_or(|&before| alarm.raised >= before + ONE_CALL);
            let number = first(alarm);
            if is_late && !numbers.contains(&number) {
                called.insert(component, alarm.raised);
                numbers.push(number);
            }
        }
        numbers
    }

    /// The status that a module takes.
    pub fn status_of(&self, node: NodeId) -> Option<&Arc<str>> {
        match node {
            NodeId::Module(id) => self.layout.modules.get(id.0 as usize)?.status.as_ref(),
            NodeId::Group(_) => None,
        }
    }

    /// A node, and the modules in other groups that the same status feeds: to an operator they are one.
    pub fn places_of(&self, node: NodeId) -> Vec<NodeId> {
        let Some(status) = self.status_of(node) else { return vec![node] };
        let modules = self.module_ids().map(NodeId::Module);
        let others = modules.filter(|&it| it != node && self.status_of(it) == Some(status));
        std::iter::once(node).chain(others).collect()
    }

    /// The tile that a node belongs to; what belongs to none stands for itself.
    fn component(&self, node: NodeId) -> NodeId {
        let mut group = match node {
            NodeId::Group(id) => id,
            NodeId::Module(id) => self.module(id).0.group,
        };
        while let Some(parent) = self.group(group).0.parent {
            group = parent;
        }
        if self.group(group).0.is_tile() { NodeId::Group(group) } else { node }
    }
}

impl Alarm {
    /// Whether both were there at one time.
    pub fn overlaps(&self, other: &Alarm) -> bool {
        let lasts = |it: &Alarm, until: &Alarm| it.ended.is_none_or(|ended| ended >= until.raised);
        lasts(self, other) && lasts(other, self)
    }
}
