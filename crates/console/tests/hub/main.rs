//! A vehicle, a real hub and a console: nats-server with the configuration that `telltale fleet hub-config` writes.

// Helpers of tests are outside of tests for clippy.
#![allow(clippy::unwrap_used)]

mod past;
mod recordings;
#[path = "../../../fleet/tests/hub/server.rs"]
#[allow(dead_code, reason = "the tests of the vehicle's side use the rest")]
mod server;
#[path = "../../../fleet/tests/hub/vehicle.rs"]
mod vehicle;

use std::time::Duration;

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::{Method, Request, StatusCode, header};
use axum::response::Response;
use futures_util::future::join_all;
use serde_json::Value;
use telltale_clock::{Clock, unix_ms};
use telltale_console::follow::Shared;
use telltale_console::http::{Console, router};
use telltale_console::kept;
use telltale_engine::time::Span;
use telltale_fleet::delivery::Answer;
use telltale_fleet::identity::Identity;
use telltale_fleet::line::{Line, Want};
use telltale_fleet::message::{Batch, Content, Incident, VehicleId};
use telltale_store::{DemoSecrets, Role, Store};
use telltale_web::Origins;
use tempfile::TempDir;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tower::ServiceExt as _;

use server::{Hub, until};
use vehicle::Vehicle;

const LOOK_EVERY: Duration = Duration::from_millis(20);

/// A console in this process, as `telltale fleet serve` starts it.
struct Running {
    router: Router,
    cookie: String,
    /// Of an engineer.
    engineer: String,
    store: Store,
    fetching: JoinHandle<()>,
    following: JoinHandle<()>,
    keeping: JoinHandle<()>,
    end: watch::Sender<bool>,
}

impl Running {
    async fn start(hub: &Hub, data: &TempDir) -> Running {
        let clock = Clock::start();
        let store = Store::open(data.path(), clock, DemoSecrets::Refused).unwrap();
        let mut cookies = Vec::new();
        for role in [Role::ControlRoom, Role::Engineer] {
            let _ = store.add_user(role.as_str(), role, "three words apart").await;
            let user = store.authenticate(role.as_str(), "three words apart").await.unwrap().unwrap();
            let (token, _) = store.open_session(&user).await.unwrap();
            cookies.push(format!("telltale={}", token.as_str()));
        }
        let kept = kept::Store::open(data.path(), clock).unwrap();
        let shared = Shared::new(kept.fleet().unwrap(), clock);
        let identity = Identity::read(&hub.key_file("console")).unwrap();
        let following = tokio::spawn(shared.clone().follow(hub.address(), identity));
        let folder = data.path().join(telltale_console::recordings::FOLDER);
        let fetching = tokio::spawn(shared.clone().fetch(folder, store.clone()));
        let (end, ended) = watch::channel(false);
        let keeping = tokio::spawn(shared.clone().keep(kept, ended));
        let origins = Origins::of_listener("127.0.0.1:8080".parse().unwrap(), false);
        let router = router(Console::new(shared, store.clone(), data.path(), origins, false));
        let [cookie, engineer] = cookies.try_into().unwrap();
        Running { router, cookie, engineer, store, fetching, following, keeping, end }
    }

    /// The answer to an engineer.
    async fn ask(&self, method: Method, path: &str) -> Response {
        let request = Request::builder()
            .method(method)
            .uri(path)
            .header(header::HOST, "127.0.0.1:8080")
            .header(header::ORIGIN, "http://127.0.0.1:8080")
            .header(header::COOKIE, &self.engineer);
        self.router.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap()
    }

    async fn get(&self, path: &str) -> (StatusCode, Value) {
        let request =
            Request::get(path).header(header::HOST, "127.0.0.1:8080").header(header::COOKIE, &self.cookie);
        let answer = self.router.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap();
        let status = answer.status();
        let body = to_bytes(answer.into_body(), 1 << 22).await.unwrap();
        (status, serde_json::from_slice(&body).unwrap_or_default())
    }

    async fn vehicles(&self) -> Value {
        self.get("/api/v1/vehicles").await.1
    }

    /// Waits until the only vehicle is as `is_it` wants it.
    async fn vehicle_with(&self, what: &str, is_it: impl Fn(&Value) -> bool) -> Value {
        let wait = async {
            loop {
                let vehicles = self.vehicles().await;
                if is_it(&vehicles[0]) {
                    return vehicles[0].clone();
                }
                tokio::time::sleep(LOOK_EVERY).await;
            }
        };
        until(what, wait).await
    }

    async fn contact(&self, contact: &str) -> Value {
        self.vehicle_with(contact, |vehicle| vehicle["contact"] == contact).await
    }

    /// Nothing more is written to the disk.
    async fn kill(self) {
        self.following.abort();
        self.fetching.abort();
        self.keeping.abort();
        self.store.close().await;
    }

    async fn end(self) {
        self.following.abort();
        self.fetching.abort();
        self.end.send_replace(true);
        self.keeping.await.unwrap();
        self.store.close().await;
    }
}

#[tokio::test]
async fn a_console_shows_a_vehicle_through_the_loss_of_its_hub_and_its_own_restart() {
    let mut hub = Hub::start("console").await;
    hub.enrol("a");
    let (data, console_data) = (TempDir::new().unwrap(), TempDir::new().unwrap());
    let console = Running::start(&hub, &console_data).await;
    let mut vehicle = Vehicle::start(&hub, "a", &data);
    vehicle.clock_is(true);
    let shown = console.vehicle_with("the WARNING", |it| it["state"] == "warning").await;
    assert_eq!((&shown["id"], &shown["contact"]), (&"a".into(), &"live".into()));
    assert_eq!(
        shown["cause"],
        serde_json::json!({ "node": "telltale/clock", "words": "the clock shows 1970" })
    );
    assert_eq!((&shown["version"], &shown["config"]), (&"0.1.0".into(), &"c0ffee".into()));
    let incident = Incident {
        number: 4,
        since: 1_780_000_000_000,
        until: None,
        stage: "active".into(),
        causes: vec!["telltale/clock".into()],
        triggers: 1,
        version: "0.1.0".into(),
        config: "c0ffee".into(),
        bytes: 0,
        sha256: None,
    };
    vehicle.news.send(Content::Incident(incident)).await.unwrap();
    let incidents = until("the incident", async {
        loop {
            let (_, groups) = console.get("/api/v1/incidents?group=cause").await;
            if groups[0]["count"] == 1 {
                return groups;
            }
            tokio::time::sleep(LOOK_EVERY).await;
        }
    });
    assert_eq!(incidents.await[0]["group"], "telltale/clock");
    let (_, snapshot) = console.get("/api/v1/vehicles/a/snapshot").await;
    assert_eq!((&snapshot["whole"], &snapshot["overall"]), (&true.into(), &"warning".into()), "{snapshot}");
    let (status, history) = console.get("/api/v1/vehicles/a/history?from=2020-01-01T00:00:00Z").await;
    assert_eq!((status, &history["whole"]), (StatusCode::OK, &true.into()), "{history}");
    assert_eq!(history["unknown"], serde_json::json!([]));
    let kinds: Vec<&str> =
        history["messages"].as_array().unwrap().iter().filter_map(|it| it["kind"].as_str()).collect();
    assert!(kinds.contains(&"keyframe") && kinds.contains(&"incident"), "{kinds:?}");
    let (_, later) = console.get("/api/v1/vehicles/a/history?from=2090-01-01T00:00:00Z").await;
    assert_eq!(later["messages"], serde_json::json!([]));

    hub.kill();
    let shown = console.contact("hub_down").await;
    assert_eq!((&shown["state"], &shown["cause"]["node"]), (&"warning".into(), &"telltale/clock".into()));
    assert_eq!(console.get("/readyz").await.0, StatusCode::OK);
    assert_eq!(console.get("/api/v1/vehicles/a/history").await.0, StatusCode::SERVICE_UNAVAILABLE);

    // Another console on the same folder, before the hub answers.
    console.end().await;
    let console = Running::start(&hub, &console_data).await;
    let shown = console.contact("hub_down").await;
    assert_eq!((&shown["id"], &shown["state"]), (&"a".into(), &"warning".into()));
    assert_eq!(console.get("/api/v1/incidents").await.1[0]["count"], 1);

    hub.start_again().await;
    console.contact("live").await;
    vehicle.clock_is(false);
    console.vehicle_with("no WARNING", |it| it["state"] != "warning").await;
    let (_, snapshot) = console.get("/api/v1/vehicles/a/snapshot").await;
    assert_eq!(snapshot["whole"], true, "the log was read again from a keyframe on: {snapshot}");
    vehicle.end().await;
    console.contact("off").await;
    console.end().await;
}

#[tokio::test]
async fn a_hostile_vehicle_changes_nothing_but_itself() {
    let mut hub = Hub::start("hostile").await;
    hub.enrol("a");
    hub.enrol("bad");
    let (data, console_data) = (TempDir::new().unwrap(), TempDir::new().unwrap());
    let console = Running::start(&hub, &console_data).await;
    let _vehicle = Vehicle::start(&hub, "a", &data);
    console.vehicle_with("the vehicle", |it| it["id"] == "a" && it["contact"] == "live").await;
    let seed = std::fs::read_to_string(hub.key_file("bad")).unwrap();
    let hostile = async_nats::ConnectOptions::with_nkey(seed.trim().to_owned())
        .add_root_certificates(hub.address().ca)
        .require_tls(true)
        .custom_inbox_prefix("_INBOX.bad")
        .connect(hub.address().url)
        .await
        .unwrap();
    let goodbye = r#"{"epoch":"ffffffffffffffff","n":1,"at":1780000000000,"kind":"goodbye"}"#;
    let id = |text| VehicleId::new(text).unwrap();
    let of_another = Batch::pack(&id("a"), "UA", 1_780_000_000_000, &[goodbye]).unwrap();
    let no_head = Batch::pack(&id("bad"), "UA", 1_780_000_000_000, &[goodbye]).unwrap();
    for subject in ["tt.1.bad.head", "tt.1.bad.log"] {
        for payload in [&b"\0\xff"[..], b"", &of_another, &vec![7; 200 * 1024]] {
            hostile.publish(subject, payload.to_vec().into()).await.unwrap();
        }
    }
    hostile.publish("tt.1.bad.head", no_head.into()).await.unwrap();
    hostile.publish("tt.1.a.head", of_another.into()).await.unwrap();
    hostile.flush().await.unwrap();
    let wait = async {
        loop {
            let vehicles = console.vehicles().await;
            let bad = vehicles.as_array().unwrap().iter().find(|it| it["id"] == "bad").cloned();
            // Of heads only the last one lies at the hub.
            if bad.as_ref().is_some_and(|it| it["refused"].as_u64() >= Some(5)) {
                return (vehicles, bad.unwrap());
            }
            tokio::time::sleep(LOOK_EVERY).await;
        }
    };
    let (vehicles, bad) = until("what is refused", wait).await;
    assert_eq!((&bad["state"], &bad["age_s"]), (&"unknown".into(), &Value::Null), "{bad}");
    let good = vehicles.as_array().unwrap().iter().find(|it| it["id"] == "a").unwrap();
    assert_eq!((&good["contact"], &good["refused"]), (&"live".into(), &0.into()), "{good}");
    console.end().await;
}

#[tokio::test]
async fn a_console_that_is_killed_knows_all_again_from_the_hub() {
    let mut hub = Hub::start("killed").await;
    hub.enrol("a");
    let (data, console_data) = (TempDir::new().unwrap(), TempDir::new().unwrap());
    let console = Running::start(&hub, &console_data).await;
    let mut vehicle = Vehicle::start(&hub, "a", &data);
    vehicle.clock_is(true);
    console.vehicle_with("the WARNING", |it| it["state"] == "warning").await;
    console.kill().await;
    vehicle.clock_is(false);
    let console = Running::start(&hub, &console_data).await;
    console
        .vehicle_with("the news of its absence", |it| it["contact"] == "live" && it["state"] != "warning")
        .await;
    let whole = async {
        while console.get("/api/v1/vehicles/a/snapshot").await.1["whole"] != true {
            tokio::time::sleep(LOOK_EVERY).await;
        }
    };
    until("the picture", whole).await;
    let (_, history) = console.get("/api/v1/vehicles/a/history").await;
    assert_eq!((&history["unknown"], &history["contradictions"]), (&serde_json::json!([]), &0.into()));
    vehicle.end().await;
    console.contact("off").await;
    console.end().await;
}

#[tokio::test]
async fn a_vehicle_of_a_later_version_with_markup_and_a_wrong_clock_is_read_as_far_as_it_is_known() {
    let mut hub = Hub::start("later").await;
    hub.enrol("a");
    let data = TempDir::new().unwrap();
    let console = Running::start(&hub, &data).await;
    let (id, key) = (VehicleId::new("a").unwrap(), Identity::read(&hub.key_file("a")).unwrap());
    let mut line = Line::open(&hub.address(), &id, &key).await.unwrap();
    // Its clock is a day ahead.
    let at_ms = unix_ms(Clock::start().wall()) + 24 * 3_600_000;
    let markup = "<img src=x onerror=alert(1)>\u{202e}";
    let told = |n: u64, mut content: Value| {
        for (key, value) in [("epoch", "0000000700000009".into()), ("n", n.into()), ("at", at_ms.into())] {
            content[key] = value;
        }
        content["later"] = serde_json::json!({ "key": [1] });
        content.to_string()
    };
    let node =
        serde_json::json!({ "node": markup, "state": "error", "own": "error", "words": markup, "hue": 7 });
    let all = serde_json::json!({ "kind": "keyframe", "stage": "active", "nodes": [node] });
    let alarm = serde_json::json!({
        "kind": "alarm", "number": 1, "node": markup, "active": true, "acknowledged": false, "words": markup
    });
    let messages =
        [told(1, all), told(2, serde_json::json!({ "kind": "teleport", "to": 5 })), told(3, alarm)];
    let messages: Vec<&str> = messages.iter().map(String::as_str).collect();
    let packed = Batch::pack(&id, key.public(), at_ms, &messages).unwrap();
    assert_eq!(line.requests().log(0, packed).await, Answer::Stored(1));
    // One from a clock that no vehicle has, and one whose messages go backwards.
    let impossible = messages[0].replace(&at_ms.to_string(), "9999999999999");
    let packed = Batch::pack(&id, key.public(), at_ms, &[&impossible]).unwrap();
    assert_eq!(line.requests().log(1, packed).await, Answer::Stored(2));
    let packed = Batch::pack(&id, key.public(), at_ms, &[messages[2], messages[1]]).unwrap();
    assert_eq!(line.requests().log(2, packed).await, Answer::Stored(3));
    let head = serde_json::json!({
        "kind": "head", "name": markup, "state": "error", "cause": { "node": markup, "words": markup }, "since": at_ms,
        "stage": "active", "unacknowledged": 1, "version": markup, "config": markup, "last": 3
    });
    let packed = Batch::pack(&id, key.public(), at_ms, &[&told(3, head)]).unwrap();
    line.requests().head(packed).await;

    let shown = console.vehicle_with("the vehicle", |it| it["contact"] == "live" && it["refused"] == 2).await;
    let skew_s = shown["clock_skew_s"].as_f64().unwrap();
    assert!((86_000.0..87_000.0).contains(&skew_s), "{shown}");
    let (_, snapshot) = console.get("/api/v1/vehicles/a/snapshot").await;
    assert_eq!((&snapshot["whole"], &snapshot["seq"]), (&true.into(), &3.into()), "{snapshot}");
    // The moments of its log are those of its clock.
    let then = format!("/vehicles/a?at={at_ms}");
    for (path, said) in [("/", "its clock is 864"), ("/vehicles/a", "onerror"), (&then, "data-replay")] {
        let answer = console.ask(Method::GET, path).await;
        assert_eq!(answer.status(), StatusCode::OK, "{path}");
        let page = to_bytes(answer.into_body(), 1 << 22).await.unwrap();
        let page = String::from_utf8_lossy(&page);
        assert!(
            page.contains(said) && !page.contains("<img") && !page.contains('\u{202e}'),
            "{path}: {page}"
        );
    }
    // Somebody looked at it.
    let wish = until("the wish for live data", line.next()).await.unwrap();
    assert_eq!(wish, Some(Want { live: Some(Span::from_secs(60)), incidents: Vec::new() }));
    console.end().await;
}

#[tokio::test]
async fn five_hundred_vehicles_are_shown_each_with_its_state_and_its_log() {
    const COUNT: usize = 500;
    let ids: Vec<String> = (0..COUNT).map(|n| format!("v{n:03}")).collect();
    let hub = Hub::start_of("many", &ids).await;
    let data = TempDir::new().unwrap();
    let console = Running::start(&hub, &data).await;
    let at_ms = unix_ms(Clock::start().wall());
    let tell = async |n: usize| {
        let (id, key) = (VehicleId::new(&ids[n]).unwrap(), Identity::read(&hub.key_file(&ids[n])).unwrap());
        let line = Line::open(&hub.address(), &id, &key).await.unwrap();
        let state = if n.is_multiple_of(10) { "error" } else { "ok" };
        let head = serde_json::json!({
            "epoch": "0000000700000009", "n": 1, "at": at_ms, "kind": "head", "name": format!("Nr. {n}"), "state": state,
            "cause": { "node": "can/bus", "words": "silent" }, "since": at_ms, "stage": "active", "unacknowledged": 0,
            "version": "0.1.0", "config": "c0ffee", "last": 1
        });
        let all = serde_json::json!({
            "epoch": "0000000700000009", "n": 1, "at": at_ms, "kind": "keyframe", "stage": "active",
            "nodes": [{ "node": "can", "state": state, "own": state }]
        });
        let pack = |message: &Value| Batch::pack(&id, key.public(), at_ms, &[&message.to_string()]).unwrap();
        line.requests().head(pack(&head)).await;
        assert!(matches!(line.requests().log(0, pack(&all)).await, Answer::Stored(_)));
        line
    };
    // They stay connected.
    let mut lines = Vec::new();
    for begin in (0..COUNT).step_by(25) {
        lines.extend(join_all((begin..begin + 25).map(&tell)).await);
    }
    let live = async {
        loop {
            let vehicles = console.vehicles().await;
            let vehicles = vehicles.as_array().unwrap();
            if vehicles.iter().filter(|it| it["contact"] == "live").count() == COUNT {
                return vehicles.clone();
            }
            tokio::time::sleep(LOOK_EVERY).await;
        }
    };
    let vehicles = until("all vehicles", live).await;
    assert!(vehicles[..50].iter().all(|it| it["state"] == "error") && vehicles[50]["state"] == "ok");
    let (_, groups) = console.get("/api/v1/groups").await;
    assert_eq!((&groups[0]["count"], groups.as_array().unwrap().len()), (&50.into(), 1), "{groups}");
    let whole =
        async |id: &str| console.get(&format!("/api/v1/vehicles/{id}/snapshot")).await.1["whole"] == true;
    let logs = async {
        for id in &ids {
            while !whole(id).await {
                tokio::time::sleep(LOOK_EVERY).await;
            }
        }
    };
    until("all logs", logs).await;
    console.end().await;
}
