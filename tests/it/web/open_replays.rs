//! Replays that are open behind the web server: what is below their addresses, and what their page asks for.

use axum::http::{Method, StatusCode};
use serde_json::Value;

use super::fixture::{Fixture, as_program, form_request, request, until};
use super::what_if::Vehicle;

/// A vehicle whose incident 1 is replayed, from a sensor's outage on.
async fn replayed(name: &str) -> Vehicle {
    let vehicle = Vehicle::new(name, 1).await;
    until(async || vehicle.get("/replay/1").await.status == StatusCode::OK).await;
    vehicle
}

#[tokio::test]
async fn what_reads_the_present_is_not_below_a_replay() {
    let vehicle = replayed("replay-present").await;
    for page in ["", "developer", "developer/graph", "developer/search?q=velodyne", "api/v1/snapshot"] {
        let answer = vehicle.get(&format!("/replay/1/screen/{page}")).await;
        assert_eq!(answer.status, StatusCode::OK, "{page}: {}", answer.body);
    }
    for page in [
        "incidents",
        "incidents/1",
        "incidents?cause=a",
        "api/v1/incidents",
        "api/v1/incidents/1",
        "developer/audit",
        "developer/configuration",
        "developer/api",
        "api/v1/audit",
        "/developer/audit",
        "//incidents",
        "%2Fdeveloper/api",
        "developer/%2e%2e/incidents",
        "developer/..%5C..%5Cincidents",
        "developer%2Faudit/",
    ] {
        let answer = vehicle.get(&format!("/replay/1/screen/{page}")).await;
        assert_eq!(answer.status, StatusCode::NOT_FOUND, "{page}: {}", answer.body);
        // The page of the replay may frame what it says, which leads back to the replay.
        let policy = answer.header("content-security-policy").unwrap();
        assert!(policy.contains("frame-ancestors 'self'"), "{page}: {policy}");
        assert!(answer.body.contains("href=\"/replay/1/screen/\""), "{page}: {}", answer.body);
    }
    // The search is that of the shown instant, and knows no incident of the store.
    let found = vehicle.get("/replay/1/screen/developer/search?q=velodyne").await.body;
    assert!(found.contains("=\"/replay/1/screen/developer/why?node=sensors"), "{found}");
    assert!(!found.contains("href=\"/incidents/"), "{found}");
}

#[tokio::test]
async fn the_address_of_a_replay_frames_its_own_screens_only() {
    let vehicle = replayed("replay-framed").await;
    let framed = async |screen: &str| {
        let page = vehicle.get(&format!("/replay/1?screen={screen}")).await.body;
        let (_, frame) = page.split_once("<iframe").unwrap();
        let (_, address) = frame.split_once("src=\"").unwrap();
        address.split_once('"').unwrap().0.to_owned()
    };
    assert_eq!(framed("/developer/graph").await, "/replay/1/screen/developer/graph");
    assert_eq!(framed("/developer/why?node=sensors").await, "/replay/1/screen/developer/why?node=sensors");
    for other in [
        "/developer/audit",
        "/developer/moment",
        "/developer/%252e%252e/%252e%252e/%252e%252e/2/screen/",
        "/developer/..%5C..%5C..%5C2/screen/",
        "/developers",
        "developer",
        "//other.example/developer",
    ] {
        assert_eq!(framed(other).await, "/replay/1/screen/", "{other}");
    }
}

#[tokio::test]
async fn a_screen_of_a_replay_has_no_form_that_acts() {
    let vehicle = replayed("replay-forms").await;
    vehicle.state("at_ms=1800000004000").await;
    let page = vehicle.get("/replay/1/screen/").await.body;
    // There is an alarm, in the list and behind its tile.
    assert!(page.contains("data-node=\"sensors/velodyne_packet_alive\""), "{page}");
    for part in ["method=\"post\"", "action=\"/", "name=\"stop\"", "name=\"acknowledge\"", "sheet-shutdown"] {
        assert!(!page.contains(part), "{part}: {page}");
    }
}

#[tokio::test]
async fn an_order_is_answered_once_the_screens_show_it() {
    let vehicle = replayed("replay-answered").await;
    for round in 0..10_i64 {
        for at_ms in [1_800_000_002_000 + round, 1_800_000_005_000 - round] {
            let state = vehicle.state(&format!("at_ms={at_ms}")).await;
            assert_eq!(state["at_ms"], at_ms);
            let snapshot = vehicle
                .json(request(Method::GET, "/replay/1/screen/api/v1/snapshot", Some(&vehicle.cookie)))
                .await;
            let at = humantime::parse_rfc3339_weak(snapshot["at"].as_str().unwrap()).unwrap();
            let shown_ms = at.duration_since(std::time::UNIX_EPOCH).unwrap().as_millis();
            assert_eq!(shown_ms, at_ms.unsigned_abs().into());
        }
    }
}

#[tokio::test]
async fn a_link_to_the_last_minutes_leads_on_once_they_are_over() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("developer").await;
    let answer = fixture.get("/replay/recent?at=5000&screen=/developer/graph", Some(&cookie)).await;
    let leads_to = "/developer/moment?at=5000&screen=%2Fdeveloper%2Fgraph";
    assert_eq!((answer.status, answer.leads_to()), (StatusCode::SEE_OTHER, Some(leads_to)));
}

impl Vehicle {
    async fn get(&self, path: &str) -> super::fixture::Answer {
        self.fixture.get(path, Some(&self.cookie)).await
    }

    async fn json(&self, asked: axum::http::Request<axum::body::Body>) -> Value {
        let answer = self.fixture.send(as_program(asked)).await;
        assert_eq!(answer.status, StatusCode::OK, "{}", answer.body);
        serde_json::from_str(&answer.body).unwrap()
    }

    /// Sends an order to the replay.
    async fn state(&self, order: &str) -> Value {
        self.json(form_request("/replay/1/state", Some(&self.cookie), order)).await
    }
}
