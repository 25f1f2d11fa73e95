//! A snapshot as the tools of ROS 2 for aggregated diagnostics expect it (rqt_robot_monitor and its
//! kin): one status for each node of the tree, named by its path, a group before its members.

use crate::engine::input::StatusArray;
use crate::engine::model::{GroupId, ModuleId, Stage};
use crate::engine::snapshot::{NotRelevant, Reason, Snapshot};
use crate::engine::state::State;

/// The tree of the vehicle. Before a login it says nothing of what modules report.
pub fn tree(snapshot: &Snapshot) -> StatusArray {
    let mut out = StatusArray::default();
    let root = part(&snapshot.layout.vehicle_name.en);
    let tops: Vec<GroupId> = (0..snapshot.layout.groups.len() as u32)
        .map(GroupId)
        .filter(|&id| snapshot.group(id).0.parent.is_none())
        .collect();
    out.push_status(level(snapshot.overall), &format!("/{root}"), word(snapshot.overall), "");
    for &id in &tops {
        let (info, view) = snapshot.group(id);
        out.push_value(&part(&info.name.en), word(view.state));
    }
    for id in tops {
        group(snapshot, id, &format!("/{root}"), &mut out);
    }
    out
}

/// The worst of the whole, in one status.
pub fn top(snapshot: &Snapshot) -> StatusArray {
    let mut out = StatusArray::default();
    out.push_status(level(snapshot.overall), "toplevel_state", word(snapshot.overall), "");
    out.push_value("telltale_state", snapshot.overall.as_str());
    out.push_value("stage", snapshot.stage.as_str());
    out
}

fn group(snapshot: &Snapshot, id: GroupId, above: &str, out: &mut StatusArray) {
    let (info, view) = snapshot.group(id);
    let path = format!("{above}/{}", part(&info.name.en));
    let said = message(snapshot, view.state, view.reason.as_ref(), "");
    out.push_status(level(view.state), &path, &said, "");
    for &inner in &info.groups {
        let (info, view) = snapshot.group(inner);
        out.push_value(&part(&info.name.en), word(view.state));
    }
    for &module in &info.modules {
        out.push_value(&module_part(snapshot, module), word(snapshot.module(module).1.state));
    }
    own_values(snapshot, view.state, view.own, out);
    for &inner in &info.groups {
        group(snapshot, inner, &path, out);
    }
    for &module in &info.modules {
        let (_, view) = snapshot.module(module);
        let said = if snapshot.stage == Stage::Locked { "" } else { &view.report.message };
        let said = message(snapshot, view.state, view.reason.as_ref(), said);
        let name = format!("{path}/{}", module_part(snapshot, module));
        out.push_status(level(view.state), &name, &said, &view.report.hardware_id);
        own_values(snapshot, view.state, view.own, out);
        if snapshot.stage != Stage::Locked {
            for (key, value) in &view.report.values {
                out.push_value(key, value);
            }
        }
    }
}

/// What a level alone cannot say: IGNORE has none, and hides what is behind it.
fn own_values(snapshot: &Snapshot, state: State, own: State, out: &mut StatusArray) {
    out.push_value("telltale_state", state.as_str());
    if snapshot.stage != Stage::Locked && own != state {
        out.push_value("telltale_own", own.as_str());
    }
}

fn message(snapshot: &Snapshot, state: State, reason: Option<&Reason>, said: &str) -> String {
    let why = match reason {
        Some(Reason::Masked { by }) => {
            let names: Vec<&str> = by.iter().map(|&node| &**snapshot.node_name(node)).collect();
            format!("waits for {}", names.join(", "))
        }
        Some(Reason::NotRelevant(NotRelevant::Stage(stage))) => {
            format!("not relevant in the stage {}", stage.as_str())
        }
        Some(Reason::NotRelevant(NotRelevant::Signal { name, value })) => {
            format!("not relevant while {name} is {value}")
        }
        None if state == State::Ignore => "nothing in it is relevant".to_owned(),
        None if said.is_empty() => return word(state).to_owned(),
        None => return said.to_owned(),
    };
    format!("Ignored: {why}")
}

/// The last part of a module's name, after the path of its group.
fn module_part(snapshot: &Snapshot, id: ModuleId) -> String {
    let (info, _) = snapshot.module(id);
    let group = snapshot.group(info.group).0.path.len();
    part(info.id.get(group + 1..).unwrap_or(&info.id))
}

/// A `/` inside of a name would make another level of the tree.
fn part(name: &str) -> String {
    let part = name.replace('/', " ");
    part.trim().to_owned()
}

/// UNKNOWN is STALE. IGNORE has no level there and must not alarm.
const fn level(state: State) -> u8 {
    match state {
        State::Ok | State::Ignore => 0,
        State::Warning => 1,
        State::Error => 2,
        State::Unknown => 3,
    }
}

/// As the aggregator of ROS 2 words it.
const fn word(state: State) -> &'static str {
    match state {
        State::Ok => "OK",
        State::Warning => "Warning",
        State::Error => "Error",
        State::Unknown => "Stale",
        State::Ignore => "Ignored",
    }
}
