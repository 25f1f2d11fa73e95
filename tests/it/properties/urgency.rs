//! What the instruction asks for, against its definition: the highest urgency over the own states of all relevant
//! modules, masked or not.

use telltale::engine::model::wording::Urgency;
use telltale::engine::model::{ModuleId, NodeId, Stage};
use telltale::engine::snapshot::{Reason, Snapshot};
use telltale::engine::state::State;

use super::oracle::Oracle;

/// Whether the instruction asks for as much as before, while the vehicle may drive. An UNKNOWN that becomes ERROR may
/// ask for less, if its advice says so.
pub fn is_no_weaker(before: &Snapshot, after: &Snapshot) -> bool {
    let state = |snapshot: &Snapshot, id| snapshot.module(id).1.own;
    let mut modules = before.module_ids();
    let excused = modules.any(|id| state(before, id) == State::Unknown && state(after, id) == State::Error);
    let urgency = |snapshot: &Snapshot| snapshot.asked.map(|asked| asked.urgency);
    excused || before.stage != after.stage || urgency(after) >= urgency(before)
}

/// Nothing asks for more than the instruction, and it asks for no more than something does or an open alarm did.
pub fn check(snapshot: &Snapshot, oracle: &Oracle<'_>) {
    let may_drive = snapshot.has_stages() && matches!(snapshot.stage, Stage::Cleared | Stage::Active);
    let asked = snapshot.asked.map(|asked| asked.urgency);
    let mut most = None;
    for id in snapshot.module_ids() {
        let node = NodeId::Module(id);
        let urgency = at_least(snapshot, id).filter(|_| may_drive && !oracle.is_aside(node));
        assert!(
            snapshot.asks(node) >= urgency,
            "what {} asks for: {:?} {:?} {:?} {node:?}",
            snapshot.node_name(node),
            snapshot.module(id).1,
            snapshot.stage,
            snapshot.asking
        );
        assert_eq!(snapshot.asks(node).is_some(), urgency.is_some(), "{}", snapshot.node_name(node));
    }
    most = snapshot.asking.iter().map(|(_, urgency)| Some(*urgency)).fold(most, Option::max);
    let open = snapshot.alarms.iter().filter(|alarm| alarm.active && !alarm.acknowledged);
    most = open.map(|alarm| alarm.asked).fold(most, Option::max);
    assert_eq!(asked, most, "what the instruction asks for");
    assert!(may_drive || asked.is_none() && snapshot.asking.is_empty());
}

/// What the own state of a module asks for, but for what its requests to slow down add.
fn at_least(snapshot: &Snapshot, id: ModuleId) -> Option<Urgency> {
    let (info, module) = snapshot.module(id);
    if matches!(module.reason, Some(Reason::NotRelevant(_)))
        || module.own == State::Unknown && module.steps.grace
    {
        return None;
    }
    let only_waits_for_reset = module.steps.latched && !module.steps.in_error;
    let help = info.help.as_ref().filter(|_| !only_waits_for_reset);
    let advised = help.and_then(|help| help.of(module.own, snapshot.stage)?.urgency);
    match module.own {
        State::Ok | State::Ignore => None,
        State::Warning => advised,
        State::Unknown | State::Error => advised.or(Some(Urgency::BeReady)),
    }
}
