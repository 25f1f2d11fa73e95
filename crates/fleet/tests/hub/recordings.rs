//! Recordings of a vehicle go to a real hub in pieces.

use std::time::Duration;

use telltale_fleet::delivery::Answer;
use telltale_fleet::fetching::Pieces;
use telltale_fleet::identity::Identity;
use telltale_fleet::line::Line;
use telltale_fleet::message::{Content, NotSent, PIECE_BYTES, Recording, VehicleId};
use telltale_fleet::reading::Logs;
use telltale_fleet::recordings::{Finished, WISHES_AT_ONCE};
use tempfile::TempDir;

use crate::server::{Hub, until};
use crate::vehicle::Vehicle;

pub const SHA: &str = "c0ffee00c0ffee00c0ffee00c0ffee00c0ffee00c0ffee00c0ffee00c0ffee00";

fn id() -> VehicleId {
    VehicleId::new("a").unwrap()
}

/// A hub with a vehicle `a`, and a console's line to it.
pub async fn hub(name: &str) -> (Hub, Pieces, TempDir) {
    let mut hub = Hub::start(name).await;
    hub.enrol("a");
    let console = Identity::read(&hub.key_file("console")).unwrap();
    let pieces = Logs::open(&hub.address(), &console).await.unwrap().pieces();
    (hub, pieces, TempDir::new().unwrap())
}

/// A recording of so many bytes. Each byte tells its place.
pub fn recording(data: &TempDir, incident: u64, bytes: usize) -> (Finished, Vec<u8>) {
    let content: Vec<u8> = (0..bytes).map(|it| (it / 251 % 256) as u8).collect();
    let path = data.path().join(format!("incident-{incident}.mcap"));
    std::fs::write(&path, &content).unwrap();
    let sha256 = SHA.to_owned();
    (Finished { incident, path, sha256, bytes: bytes as u64, by_itself: false }, content)
}

pub async fn piece(pieces: &Pieces, number: u64) -> Vec<u8> {
    let wait = async {
        loop {
            if let Some(piece) = pieces.read(&id(), SHA, number).await.unwrap() {
                return piece.bytes.to_vec();
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    until("a piece", wait).await
}

fn told(contents: &[Content]) -> Vec<Recording> {
    let recordings = contents.iter().filter_map(|it| match it {
        Content::Recording(told) => Some(told.clone()),
        _ => None,
    });
    recordings.collect()
}

#[tokio::test]
async fn a_wanted_recording_comes_whole_after_the_word_that_it_does() {
    let (hub, pieces, data) = hub("whole").await;
    let mut vehicle = Vehicle::start(&hub, "a", &data);
    let (finished, content) = recording(&data, 7, 3 * PIECE_BYTES + 5);
    let console = hub.console().await;
    console.history_with("a", |seen| !seen.is_empty()).await;
    for _ in 0..2 {
        pieces.want(&id(), &[7]).await.unwrap();
        assert_eq!(until("the wish", vehicle.wanted.recv()).await, Some(7));
    }
    // The acknowledgement of this piece was lost before.
    let identity = Identity::read(&hub.key_file("a")).unwrap();
    let line = Line::open(&hub.address(), &id(), &identity).await.unwrap();
    let third = content[2 * PIECE_BYTES..3 * PIECE_BYTES].to_vec();
    assert!(matches!(line.requests().piece(SHA, 2, third).await, Answer::Stored(_)));
    // It was asked for twice, and waits once.
    for _ in 0..2 {
        vehicle.finished.send(finished.clone()).await.unwrap();
    }
    let last = piece(&pieces, 3).await;
    let mut arrived = Vec::new();
    for number in 0..3 {
        arrived.extend(piece(&pieces, number).await);
    }
    arrived.extend(last);
    assert_eq!(arrived, content);
    let seen = console.history_with("a", |seen| !told(seen).is_empty()).await;
    let announced = told(&seen).remove(0);
    assert_eq!((announced.incident, announced.refused), (7, None));
    let announced = announced.pieces.unwrap();
    assert_eq!((&*announced.sha256, announced.bytes, announced.pieces), (SHA, content.len() as u64, 4));
    vehicle.end().await;
    console.history_with("a", |seen| seen.last() == Some(&Content::Goodbye) && told(seen).len() == 1).await;
    pieces.remove(&id(), SHA, None).await.unwrap();
    assert!(pieces.read(&id(), SHA, 0).await.unwrap().is_none());
}

#[tokio::test]
async fn a_vehicle_that_ended_halfway_goes_on_where_it_was() {
    let (hub, pieces, data) = hub("halfway").await;
    let vehicle = Vehicle::start(&hub, "a", &data);
    let (finished, content) = recording(&data, 7, 60 * PIECE_BYTES);
    vehicle.finished.send(finished).await.unwrap();
    piece(&pieces, 5).await;
    vehicle.end().await;
    assert!(pieces.read(&id(), SHA, 59).await.unwrap().is_none(), "it was not done yet");
    pieces.remove(&id(), SHA, None).await.unwrap();
    let vehicle = Vehicle::start(&hub, "a", &data);
    assert_eq!(piece(&pieces, 59).await, content[59 * PIECE_BYTES..]);
    assert!(pieces.read(&id(), SHA, 0).await.unwrap().is_none(), "it does not begin again");
    vehicle.end().await;
}

#[tokio::test]
async fn what_is_not_sent_is_said() {
    let (hub, pieces, data) = hub("not-sent").await;
    let vehicle = Vehicle::start(&hub, "a", &data);
    let (finished, _) = recording(&data, 7, 10);
    std::fs::remove_file(&finished.path).unwrap();
    vehicle.finished.send(finished).await.unwrap();
    let console = hub.console().await;
    let refused = |incident, why| Recording { incident, pieces: None, refused: Some(why) };
    let gone = refused(7, NotSent::Gone);
    console.history_with("a", |seen| told(seen) == std::slice::from_ref(&gone)).await;
    vehicle.end().await;

    let mut never = Vehicle::with(&hub, "a", &data, false);
    console.history_with("a", |seen| seen.len() > 3).await;
    pieces.want(&id(), &[8]).await.unwrap();
    let both = [gone, refused(8, NotSent::Never)];
    console.history_with("a", |seen| told(seen) == both).await;
    assert!(never.wanted.try_recv().is_err());
    never.end().await;
}

#[tokio::test]
async fn no_wish_changes_anything_in_the_engine() {
    let (hub, _pieces, data) = hub("wishes").await;
    let mut vehicle = Vehicle::start(&hub, "a", &data);
    let before = vehicle.engine();
    let console = hub.console().await;
    console.history_with("a", |seen| !seen.is_empty()).await;
    for wish in [r#"{"stop":true}"#, r#"{"incidents":[1],"release":true,"stage":"active"}"#, "x", "[1]"] {
        console.want("a", wish).await;
    }
    for number in (10..200_u64).step_by(10) {
        let wanted: Vec<u64> = (number..number + 10).collect();
        // One after the other: a line that is flooded loses some of them uncounted.
        console.want("a", &format!(r#"{{"incidents":{wanted:?}}}"#)).await;
    }
    let wait = async {
        while vehicle.fleet.status().borrow().dropped_wishes < 100 {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    until("what is dropped", wait).await;
    let mut wanted = Vec::new();
    while let Ok(number) = vehicle.wanted.try_recv() {
        wanted.push(number);
    }
    // A slow machine lets time pass, and each 10 s one more is looked for.
    assert!((WISHES_AT_ONCE..WISHES_AT_ONCE + 5).contains(&(wanted.len() as u64)), "{wanted:?}");
    assert_eq!(wanted.first(), Some(&1));
    assert_eq!(vehicle.engine(), before);
    vehicle.end().await;
}
