//! Tests of the loop that owns the engine.

use super::*;
use std::sync::mpsc::TryRecvError;
use telltale_engine::input::{Input, StatusArray};
use telltale_engine::model::{
    GroupId, GroupSpec, ModuleMonitor, ModuleSpec, NodeId, Parts, Policy, StageModel,
};
use telltale_engine::state::State;
use telltale_engine::text::Text;
use telltale_engine::view::record::Recorded;

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
    link.commands.send(Command { action, last_stop: None, reply }).await.unwrap();
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

#[tokio::test]
async fn the_vehicle_and_programs_are_told_before_all_others() {
    let clock = Clock::start();
    let link = start(empty_model(), clock);
    let (mut snapshots, mut vehicle, mut afterwards) =
        (link.snapshots.clone(), link.vehicle.clone(), link.afterwards.clone());
    let is_heard = |snapshot: &Snapshot| snapshot.node("other/pump").is_some();
    // Each task reads, when it runs, the snapshot that the others have.
    let (program_sees, vehicle_sees) = (afterwards.clone(), afterwards.clone());
    let program = tokio::spawn(async move {
        snapshots.wait_for(|it| is_heard(&it.snapshot)).await.unwrap();
        is_heard(&program_sees.borrow().snapshot)
    });
    let vehicle = tokio::spawn(async move {
        vehicle.wait_for(|it| is_heard(it)).await.unwrap();
        is_heard(&vehicle_sees.borrow().snapshot)
    });
    let mut array = StatusArray::default();
    array.push_status(2, "pump", "broken", "");
    link.inputs.send(Stamped::new(Input::Diagnostics(array), clock.now())).await.unwrap();
    afterwards.wait_for(|it| is_heard(&it.snapshot)).await.unwrap();
    assert_eq!((program.await.unwrap(), vehicle.await.unwrap()), (false, false));

    // The client of a command finds its effect everywhere.
    let (reply, answer) = oneshot::channel();
    let action = OperatorAction::Login { name: "anna".into() };
    link.commands.send(Command { action, last_stop: None, reply }).await.unwrap();
    assert_eq!(answer.await.unwrap(), Response::Done);
    assert_eq!(afterwards.borrow().snapshot.stage, Stage::Localizing);
}

/// Its deadline lies before the reload, and its node is not in the new configuration.
#[tokio::test]
async fn what_was_due_before_a_reload_has_the_names_of_the_old_configuration() {
    let mut parts = Parts::empty("v", StageModel::None);
    parts.groups.push(GroupSpec::new("sensors", Text::plain("Sensors")));
    for (status, stale) in [("imu", State::Unknown), ("gnss", State::Error)] {
        let monitor = ModuleMonitor::SelfState(status.into());
        parts.modules.push(ModuleSpec {
            policy: Policy { timeout: Span::from_secs(1), stale, ..Policy::default() },
            ..ModuleSpec::new(&format!("sensors/{status}"), GroupId(0), monitor)
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
    // At its end the engine hands on what still waits.
    drop(link);
    let mut records = Vec::new();
    loop {
        match told.try_recv() {
            Ok(batch) => records.extend(batch),
            Err(TryRecvError::Empty) => tokio::task::yield_now().await,
            Err(TryRecvError::Disconnected) => break,
        }
    }
    assert!(records.iter().any(shown));
}

#[tokio::test]
async fn snapshots_pulse_while_nothing_happens() {
    let mut link = start(empty_model(), Clock::start());
    let first = link.snapshots.borrow_and_update().at;
    link.snapshots.changed().await.unwrap();
    assert!(link.snapshots.borrow().at > first);
}

/// Threads stamp what they receive before it waits for the engine.
#[tokio::test]
async fn a_recording_has_the_times_of_the_engine_in_order() {
    use telltale_msg::fields::Definitions;
    use telltale_record::file::{Entry, JOURNAL, Reader};
    use telltale_record::journal::Line;
    use telltale_record::recorder::{Recorder, Settings};
    use telltale_record::writer::{Place, write_recent};

    let folder = std::env::temp_dir().join(format!("telltale-runtime-order-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (clock, hand) = Clock::standing();
    hand.advance(Span::from_secs(1));
    let (feed, turns) = Feed::new(clock);
    let mut link = start_followed(empty_model(), clock, Followers { records: None, feed: Some(feed) });
    let settings = Settings {
        margins: telltale_record::incident::Margins::default(),
        memory: 10_000_000,
        longest_memory: Span::ZERO,
        configuration: [].into(),
    };
    let first = link.snapshots.borrow().snapshot.clone();
    let recorder = Recorder::start(turns, first, settings, 1, clock).unwrap();
    // Module reports of different times, some of them earlier than what the engine took before.
    for (name, at_ms) in [("a", 1_500), ("b", 1_400), ("c", 2_000), ("d", 900), ("e", 2_001), ("last", 1_999)]
    {
        let mut array = StatusArray::default();
        array.push_status(2, name, "", "");
        let stamped = Stamped::new(Input::Diagnostics(array), Timestamp::from_millis(at_ms));
        link.inputs.send(stamped).await.unwrap();
    }
    link.snapshots.wait_for(|it| it.snapshot.node("other/last").is_some()).await.unwrap();
    drop(link);
    let place = Place {
        folder: folder.clone(),
        definitions: Definitions::new(Vec::new()),
        about: Default::default(),
    };
    let (mut times, mut taken) = (Vec::new(), Vec::new());
    // The recorder's thread may be behind.
    while taken.len() < 6 {
        (times, taken) = (Vec::new(), Vec::new());
        // The engine hands on to the recorder after all others.
        tokio::task::yield_now().await;
        let Some(path) = write_recent(&recorder, &place, &folder).unwrap() else { continue };
        let mut reader = Reader::open(&path).unwrap();
        while let Some(Entry::Message { stamps, .. } | Entry::Json { stamps, .. }) = reader.next_entry() {
            times.push(stamps.log_time_ns);
        }
        let mut reader = Reader::open(&path).unwrap();
        while let Some(entry) = reader.next_entry() {
            if let Entry::Json { channel, text, .. } = entry
                && *channel.topic == *JOURNAL.topic
            {
                taken.push(serde_json::from_slice::<Line>(&text).unwrap().at_ns.as_nanos() / 1_000_000);
            }
        }
        std::fs::remove_file(path).unwrap();
    }
    std::fs::remove_dir_all(folder).unwrap();
    assert!(times.is_sorted(), "{times:?}");
    assert_eq!(taken[..6], [1_500, 1_500, 2_000, 2_000, 2_001, 2_001]);
}

#[tokio::test]
async fn followers_are_told_of_the_last_moment_before_the_end() {
    let parts = Parts::empty("v", StageModel::Shuttle);
    let (clock, _hand) = Clock::standing();
    let (records, told) = std::sync::mpsc::sync_channel(64);
    let followers = Followers { records: Some(records), feed: None };
    let link = start_followed(Arc::new(Model::new(parts).unwrap()), clock, followers);
    let (reply, done) = oneshot::channel();
    let action = OperatorAction::Login { name: "anna".into() };
    link.commands.send(Command { action, last_stop: None, reply }).await.unwrap();
    done.await.unwrap();
    link.ending.end();
    link.commands.closed().await;
    let told: Vec<Record> = std::iter::from_fn(|| told.recv().ok()).flatten().collect();
    let stages = told.iter().filter_map(|record| match record.what {
        Recorded::Stage(stage) => Some(stage),
        _ => None,
    });
    assert_eq!(stages.collect::<Vec<_>>(), [Stage::Locked, Stage::Localizing]);
}

#[tokio::test]
async fn a_machine_without_stages_has_none_in_its_history() {
    let (records, told) = std::sync::mpsc::sync_channel(64);
    let followers = Followers { records: Some(records), feed: None };
    let model = Arc::new(Model::new(Parts::empty("v", StageModel::None)).unwrap());
    let link = start_followed(model, Clock::start(), followers);
    link.ending.end();
    link.commands.closed().await;
    let told: Vec<Record> = std::iter::from_fn(|| told.recv().ok()).flatten().collect();
    assert!(told.iter().any(|record| matches!(record.what, Recorded::Shown { .. })));
    assert!(!told.iter().any(|record| matches!(record.what, Recorded::Stage(_))), "{told:?}");
}
