//! Streams of snapshots for programs: whole, groups alone, changes alone.

use tokio_tungstenite::tungstenite::http::StatusCode;

use crate::connections::sockets::{Server, next_content, next_json};

#[tokio::test]
async fn a_program_gets_whole_snapshots() {
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("operator").await;
    let mut socket = server.connect("/api/v1/stream", &cookie).await;
    let first = next_json(&mut socket, |_| true).await;
    assert_eq!(first["groups"].as_array().unwrap().len(), 3);
    server.break_lidar().await;
    let broken = next_json(&mut socket, |snapshot| snapshot["overall"] == "error").await;
    assert_eq!(broken["roots"][0]["node"], "sensors/lidar");
    assert_eq!(broken["groups"][0]["modules"][0]["message"], "no packets");
}

#[tokio::test]
async fn a_program_may_read_groups_and_changes_alone() {
    let server = Server::new().await;
    let cookie = server.fixture.cookie_of("operator").await;
    for name in ["lidar", "imu", "tf", "planner"] {
        server.fixture.status(name, 0, "fine").await;
    }
    server
        .fixture
        .until(|it| it.modules.iter().take(4).all(|module| &*module.report.message == "fine"))
        .await;
    let mut groups = server.connect("/api/v1/stream?groups", &cookie).await;
    let mut changes = server.connect("/api/v1/stream?deltas", &cookie).await;
    let mut both = server.connect("/api/v1/stream?groups&deltas", &cookie).await;
    for (socket, has_modules) in [(&mut groups, false), (&mut changes, true), (&mut both, false)] {
        let whole = next_json(socket, |_| true).await;
        assert!(whole.get("base").is_none());
        assert_eq!(whole["groups"][0].get("modules").is_some(), has_modules);
        assert_eq!(whole["groups"][0]["groups"][0]["id"], "sensors/inside");
    }
    server.break_lidar().await;
    let group = next_json(&mut groups, |it| it["overall"] == "error").await;
    assert_eq!((&group["groups"][0]["state"], group.get("base")), (&"error".into(), None));
    for (socket, modules) in [(&mut changes, Some(1)), (&mut both, None)] {
        let change = next_json(socket, |it| it["overall"] == "error").await;
        assert!(change["base"].as_u64() < change["seq"].as_u64(), "{change}");
        let named = |list: &str| change[list].as_array().map(Vec::len);
        assert_eq!((named("groups"), named("roots")), (Some(2), Some(1)), "{change}");
        assert_eq!(change["groups"][0]["id"], "sensors");
        assert!(modules.is_none() || change["modules"][0]["message"] == "no packets");
        assert_eq!(change.get("modules").is_some(), modules.is_some());
    }
}

#[tokio::test]
async fn streams_of_programs_take_no_place_of_a_page() {
    let server = Server::new().await;
    let operator = server.fixture.cookie_of("operator").await;
    let mut streams = Vec::new();
    for login in 0..3 {
        let cookie = server.fixture.cookie_of("authority").await;
        let origin = server.origin();
        let headers = [("cookie", cookie.as_str()), ("origin", origin.as_str())];
        for number in 0..16 {
            match server.try_connect("/api/v1/stream", &headers).await {
                Ok(stream) => streams.push(stream),
                Err(status) => {
                    assert_eq!((status, login), (StatusCode::SERVICE_UNAVAILABLE, 2), "{number}");
                }
            }
        }
        let mut page = server.connect("/ws", &cookie).await;
        next_content(&mut page).await;
    }
    assert_eq!(streams.len(), 32, "of one user");
    let mut page = server.connect("/ws", &operator).await;
    next_content(&mut page).await;
    let mut stream = server.connect("/api/v1/stream", &operator).await;
    next_json(&mut stream, |value| value.get("groups").is_some()).await;
}
