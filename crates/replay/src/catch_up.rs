//! The changes between the state before a gap of a recording and the recorded state behind it. Their instants are not
//! known.

use std::collections::BTreeMap;

use telltale_engine::event::{Event, EventKind};
use telltale_engine::model::NodeId;
use telltale_engine::snapshot::{Alarm, Reason, Snapshot};

/// The changes from what was shown before to this state, all at its instant.
pub(super) fn changes(before: &Snapshot, after: &Snapshot) -> Vec<Event> {
    let mut found = Vec::new();
    if after.has_stages() && before.stage != after.stage {
        found.push(EventKind::Stage { from: before.stage, to: after.stage });
    }
    let signals = after.signals.iter().enumerate().filter(|(_, signal)| !before.signals.contains(signal));
    found.extend(signals.map(|(index, (_, value))| EventKind::Signal { index, value: *value }));
    let known: BTreeMap<&str, NodeId> =
        before.nodes().map(|node| (&**before.node_name(node), node)).collect();
    for node in after.nodes() {
        let Some(&old) = known.get(&**after.node_name(node)) else { continue };
        let (from, was_because) = before.shown(old);
        let (to, because) = after.shown(node);
        let cause = first_cause(because);
        let name_of_cause = cause.map(|cause| after.node_name(cause));
        let was_caused = first_cause(was_because).map(|cause| before.node_name(cause));
        let own = after.own(node);
        if (from, before.own(old), was_caused) != (to, own, name_of_cause) {
            let said = match node {
                NodeId::Module(id) => after.module(id).1.said(after.now),
                NodeId::Group(_) => None,
            };
            found.push(EventKind::Shown { node, from, to, own, cause, said, began: None });
        }
    }
    let gone = known.into_keys().filter(|name| after.node(name).is_none());
    found.extend(gone.map(|name| EventKind::Left { node: name.into() }));
    found.extend(alarms(before, after));
    found.into_iter().map(|what| Event { at: after.now, what }).collect()
}

fn first_cause(reason: Option<&Reason>) -> Option<NodeId> {
    match reason {
        Some(Reason::Masked { by }) => by.first().copied(),
        Some(Reason::NotRelevant(_)) | None => None,
    }
}

/// Alarms whose nodes are there in the later state: the others have no name in it.
fn alarms(before: &Snapshot, after: &Snapshot) -> Vec<EventKind> {
    let old = |alarm: &Alarm| {
        let name = after.node_name(alarm.node);
        before.alarms.iter().find(|old| old.id == alarm.id && before.node_name(old.node) == name)
    };
    let mut found = Vec::new();
    for alarm in after.alarms.iter() {
        let (id, node) = (alarm.id, alarm.node);
        match old(alarm) {
            None if alarm.active => found.push(EventKind::AlarmRaised { id, node }),
            Some(old) if old.active && !alarm.active => found.push(EventKind::AlarmCleared { id, node }),
            _ => {}
        }
        if alarm.acknowledged && old(alarm).is_some_and(|old| !old.acknowledged) {
            found.push(EventKind::AlarmAcknowledged { id, node });
        }
    }
    // Alarms that were only raised because something is missing.
    for alarm in before.alarms.iter().filter(|alarm| alarm.active) {
        let node = after.node(before.node_name(alarm.node));
        let is_kept = after.alarms.iter().any(|new| old(new).is_some_and(|old| old.id == alarm.id));
        if let Some(node) = node.filter(|_| !is_kept) {
            found.push(EventKind::AlarmCleared { id: alarm.id, node });
        }
    }
    found
}
