//! Tests of the loop that owns the engine.

use super::*;
use crate::engine::input::{Input, StatusArray};
use crate::engine::model::{
    Combine, GroupId, GroupSpec, ModuleMonitor, ModuleSpec, NodeId, Parts, Policy, StageModel,
};
use crate::engine::state::State;
use crate::engine::text::Text;
use crate::engine::view::record::Recorded;

fn empty_model() -> Arc<Model> {
    let parts = Parts::empty("v", StageModel::Shuttle);
    Arc::new(Model::new(parts).unwrap())
}

#[tokio::test]
async fn a_status_comes_out_and_a_command_is_answered_after_its_effect_is_published() {
    let clock = Clock::start();
    let mut link = start(empty_model(), clock);
    let (reply, answer) = oneshot::channel();
    let action = OperatorAction::Login { name: "anna".into() };
    link.commands.send(Command { action, reply }).await.unwrap();
    assert_eq!(answer.await.unwrap(), Response::Done);
    assert_eq!(link.snapshots.borrow().snapshot.stage, Stage::Localizing);

    let mut array = StatusArray::default();
    array.push_status(2, "pump", "broken", "");
    let input = Input::Diagnostics(array);
    link.inputs.send(Stamped::new(input, clock.now())).await.unwrap();
    let heard = |published: &Published| published.snapshot.node("other/pump").is_some();
    let seen = link.snapshots.wait_for(heard).await.unwrap();
    let Some(NodeId::Module(id)) = seen.snapshot.node("other/pump") else { panic!("it is a module") };
    assert_eq!(seen.snapshot.module(id).1.state, State::Error);
    assert_eq!(&*seen.snapshot.module(id).1.report.message, "broken");
}

/// Its deadline lies before the reload, and its node is not in the new configuration.
#[tokio::test]
async fn what_was_due_before_a_reload_has_the_names_of_the_old_configuration() {
    let mut parts = Parts::empty("v", StageModel::None);
    parts.groups.push(GroupSpec {
        path: "sensors".into(),
        name: Text::plain("Sensors"),
        parent: None,
        combine: Combine::Worst,
        when: None,
        depends_on: Vec::new(),
        filters: Vec::new(),
        tile: None,
        may_be_empty: false,
    });
    for (status, stale) in [("imu", State::Unknown), ("gnss", State::Error)] {
        parts.modules.push(ModuleSpec {
            id: format!("sensors/{status}").into(),
            name: None,
            help: None,
            group: GroupId(0),
            policy: Policy { timeout: Span::from_secs(1), stale, ..Policy::default() },
            when: None,
            depends_on: Vec::new(),
            monitor: ModuleMonitor::SelfState(status.into()),
            expected: None,
        });
    }
    let model = Arc::new(Model::new(parts).unwrap());
    let (clock, hand) = Clock::standing();
    let (records, told) = std::sync::mpsc::sync_channel(64);
    let followers = Followers { records: Some(records), feed: None };
    let mut link = start_followed(model, clock, followers);
    let mut array = StatusArray::default();
    array.push_status(0, "gnss", "fine", "");
    link.inputs.send(Stamped::new(Input::Diagnostics(array), clock.now())).await.unwrap();
    let is_ok = |published: &Published| {
        let gnss = published.snapshot.node("sensors/gnss");
        gnss.is_some_and(|gnss| published.snapshot.shown(gnss).0 == State::Ok)
    };
    link.snapshots.wait_for(is_ok).await.unwrap();
    hand.advance(Span::from_secs(2));
    let (done, reloaded) = oneshot::channel();
    link.reloads.send(Reload { model: empty_model(), texts: [].into(), done }).await.unwrap();
    reloaded.await.expect("the engine goes on");
    let shown = |record: &Record| {
        let Recorded::Shown { node, state, .. } = &record.what else { return false };
        &**node == "sensors/gnss" && *state == State::Error
    };
    assert!(told.try_iter().flatten().any(|record| shown(&record)));
}

#[tokio::test]
async fn snapshots_pulse_while_nothing_happens() {
    let mut link = start(empty_model(), Clock::start());
    let first = link.snapshots.borrow_and_update().at;
    link.snapshots.changed().await.unwrap();
    assert!(link.snapshots.borrow().at > first);
}
