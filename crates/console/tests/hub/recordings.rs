//! Recordings reach the console from a vehicle over a real hub.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;

use axum::body::to_bytes;
use axum::http::{Method, StatusCode};
use telltale_fleet::message::{NotSent, PIECE_BYTES, Pieces};
use telltale_fleet::reading::Logs;
use telltale_fleet::recordings::{Finished, refused};

use super::*;

const AT_MS: i64 = 1_780_000_000_000;
const PAGE: &str = "/vehicles/a/state";

fn incident(number: u64, bytes: u64, sha256: &str) -> Content {
    Content::Incident(Incident {
        number,
        since: AT_MS,
        until: Some(AT_MS + 9000),
        stage: "active".into(),
        causes: vec!["sensors/lidar".into()],
        triggers: 1,
        version: "0.1.0".into(),
        config: "c0ffee".into(),
        bytes,
        sha256: Some(sha256.into()),
    })
}

impl Running {
    /// Waits until the page says this of the recording of an incident.
    async fn recording_is(&self, number: u64, step: &str) -> String {
        let line = format!("<li id=\"incident-{number}\" data-recording=\"{step}\">");
        let wait = async {
            loop {
                let (_, page) = self.page(PAGE).await;
                if let Some((_, rest)) = page.split_once(&line) {
                    return rest.split("</li>").next().unwrap_or_default().to_owned();
                }
                tokio::time::sleep(LOOK_EVERY).await;
            }
        };
        until(&line, wait).await
    }

    async fn page(&self, path: &str) -> (StatusCode, String) {
        let answer = self.ask(Method::GET, path).await;
        let status = answer.status();
        let body = to_bytes(answer.into_body(), 1 << 26).await.unwrap();
        (status, String::from_utf8_lossy(&body).into_owned())
    }

    async fn fetch(&self, number: u64) -> StatusCode {
        self.ask(Method::POST, &format!("/vehicles/a/incidents/{number}/fetch")).await.status()
    }
}

fn file_with(folder: &TempDir, bytes: usize) -> (Finished, Vec<u8>) {
    let content: Vec<u8> = (0..bytes).map(|it| (it / 251 % 256) as u8).collect();
    let path = folder.path().join("incident-7.mcap");
    fs::write(&path, &content).unwrap();
    let sha256 = telltale_record::writer::hash_file(&path).unwrap();
    (Finished { incident: 7, path, sha256, bytes: bytes as u64, by_itself: false }, content)
}

#[tokio::test]
async fn a_recording_that_is_asked_for_comes_through_a_restart_of_the_console() {
    let mut hub = Hub::start("fetch").await;
    hub.enrol("a");
    let (data, console_data) = (TempDir::new().unwrap(), TempDir::new().unwrap());
    let console = Running::start(&hub, &console_data).await;
    let mut vehicle = Vehicle::start(&hub, "a", &data);
    let (finished, content) = file_with(&data, 40 * PIECE_BYTES + 9);
    vehicle.news.send(incident(7, content.len() as u64, &finished.sha256)).await.unwrap();
    let shown = console.recording_is(7, "none").await;
    assert!(shown.contains("/vehicles/a/incidents/7/fetch") && shown.contains("Fetch recording"), "{shown}");
    for _ in 0..2 {
        assert_eq!(console.fetch(7).await, StatusCode::SEE_OTHER);
    }
    console.recording_is(7, "asked").await;
    assert_eq!(until("the wish", vehicle.wanted.recv()).await, Some(7));
    vehicle.finished.send(finished.clone()).await.unwrap();
    let shown = console.recording_is(7, "coming").await;
    assert!(shown.contains(" % of 2.6 MB are here."), "{shown}");
    console.end().await;

    let console = Running::start(&hub, &console_data).await;
    let shown = console.recording_is(7, "here").await;
    assert!(shown.contains("/vehicles/a/incidents/7/recording"), "{shown}");
    let stored = console_data.path().join("recordings/a/incident-7.mcap");
    assert_eq!(fs::read(&stored).unwrap(), content);
    assert_eq!(stored.metadata().unwrap().permissions().mode() & 0o777, 0o600);
    let answer = console.ask(Method::GET, "/vehicles/a/incidents/7/recording").await;
    assert_eq!(answer.status(), StatusCode::OK);
    assert_eq!(to_bytes(answer.into_body(), 1 << 26).await.unwrap(), content);
    let identity = Identity::read(&hub.key_file("console")).unwrap();
    let pieces = Logs::open(&hub.address(), &identity).await.unwrap().pieces();
    let is_empty = async {
        for number in 0..=40 {
            while pieces
                .read(&VehicleId::new("a").unwrap(), &finished.sha256, number)
                .await
                .unwrap()
                .is_some()
            {
                tokio::time::sleep(LOOK_EVERY).await;
            }
        }
    };
    until("the end of the pieces", is_empty).await;

    // Here it stays, through another restart, until somebody removes it.
    console.end().await;
    let console = Running::start(&hub, &console_data).await;
    console.recording_is(7, "here").await;
    let said = console.store.audit_entries(None, 100).await.unwrap();
    let count =
        |action: &str| said.iter().filter(|it| it.action == action && it.target.starts_with("a/7")).count();
    assert_eq!(["recording asked for", "recording stored", "recording exported"].map(count), [2, 1, 1]);

    // What the vehicle does not send is said; one that nobody asked for comes by itself.
    vehicle.news.send(incident(8, 20, &"ab".repeat(32))).await.unwrap();
    console.recording_is(8, "none").await;
    assert_eq!(console.fetch(8).await, StatusCode::SEE_OTHER);
    assert_eq!(until("the wish", vehicle.wanted.recv()).await, Some(8));
    vehicle.news.send(refused(8, NotSent::Gone)).await.unwrap();
    let shown = console.recording_is(8, "refused").await;
    assert!(shown.contains("does not have it any more"), "{shown}");
    vehicle.news.send(incident(9, content.len() as u64, &finished.sha256)).await.unwrap();
    vehicle.finished.send(Finished { incident: 9, by_itself: true, ..finished }).await.unwrap();
    console.recording_is(9, "here").await;
    vehicle.end().await;
    console.end().await;
}

#[tokio::test]
async fn what_is_not_the_recording_that_was_told_is_removed_counted_and_said() {
    let mut hub = Hub::start("forged").await;
    hub.enrol("a");
    let console_data = TempDir::new().unwrap();
    let console = Running::start(&hub, &console_data).await;
    let id = VehicleId::new("a").unwrap();
    let identity = Identity::read(&hub.key_file("a")).unwrap();
    let line = Line::open(&hub.address(), &id, &identity).await.unwrap();
    let hostile = line.requests();
    let sha = |number: u64| format!("{number:064x}");
    let mut n = 0;
    let mut told = Vec::new();
    for (number, pieces) in [(1, 2), (2, 2), (3, 1), (4, 1)] {
        let bytes = if pieces == 2 { PIECE_BYTES as u64 + 5 } else { 5 };
        let mut said = serde_json::json!({ "kind": "recording", "incident": number });
        let file = serde_json::to_value(Pieces::of(&sha(number), bytes)).unwrap();
        said.as_object_mut().unwrap().extend(file.as_object().unwrap().clone());
        if number == 4 {
            said["sha256"] = "../../../../etc/passwd".into();
        }
        for mut content in [serde_json::to_value(incident(number, bytes, &sha(number))).unwrap(), said] {
            n += 1;
            for (key, value) in [("epoch", "0000000100000000".into()), ("n", n.into()), ("at", AT_MS.into())]
            {
                content[key] = value;
            }
            told.push(content.to_string());
        }
    }
    let told: Vec<&str> = told.iter().map(String::as_str).collect();
    hostile.log(0, Batch::pack(&id, identity.public(), AT_MS, &told).unwrap()).await;
    // Other content, a piece that is too small, and one piece too many.
    hostile.piece(&sha(1), 0, vec![1; PIECE_BYTES]).await;
    hostile.piece(&sha(1), 1, vec![1; 5]).await;
    hostile.piece(&sha(2), 0, vec![1; 7]).await;
    hostile.piece(&sha(3), 0, vec![1; 5]).await;
    hostile.piece(&sha(3), 1, vec![1; 5]).await;
    for (number, why) in [(1, "another hash"), (2, "a wrong size"), (3, "more pieces")] {
        let shown = console.recording_is(number, "bad").await;
        assert!(shown.contains(why), "{shown}");
    }
    console.recording_is(4, "none").await;
    let vehicles = console.vehicles().await;
    assert_eq!(vehicles[0]["refused"], 4, "{vehicles}");
    assert!(
        vehicles[0]["refused_why"].as_str().unwrap().starts_with("the recording of its incident"),
        "{vehicles}"
    );
    let left: Vec<_> = fs::read_dir(console_data.path().join("recordings/a")).unwrap().collect();
    assert!(left.is_empty(), "{left:?}");
    assert_eq!(console.page("/vehicles/a/incidents/1/recording").await.0, StatusCode::NOT_FOUND);
    console.end().await;
}
