//! What other ROS 2 nodes may have done: what is done, what is refused and why, and how it is recorded.

use telltale_engine::input::{Input, OperatorAction};
use telltale_engine::model::Stage;
use telltale_engine::model::service::Service;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::state::State;
use telltale_runtime::{Reread, Rereading};
use telltale_web::services::{Answer, ServiceRequest, serve};

use crate::fixture::Fixture;

const CALLER: &str = "/panel (participant 0110aa)";

async fn ask(fixture: &Fixture, service: Service, argument: &str, while_driving: bool) -> Answer {
    let request = ServiceRequest { service, argument: argument.into(), caller: CALLER.into(), while_driving };
    serve(&fixture.app.live().expect("it is no replay"), &request).await
}

fn number_of(snapshot: &Snapshot, node: &str) -> Option<u64> {
    let node = snapshot.node(node)?;
    snapshot.alarms.iter().find(|alarm| alarm.node == node).map(|alarm| alarm.id)
}

/// An operator is logged in, and the LiDAR is in ERROR.
async fn with_an_alarm() -> (Fixture, u64) {
    let fixture = Fixture::new().await;
    fixture.cookie_of("operator").await;
    fixture.status("lidar", 2, "broken").await;
    let seen = fixture.until(|snapshot| number_of(snapshot, "sensors/lidar").is_some()).await;
    let number = number_of(&seen, "sensors/lidar").expect("it was waited for");
    (fixture, number)
}

fn is_acknowledged(fixture: &Fixture, number: u64) -> bool {
    let snapshot = fixture.link.snapshots.borrow().snapshot.clone();
    snapshot.alarms.iter().any(|alarm| alarm.id == number && alarm.acknowledged)
}

async fn records(fixture: &Fixture) -> Vec<[String; 5]> {
    let entries = fixture.store.audit_entries(None, 100).await.unwrap();
    let of_dds = entries.into_iter().filter(|entry| entry.source == "DDS");
    of_dds.map(|it| [it.who, it.role, it.action, it.target, it.outcome]).collect()
}

#[tokio::test]
async fn an_alarm_is_acknowledged_by_number_or_node_once_and_recorded_with_its_caller() {
    for by_number in [true, false] {
        let (fixture, number) = with_an_alarm().await;
        let argument = if by_number { number.to_string() } else { "sensors/lidar".to_owned() };
        let answer = ask(&fixture, Service::Acknowledge, &argument, false).await;
        assert_eq!(answer, Ok(format!("acknowledged: alarm {number}")));
        assert!(is_acknowledged(&fixture, number));
        // A client whose answer was lost asks again.
        let again = ask(&fixture, Service::Acknowledge, &argument, false).await;
        assert_eq!(again, Ok(format!("{argument}: acknowledged before")));
        let target = if by_number { argument } else { format!("{number}: {argument}") };
        let expected = [CALLER, "", "acknowledge", &target, "done"].map(str::to_owned);
        assert_eq!(records(&fixture).await, [expected]);
    }
}

#[tokio::test]
async fn what_is_not_there_is_refused_with_what_is() {
    let (fixture, number) = with_an_alarm().await;
    for (argument, expected) in [
        ("", format!("name an alarm by its number, or a node: open are {number} sensors/lidar")),
        ("9999", format!("9999: there is no such alarm; open are {number} sensors/lidar")),
        ("sensors/radar", "there is no group and no module sensors/radar".to_owned()),
    ] {
        assert_eq!(ask(&fixture, Service::Acknowledge, argument, false).await, Err(expected));
    }
    let why = ask(&fixture, Service::Reset, "sensors/lidar", false).await.unwrap_err();
    assert!(why.contains("sensors/lidar"), "{why}");
    let refused = records(&fixture).await;
    assert_eq!(refused.len(), 4);
    assert!(refused.iter().all(|record| record[4].starts_with("refused: ")), "{refused:?}");
}

#[tokio::test]
async fn a_warning_is_not_accepted_by_a_node() {
    let fixture = Fixture::new().await;
    fixture.cookie_of("operator").await;
    fixture.status("lidar", 1, "dirty").await;
    fixture
        .until(|snapshot| snapshot.node("sensors/lidar").is_some_and(|it| snapshot.own(it) == State::Warning))
        .await;
    let why = ask(&fixture, Service::Acknowledge, "sensors/lidar", true).await.unwrap_err();
    assert!(why.contains("which an operator accepts at the page"), "{why}");
    assert!(fixture.link.snapshots.borrow().snapshot.accepted.is_empty());
}

#[tokio::test]
async fn while_it_drives_all_but_marks_are_for_the_operator_unless_permitted() {
    let (fixture, number) = with_an_alarm().await;
    fixture.drive(true).await;
    assert_eq!(fixture.stage(), Stage::Active);
    let number = number.to_string();
    for (service, argument) in
        [(Service::Acknowledge, &*number), (Service::Reset, "sensors/lidar"), (Service::Reload, "")]
    {
        let why = ask(&fixture, service, argument, false).await.unwrap_err();
        assert_eq!(why, "While the vehicle is cleared or drives, this is for its operator at the page.");
    }
    assert!(!is_acknowledged(&fixture, number.parse().unwrap()));
    let answer = ask(&fixture, Service::Acknowledge, &number, true).await;
    assert_eq!(answer, Ok(format!("acknowledged: alarm {number}")));
    // Nothing is recorded in this vehicle, so nothing can be marked; that it drives is no reason.
    let why = ask(&fixture, Service::Mark, "", true).await.unwrap_err();
    assert!(!why.contains("operator"), "{why}");
}

#[tokio::test]
async fn a_locked_vehicle_has_nobody_who_acknowledges_and_a_machine_without_stages_needs_nobody() {
    let (fixture, _) = with_an_alarm().await;
    fixture.input(Input::Operator(OperatorAction::Logout)).await;
    fixture.until(|snapshot| snapshot.stage == Stage::Locked).await;
    let locked = ask(&fixture, Service::Acknowledge, "sensors/lidar", true).await;
    assert!(locked.is_err(), "{locked:?}");
    let fixture = Fixture::without_stages().await;
    fixture.status("lidar", 2, "broken").await;
    fixture.until(|snapshot| number_of(snapshot, "sensors/lidar").is_some()).await;
    let answer = ask(&fixture, Service::Acknowledge, "sensors/lidar", false).await;
    assert!(answer.is_ok(), "{answer:?}");
}

#[tokio::test]
async fn a_reload_is_taken_whole_or_refused_with_its_problems() {
    for (problems, expected) in [
        (
            Some("c:3:1: unknown key"),
            Err("the file is wrong, and the old configuration stays:\nc:3:1: unknown key"),
        ),
        (None, Ok("taken: group `a` was added")),
    ] {
        let mut fixture = Fixture::new().await;
        let (asks, never) = tokio::sync::mpsc::channel(1);
        let mut rereads: tokio::sync::mpsc::Receiver<Reread> = std::mem::replace(&mut fixture.rereads, never);
        drop(asks);
        let problems = problems.map(str::to_owned);
        let wrong = problems.clone();
        let answering = tokio::spawn(async move {
            while let Some(Reread { take, reply, .. }) = rereads.recv().await {
                let differences =
                    if wrong.is_none() { vec!["group `a` was added".to_owned()] } else { Vec::new() };
                let read = Rereading {
                    taken: take && wrong.is_none(),
                    differences,
                    problems: wrong.clone(),
                    warnings: None,
                    judged: true,
                    running: [].into(),
                    digest: "1".to_owned(),
                };
                reply.send(read).unwrap();
            }
        });
        let answer = ask(&fixture, Service::Reload, "", false).await;
        assert_eq!(answer.as_deref().map_err(|why| &**why), expected);
        let records = records(&fixture).await;
        assert_eq!(records.last().map(|record| &*record[0]), Some(CALLER), "{records:?}");
        answering.abort();
    }
}
