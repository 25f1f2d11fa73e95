//! A what-if over the recordings of a fleet: they come through a real hub, and a console judges them again.

use std::fs;

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::{Method, Request, StatusCode, header};
use serde_json::Value;
use telltale::cli::running::server::what_if::examiner;
use telltale::clock::Clock;
use telltale::console::follow::Shared;
use telltale::console::http::{Console, router};
use telltale::console::{kept, recordings};
use telltale::fleet::identity::Identity;
use telltale::fleet::line::Line;
use telltale::fleet::message::{Content, Incident, PIECE_BYTES, Pieces, Recording, VehicleId};
use telltale::msg::fields::Definitions;
use telltale::record::writer::hash_file;
use telltale::store::{DemoSecrets, Role, Store};
use telltale::web::Origins;
use tower::ServiceExt as _;

use crate::fleet_export::{Hub, LOOK_EVERY, PATIENCE, message};
use crate::what_if::{BEGAN_NS, SHUTTLE, record_outage, without_sensors};

struct Caller {
    router: Router,
    cookie: String,
}

impl Caller {
    async fn ask(&self, method: Method, path: &str, body: String) -> (StatusCode, String) {
        let request = Request::builder()
            .method(method)
            .uri(path)
            .header(header::HOST, "127.0.0.1:8080")
            .header(header::ORIGIN, "http://127.0.0.1:8080")
            .header(header::COOKIE, &self.cookie)
            .header(header::CONTENT_TYPE, "application/x-www-form-urlencoded");
        let answer = self.router.clone().oneshot(request.body(Body::from(body)).unwrap()).await.unwrap();
        let status = answer.status();
        (status, String::from_utf8(to_bytes(answer.into_body(), 1 << 24).await.unwrap().to_vec()).unwrap())
    }

    async fn get(&self, path: &str) -> String {
        let (status, body) = self.ask(Method::GET, path, String::new()).await;
        assert_eq!(status, StatusCode::OK, "{path}");
        body
    }

    /// What programs are told at an address, when `is_it` is true of it.
    async fn told(&self, path: &str, is_it: impl Fn(&Value) -> bool) -> Value {
        let wait = async {
            loop {
                let told = serde_json::from_str(&self.get(path).await).unwrap();
                if is_it(&told) {
                    return told;
                }
                tokio::time::sleep(LOOK_EVERY).await;
            }
        };
        tokio::time::timeout(PATIENCE, wait).await.unwrap_or_else(|_| panic!("{path} is not as expected"))
    }

    /// The result of the what-if with this number over this configuration.
    async fn judged(&self, number: u64, text: &str) -> Value {
        let text: String = text.bytes().map(|it| format!("%{it:02X}")).collect();
        let form = format!("group=cause&of=sensors/velodyne_packet_alive&name=shuttle.yaml&text={text}");
        let (status, _) = self.ask(Method::POST, "/incidents/what-if", form).await;
        assert_eq!(status, StatusCode::SEE_OTHER);
        let is_over = |told: &Value| !["waiting", "running"].contains(&told["progress"].as_str().unwrap());
        self.told(&format!("/api/v1/what-ifs/{number}"), is_over).await
    }
}

#[tokio::test]
async fn the_fetched_recordings_of_a_group_are_judged_by_another_configuration() {
    let hub = Hub::start().await;
    let data = tempfile::tempdir().unwrap();
    let file = data.path().join("outage.mcap");
    record_outage(&file);
    let (content, sha256) = (fs::read(&file).unwrap(), hash_file(&file).unwrap());
    let incident = |number| {
        Content::Incident(Incident {
            number,
            since: BEGAN_NS / 1_000_000,
            until: Some(BEGAN_NS / 1_000_000 + 9000),
            stage: "active".into(),
            causes: vec!["sensors/velodyne_packet_alive".into()],
            triggers: 1,
            version: "0.1.0".into(),
            config: "c0ffee".into(),
            bytes: content.len() as u64,
            sha256: Some(sha256.clone()),
        })
    };
    let pieces = Pieces::of(&sha256, content.len() as u64);
    let comes = Content::Recording(Recording { incident: 1, pieces, refused: None });
    let contents = [incident(1), incident(2), comes].into_iter().zip(1..);
    let at_ms = BEGAN_NS / 1_000_000;
    hub.tell(&[contents.map(|(content, n)| message(at_ms, n, content)).collect()]).await;
    let (id, key) = (VehicleId::new("a").unwrap(), Identity::read(&hub.file("a.nk")).unwrap());
    let line = Line::open(&hub.address(), &id, &key).await.unwrap();
    for (number, piece) in (0..).zip(content.chunks(PIECE_BYTES)) {
        line.requests().piece(&sha256, number, piece.to_vec()).await;
    }

    let clock = Clock::start();
    let store = Store::in_memory(clock, DemoSecrets::Refused).unwrap();
    store.add_user("eva", Role::Engineer, "three words apart").await.unwrap();
    let user = store.authenticate("eva", "three words apart").await.unwrap().unwrap();
    let (token, _) = store.open_session(&user).await.unwrap();
    let shared = Shared::new(kept::Store::open(data.path(), clock).unwrap().fleet().unwrap(), clock);
    let identity = Identity::read(&hub.file("console.nk")).unwrap();
    let following = tokio::spawn(shared.clone().follow(hub.address(), identity));
    let folder = data.path().join(recordings::FOLDER);
    let fetching = tokio::spawn(shared.clone().fetch(folder, store.clone()));
    let origins = Origins::of_listener("127.0.0.1:8080".parse().unwrap(), false);
    let console = Console::new(shared, store, data.path(), origins, false);
    let console = console.with_what_ifs(data.path(), examiner(Definitions::default()));
    let caller = Caller { router: router(console), cookie: format!("telltale={}", token.as_str()) };
    let groups = caller.told("/api/v1/incidents?group=cause", |groups| groups[0]["fetched"] == 1).await;
    assert_eq!(groups[0]["count"], 2, "{groups}");

    // It begins with the recorded configuration, so nothing differs.
    let form = caller.get("/incidents/what-if?group=cause&of=sensors/velodyne_packet_alive").await;
    assert!(form.contains("depends_on: [sensors/velodyne_packet_alive, can/wheel_speed]"), "{form}");
    let told = caller.judged(1, SHUTTLE).await;
    assert_eq!(
        (&told["same"], &told["differs"], &told["unread"]),
        (&1.into(), &0.into(), &0.into()),
        "{told}"
    );

    let told = caller.judged(2, &without_sensors()).await;
    let row = &told["rows"][0];
    assert_eq!(
        (&told["judged"], &told["incidents"], &row["result"]),
        (&1.into(), &2.into(), &"differs".into())
    );
    assert!(row["what"].as_str().unwrap().starts_with("localization"), "{told}");
    assert!(row["at"].as_str().unwrap().starts_with("2027-01-15T08:00:"), "{told}");
    assert!(told["differences"][0].as_str().unwrap().contains("depends_on"), "{told}");
    let page = caller.get("/what-ifs/2").await;
    for expected in
        ["1 of 2 is not fetched.", "1 would have been different", "New alarms", "/vehicles/a?at=2027"]
    {
        assert!(page.contains(expected), "{expected}: {page}");
    }
    assert!(page.contains("data-progress=\"done\"") && !page.contains("data-part"), "{page}");

    let told = caller.judged(3, &SHUTTLE.replacen("timeout: 2s", "timeout: soon", 1)).await;
    assert_eq!(told["progress"], "wrong");
    let line = 1 + SHUTTLE.lines().position(|line| line.contains("timeout: 2s")).unwrap();
    let problem = told["problems"][0].as_str().unwrap();
    assert!(problem.starts_with(&format!("shuttle.yaml:{line}:")), "{problem}");
    let page = caller.get("/what-ifs/3").await;
    assert!(page.contains("timeout: soon") && page.contains("from=3"), "{page}");

    // The recording is replayed as on the vehicle: the operator's screen and the developer's pages, to read.
    let page = caller.get("/vehicles/a").await;
    assert!(page.contains("href=\"/replay/a.1?at=2027-01-15T08:00:00"), "{page}");
    let at = format!("/replay/a.1?at={}", BEGAN_NS / 1_000_000 + 5000);
    let page = caller.get(&at).await;
    assert!(page.contains("a #1") && page.contains("href=\"/vehicles/a#incident-1\""), "{page}");
    let screen = caller.get("/replay/a.1/screen/").await;
    assert!(screen.contains("class=\"page-operator\"") && screen.contains("LiDAR data missing"), "{screen}");
    assert!(caller.get("/replay/a.1/screen/developer").await.contains("velodyne_packet_alive"));
    let (status, place) = caller.ask(Method::POST, "/replay/a.1/state", "step=next".into()).await;
    assert_eq!(status, StatusCode::OK, "{place}");
    for (method, path, expected) in [
        (Method::POST, "/replay/a.1/screen/vehicle/stop", StatusCode::METHOD_NOT_ALLOWED),
        (Method::PUT, "/replay/a.1/state", StatusCode::METHOD_NOT_ALLOWED),
        (Method::GET, "/replay/a.1/screen/developer/audit", StatusCode::NOT_FOUND),
        (Method::GET, "/replay/a.2", StatusCode::NOT_FOUND),
        (Method::GET, "/replay/b.1", StatusCode::NOT_FOUND),
        (Method::GET, "/replay/a.01", StatusCode::NOT_FOUND),
        (Method::GET, "/replay/recent", StatusCode::NOT_FOUND),
        (Method::GET, "/replay/1", StatusCode::NOT_FOUND),
    ] {
        assert_eq!(caller.ask(method, path, String::new()).await.0, expected, "{path}");
    }
    following.abort();
    fetching.abort();
}
