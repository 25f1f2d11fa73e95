//! A snapshot as the tools of ROS 2 for aggregated diagnostics expect it (rqt_robot_monitor and its
//! kin): one status for each node of the tree, named by its path, a group before its members.

use std::borrow::Cow;

use crate::engine::input::StatusArray;
use crate::engine::model::{GroupId, ModuleId, Stage};
use crate::engine::snapshot::{ModuleView, NotRelevant, Reason, Snapshot};
use crate::engine::state::State;

/// The tree of the vehicle. Before a login it says nothing of what modules report.
pub fn tree(snapshot: &Snapshot) -> StatusArray {
    let mut out = StatusArray::default();
    let root = part(&snapshot.layout.vehicle_name.en);
    let tops: Vec<GroupId> = (0..snapshot.layout.groups.len() as u32)
        .map(GroupId)
        .filter(|&id| snapshot.group(id).0.parent.is_none() && !is_idle(snapshot, id))
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

/// The group of what nothing claims, while there is no such thing.
fn is_idle(snapshot: &Snapshot, id: GroupId) -> bool {
    let (info, _) = snapshot.group(id);
    info.is_other && info.groups.is_empty() && info.modules.is_empty()
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
        let said = if snapshot.stage == Stage::Locked { Cow::default() } else { words(view) };
        let said = message(snapshot, view.state, view.reason.as_ref(), &said);
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

/// What a module says last; of one that is silent, that it is.
fn words(view: &ModuleView) -> Cow<'_, str> {
    let message = &*view.report.message;
    match (view.silent, view.received) {
        (true, None) => "nothing was received yet".into(),
        (true, Some(_)) if message.is_empty() => "nothing is received any more".into(),
        (true, Some(_)) => format!("nothing is received any more; the last was: {message}").into(),
        (false, None) if message.is_empty() && view.own == State::Unknown => "nothing is known yet".into(),
        (false, _) => message.into(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    use crate::engine::Engine;
    use crate::engine::input::Input;
    use crate::engine::model::{Driving, Limits, Model, Parts, Policy, StageModel, Text};
    use crate::engine::monitor::spec::Watched;
    use crate::engine::time::Timestamp;

    #[test]
    fn what_nothing_claims_is_there_only_when_it_is_and_silence_is_said() {
        let parts = Parts {
            vehicle_id: "v".into(),
            vehicle_name: Text::plain("V"),
            stages: StageModel::None,
            signals: Vec::new(),
            groups: Vec::new(),
            modules: Vec::new(),
            watched: Watched::default(),
            driving: Driving::default(),
            discovered: Policy::default(),
            limits: Limits::default(),
        };
        let model = Arc::new(Model::new(parts).expect("nothing depends on anything"));
        let mut engine = Engine::new(model, Timestamp::ZERO);
        let others = |engine: &mut Engine| -> Vec<(String, String)> {
            let tree = tree(&engine.snapshot());
            let others = tree.iter().filter(|status| status.name().contains("Other"));
            others.map(|status| (status.name().to_owned(), status.message().to_owned())).collect()
        };
        assert_eq!(others(&mut engine), []);
        let mut array = StatusArray::default();
        array.push_status(0, "lidar", "fine", "");
        engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(10));
        assert_eq!(others(&mut engine)[1].1, "fine");
        engine.handle(&Input::Tick, Timestamp::from_millis(60_000));
        assert_eq!(others(&mut engine)[1].1, "nothing is received any more; the last was: fine");
    }
}
