//! The differences between two moments of a recording, or between two snapshots of one vehicle.

use std::collections::BTreeMap;

use serde::Serialize;

use telltale_engine::model::NodeId;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::state::State;
use telltale_record::why::Why;

/// Nodes that are listed, the worst first. Further ones are counted.
const NODES_MAX: usize = 500;
/// The most nodes that are listed because they differ in values alone.
const VALUED_MAX: usize = 100;
/// Values of one node that are listed.
const VALUES_MAX: usize = 24;
/// Root causes that are named.
const CAUSES_MAX: usize = 8;

/// The differences, from the first moment to the second one.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Differences {
    /// Of the vehicle.
    pub vehicle: Vec<VehicleChange>,
    /// Of its nodes, the worst first.
    pub nodes: Vec<NodeChange>,
    pub more_nodes: usize,
    /// Nodes that are the same but for their values.
    pub only_values: usize,
    /// The first of them, by name.
    pub valued: Vec<NodeChange>,
}

/// A fact of the vehicle in both moments.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct VehicleChange {
    pub what: Fact,
    /// The name of a signal.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub name: String,
    pub first: String,
    pub second: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fact {
    /// The word of the stage.
    Stage,
    /// The word of the state of the vehicle.
    Overall,
    /// Whole km/h; empty while unknown.
    SpeedKmh,
    /// The names of the root causes.
    Roots,
    /// The words of the requests to the vehicle.
    Requests,
    /// `true`, `false` or `unknown`.
    Signal,
}

/// A node in both moments.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NodeChange {
    pub node: String,
    /// `None`: it was not known then.
    pub first: Option<NodeThen>,
    pub second: Option<NodeThen>,
    /// Values that differ, by name.
    pub values: Vec<ValueChange>,
    pub more_values: usize,
}

/// A value in both moments; `None`: it was not there.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ValueChange {
    pub name: String,
    pub first: Option<String>,
    pub second: Option<String>,
}

/// A node at one moment.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct NodeThen {
    pub shown: &'static str,
    /// As if nothing were masked.
    pub own: &'static str,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub masked_by: Vec<String>,
    #[serde(skip_serializing_if = "String::is_empty")]
    pub message: String,
}

impl Differences {
    pub fn between(first: &Snapshot, second: &Snapshot) -> Differences {
        let (before, after) = (nodes(first), nodes(second));
        let mut names: Vec<&str> = before.keys().chain(after.keys()).copied().collect();
        names.sort_unstable();
        names.dedup();
        let (mut only_values, mut valued) = (0, Vec::new());
        let mut changed: Vec<((u8, &str), NodeChange)> = Vec::new();
        for name in names {
            let (old, new) = (before.get(name).copied(), after.get(name).copied());
            let (then, now) = (old.map(|node| at(first, node)), new.map(|node| at(second, node)));
            let (values, more_values) = changed_values(old.map(|it| (first, it)), new.map(|it| (second, it)));
            if then == now {
                if !values.is_empty() {
                    only_values += 1;
                    if valued.len() < VALUED_MAX {
                        let node = name.to_owned();
                        valued.push(NodeChange { node, first: then, second: now, values, more_values });
                    }
                }
                continue;
            }
            let urgency = |node: Option<NodeId>, of: &Snapshot| node.map_or(0, |node| rank(of.shown(node).0));
            let worst = urgency(old, first).max(urgency(new, second));
            let node = name.to_owned();
            changed.push((
                (4 - worst, name),
                NodeChange { node, first: then, second: now, values, more_values },
            ));
        }
        changed.sort_by_key(|(order, _)| *order);
        let more_nodes = changed.len().saturating_sub(NODES_MAX);
        Differences {
            vehicle: vehicle(first, second),
            nodes: changed.into_iter().take(NODES_MAX).map(|(_, node)| node).collect(),
            more_nodes,
            only_values,
            valued,
        }
    }
}

/// The shown order: what asks for somebody first.
const fn rank(state: State) -> u8 {
    match state {
        State::Error => 4,
        State::Unknown => 3,
        State::Warning => 2,
        State::Ignore => 1,
        State::Ok => 0,
    }
}

fn nodes(snapshot: &Snapshot) -> BTreeMap<&str, NodeId> {
    let groups =
        (0..snapshot.layout.groups.len() as u32).map(|id| NodeId::Group(telltale_engine::model::GroupId(id)));
    let nodes = groups.chain(snapshot.module_ids().map(NodeId::Module));
    nodes.map(|node| (&**snapshot.node_name(node), node)).collect()
}

fn at(snapshot: &Snapshot, node: NodeId) -> NodeThen {
    let (shown, reason) = snapshot.shown(node);
    let masked_by = match reason.map(|reason| Why::of(reason, snapshot, CAUSES_MAX)) {
        Some(Why::Masked { by }) => by.into_iter().map(str::to_owned).collect(),
        _ => Vec::new(),
    };
    let message = match node {
        NodeId::Module(id) => snapshot.module(id).1.report.message.to_string(),
        NodeId::Group(_) => String::new(),
    };
    NodeThen { shown: shown.as_str(), own: snapshot.own(node).as_str(), masked_by, message }
}

type Of<'a> = Option<(&'a Snapshot, NodeId)>;

/// The values that differ, by name, and how many more do.
fn changed_values(first: Of<'_>, second: Of<'_>) -> (Vec<ValueChange>, usize) {
    let values = |of: Of<'_>| -> BTreeMap<String, String> {
        match of {
            Some((snapshot, NodeId::Module(id))) => {
                let report = &snapshot.module(id).1.report;
                report.values.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect()
            }
            _ => BTreeMap::new(),
        }
    };
    let (mut before, after) = (values(first), values(second));
    let mut changed: Vec<ValueChange> = Vec::new();
    for (name, value) in after {
        let first = before.remove(&name);
        if first.as_ref() != Some(&value) {
            changed.push(ValueChange { name, first, second: Some(value) });
        }
    }
    let gone = |(name, old)| ValueChange { name, first: Some(old), second: None };
    changed.extend(before.into_iter().map(gone));
    let more = changed.len().saturating_sub(VALUES_MAX);
    changed.truncate(VALUES_MAX);
    (changed, more)
}

fn vehicle(first: &Snapshot, second: &Snapshot) -> Vec<VehicleChange> {
    let facts = |of: &Snapshot| -> BTreeMap<(Fact, String), String> {
        let roots = of.roots.iter().take(CAUSES_MAX).map(|root| &**of.node_name(root.node));
        let requests = of.countermeasures.iter().map(|it| it.request.kind().as_str());
        let mut facts = BTreeMap::from([
            ((Fact::Stage, String::new()), of.stage.as_str().to_owned()),
            ((Fact::Overall, String::new()), of.overall.as_str().to_owned()),
            ((Fact::SpeedKmh, String::new()), of.motion.speed_kmh.map_or(String::new(), |it| it.to_string())),
            ((Fact::Roots, String::new()), roots.collect::<Vec<_>>().join(", ")),
            ((Fact::Requests, String::new()), requests.collect::<Vec<_>>().join(", ")),
        ]);
        for (name, value) in of.signals.iter() {
            let value = value.map_or("unknown".to_owned(), |value| value.to_string());
            facts.insert((Fact::Signal, name.to_string()), value);
        }
        facts
    };
    let (mut before, after) = (facts(first), facts(second));
    let mut changed = Vec::new();
    for ((what, name), second) in after {
        let first = before.remove(&(what, name.clone())).unwrap_or_default();
        if first != second {
            changed.push(VehicleChange { what, name, first, second });
        }
    }
    let gone = |((what, name), first)| VehicleChange { what, name, first, second: String::new() };
    changed.extend(before.into_iter().map(gone));
    changed
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use telltale_engine::Engine;
    use telltale_engine::input::{Input, StatusArray};
    use telltale_engine::model::{Model, Other, Parts, StageModel};
    use telltale_engine::time::Timestamp;

    fn said(engine: &mut Engine, at_s: u64, name: &str, level: u8, value: &str) -> Arc<Snapshot> {
        let mut array = StatusArray::default();
        array.push_status(level, name, "as it is", "");
        array.push_value("hz", value);
        engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(at_s * 1000));
        engine.snapshot()
    }

    #[test]
    fn a_failure_its_value_and_what_is_new_differ_and_the_rest_does_not() {
        let parts = Parts { other: Other::Counted, ..Parts::empty("v", StageModel::None) };
        let mut engine = Engine::begin(Arc::new(Model::new(parts).unwrap()), Timestamp::ZERO);
        said(&mut engine, 1, "calm", 0, "1");
        let first = said(&mut engine, 1, "pump", 0, "10");
        said(&mut engine, 2, "late", 0, "3");
        said(&mut engine, 2, "calm", 0, "2");
        let second = said(&mut engine, 2, "pump", 2, "0");
        let found = Differences::between(&first, &second);
        let names: Vec<&str> = found.nodes.iter().map(|it| &*it.node).collect();
        assert_eq!(names, ["other", "other/pump", "other/late"]);
        assert_eq!((found.only_values, found.more_nodes), (1, 0));
        assert_eq!((&*found.valued[0].node, &*found.valued[0].values[0].name), ("other/calm", "hz"));
        let pump = &found.nodes[1];
        let (before, after) = (Some("10".to_owned()), Some("0".to_owned()));
        assert_eq!(pump.values, [ValueChange { name: "hz".to_owned(), first: before, second: after }]);
        let shown = |then: &Option<NodeThen>| then.as_ref().map(|then| then.shown);
        assert_eq!((shown(&pump.first), shown(&pump.second)), (Some("ok"), Some("error")));
        assert_eq!(shown(&found.nodes[2].first), None);
        let facts: Vec<Fact> = found.vehicle.iter().map(|it| it.what).collect();
        assert_eq!(facts, [Fact::Overall, Fact::Roots]);
        let same = Differences::between(&second, &second);
        assert!(same.nodes.is_empty() && same.vehicle.is_empty() && same.only_values == 0);
    }
}
