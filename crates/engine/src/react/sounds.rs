//! The alarms that sound: one sound for each fault as an operator sees it.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use crate::model::NodeId;
use crate::snapshot::{Alarm, Snapshot};
use crate::time::{Span, Timestamp};

/// Alarms of one component within this time have one sound.
const ONE_SOUND: Span = Span::from_secs(5);

impl Snapshot {
    /// The numbers of the audible alarms among the active, unacknowledged ones: the oldest of each component,
    /// and each one raised long after the sound before it. One fault often shows in several modules of a
    /// component at nearly the same time. If one status raises alarms in several components at once, only the
    /// first number sounds.
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
        let mut sounded: BTreeMap<NodeId, Timestamp> = BTreeMap::new();
        let mut numbers: Vec<u64> = Vec::new();
        for alarm in self.alarms.iter().filter(|alarm| alarm.active && !alarm.acknowledged) {
            let component = self.component(alarm.node);
            let is_late = sounded.get(&component).is_none_or(|&before| alarm.raised >= before + ONE_SOUND);
            let number = first(alarm);
            if is_late && !numbers.contains(&number) {
                sounded.insert(component, alarm.raised);
                numbers.push(number);
            }
        }
        numbers
    }

    /// The status of a module.
    pub fn status_of(&self, node: NodeId) -> Option<&Arc<str>> {
        match node {
            NodeId::Module(id) => self.layout.modules.get(id.0 as usize)?.status.as_ref(),
            NodeId::Group(_) => None,
        }
    }

    /// A node, and the modules of other groups with the same status: for an operator they are one fault.
    pub fn places_of(&self, node: NodeId) -> Vec<NodeId> {
        let Some(status) = self.status_of(node) else { return vec![node] };
        let modules = self.module_ids().map(NodeId::Module);
        let others = modules.filter(|&it| it != node && self.status_of(it) == Some(status));
        std::iter::once(node).chain(others).collect()
    }

    /// The tile of a node; without one, the node itself.
    fn component(&self, node: NodeId) -> NodeId {
        let group = self.layout.outermost(node);
        if self.group(group).0.is_tile() { NodeId::Group(group) } else { node }
    }
}

impl Alarm {
    /// Whether both were active at the same time.
    pub fn overlaps(&self, other: &Alarm) -> bool {
        let lasts = |it: &Alarm, until: &Alarm| it.ended.is_none_or(|ended| ended >= until.raised);
        lasts(self, other) && lasts(other, self)
    }
}
