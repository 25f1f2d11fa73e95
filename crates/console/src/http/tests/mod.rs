//! Routes and methods: none acts, and each asks for a session where it shows something.

mod guests;
mod oidc;
#[path = "../../../../../tests/it/schemas.rs"]
mod schemas;
mod what_ifs;

use std::path::Path;
use std::sync::Arc;

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::{Method, Request, StatusCode, header};
use axum::response::Response;
use serde_json::Value;
use telltale_clock::Clock;
use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::time::{Since, Span};
use telltale_fleet::message::{
    Batch, Cause, Content, Epoch, Head, Incident, Message, Node, NodeStates, VehicleId,
};
use telltale_fleet::reading::Stream;
use telltale_store::{DemoSecrets, Role, Store};
use telltale_web::{Examiner, Origins};
use tower::ServiceExt as _;

use super::{Console, router};
use crate::follow::Shared;
use crate::oidc::Oidc;
use crate::state::{Arrived, Fleet};
use schemas::Strict;

const SECRET: &str = "three words apart";
const HOSTILE: &str = "<img src=x onerror=alert(1)>";

/// A console with one vehicle, and users of each role.
async fn console() -> (Router, Shared, Store) {
    console_in(Path::new("/nowhere")).await
}

async fn console_in(data: &Path) -> (Router, Shared, Store) {
    let (clock, hand) = Clock::standing();
    hand.advance(Span::from_secs(1000));
    console_with(data, clock, None).await
}

async fn console_with(data: &Path, clock: Clock, oidc: Option<Arc<Oidc>>) -> (Router, Shared, Store) {
    let store = Store::in_memory(clock, DemoSecrets::Refused).unwrap();
    for role in [Role::ControlRoom, Role::Engineer, Role::Authority, Role::Developer] {
        store.add_user(role.as_str(), role, SECRET).await.unwrap();
    }
    let mut fleet = Fleet::new([], 0, Since::of_age(Span::ZERO, clock.now()));
    fleet.line_opened(clock.now());
    let shared = Shared::new(fleet, clock);
    let head = Head {
        name: HOSTILE.into(),
        state: State::Error,
        cause: Some(Cause { node: "sensors/lidar".into(), words: HOSTILE.into() }),
        since: 1_780_000_000_000,
        stage: Stage::Standby,
        drives: false,
        speed_kmh: Some(0),
        unacknowledged: 1,
        version: "0.1.0".into(),
        config: "c0ffee".into(),
        last: 1,
        ending: false,
    };
    let node = |name: &str, state, cause: Option<&str>| Node {
        node: name.into(),
        state,
        own: State::Error,
        cause: cause.map(str::to_owned),
        words: "no data".into(),
        gone: false,
    };
    let nodes = vec![
        node("sensors", State::Error, None),
        node("sensors/lidar", State::Error, None),
        node("planning/route", State::Ignore, Some("sensors/lidar")),
    ];
    let keyframe = Content::Keyframe(NodeStates { stage: Stage::Standby, nodes });
    for (stream, content) in [(Stream::Head, Content::Head(head)), (Stream::Log, keyframe)] {
        let id = VehicleId::new("a").unwrap();
        let epoch = Epoch { start: 1, nonce: 0 };
        let messages = vec![Message { epoch, n: 1, at: 1_780_000_000_000, content }];
        let batch = Batch { id: id.clone(), key: "UA".into(), sent: 1_780_000_000_000, messages };
        let (stored_ms, age) = (1_780_000_000_000, Span::ZERO);
        shared.fleet().take(Arrived { stream, id, batch: Ok(batch), stored_ms, age }, clock.now());
    }
    let origins = Origins::of_listener("127.0.0.1:8080".parse().unwrap(), false);
    let examiner = Examiner(Box::new(|_, _| Err(Vec::new())));
    let console = Console::new(shared.clone(), store.clone(), data, origins, false);
    (router(console.with_what_ifs(data, examiner).with_oidc(oidc)), shared, store)
}

async fn ask(router: &Router, method: Method, path: &str, cookie: &str, body: &str) -> Response {
    ask_for("application/json", router, method, path, cookie, body).await
}

async fn ask_for(
    kind: &str,
    router: &Router,
    method: Method,
    path: &str,
    cookie: &str,
    body: &str,
) -> Response {
    let request = Request::builder()
        .method(method)
        .uri(path)
        .header(header::HOST, "127.0.0.1:8080")
        .header(header::ORIGIN, "http://127.0.0.1:8080")
        .header(header::COOKIE, cookie)
        .header(header::ACCEPT, kind)
        .header(header::CONTENT_TYPE, "application/x-www-form-urlencoded")
        .body(Body::from(body.to_owned()))
        .unwrap();
    router.clone().oneshot(request).await.unwrap()
}

async fn log_in(router: &Router, name: &str, secret: &str) -> Response {
    let form = format!("name={name}&secret={}", secret.replace(' ', "+"));
    ask(router, Method::POST, "/login", "", &form).await
}

async fn cookie(router: &Router, name: &str) -> String {
    let answer = log_in(router, name, SECRET).await;
    assert_eq!(answer.status(), StatusCode::OK, "{name}");
    let cookie = answer.headers()[header::SET_COOKIE].to_str().unwrap().to_owned();
    assert!(cookie.contains("HttpOnly; SameSite=Strict"), "{cookie}");
    cookie.split(';').next().unwrap().to_owned()
}

async fn json(router: &Router, path: &str, cookie: &str) -> Value {
    let answer = ask(router, Method::GET, path, cookie, "").await;
    assert_eq!(answer.status(), StatusCode::OK, "{path}");
    serde_json::from_slice(&to_bytes(answer.into_body(), 1 << 20).await.unwrap()).unwrap()
}

const READ: [&str; 22] = [
    "/",
    "/overview",
    "/overview?q=a",
    "/vehicles/a",
    "/vehicles/a?log=1h",
    "/vehicles/a?at=2026-05-28T20:26:40Z",
    "/vehicles/a/state",
    "/vehicles/a/log?log=14d",
    "/api/v1/vehicles",
    "/api/v1/vehicles?format=csv",
    "/api/v1/vehicles/a/snapshot",
    "/api/v1/vehicles/a/snapshot?at=2026-05-28T20:26:40Z",
    "/api/v1/vehicles/a/history",
    "/api/v1/vehicles/a/log",
    "/api/v1/vehicles/a/incidents",
    "/api/v1/groups",
    "/api/v1/openapi.json",
    "/api/v1/incidents",
    "/api/v1/incidents?group=version",
    "/api/v1/what-ifs",
    "/incidents",
    "/incidents?group=config",
];

#[tokio::test]
async fn every_route_and_method_but_login_and_logout_only_reads() {
    let (router, shared, _store) = console().await;
    let session = cookie(&router, "control_room").await;
    let before = format!("{:?}", shared.fleet());
    let methods = ["POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "CONNECT", "BREW"];
    for method in methods.map(|it| Method::from_bytes(it.as_bytes()).unwrap()) {
        for cookie in ["", session.as_str()] {
            for path in READ.iter().chain(&["/healthz", "/readyz"]) {
                let status = ask(&router, method.clone(), path, cookie, "").await.status();
                assert_eq!(status, StatusCode::METHOD_NOT_ALLOWED, "{method} {path}");
            }
            for path in
                ["/vehicle/stop", "/vehicle/clearance", "/vehicle/release", "/alarms/1/acknowledge", "/ws"]
            {
                let status = ask(&router, method.clone(), path, cookie, "").await.status();
                assert_eq!(status, StatusCode::NOT_FOUND, "{method} {path}");
            }
        }
    }
    assert_eq!(
        ask(&router, Method::GET, "/vehicle/stop", &session, "").await.status(),
        StatusCode::NOT_FOUND
    );
    for (method, path) in [
        (Method::GET, "/vehicles/a/incidents/7/fetch"),
        (Method::PUT, "/vehicles/a/incidents/7/fetch"),
        (Method::POST, "/vehicles/a/incidents/7/recording"),
        (Method::DELETE, "/vehicles/a/incidents/7/recording"),
        (Method::PUT, "/incidents/what-if"),
        (Method::GET, "/what-ifs/1/cancel"),
        (Method::POST, "/what-ifs/1"),
        (Method::DELETE, "/api/v1/what-ifs/1"),
    ] {
        let status = ask(&router, method, path, &session, "").await.status();
        assert_eq!(status, StatusCode::METHOD_NOT_ALLOWED, "{path}");
    }
    assert_eq!(
        ask(&router, Method::GET, "/logout", &session, "").await.status(),
        StatusCode::METHOD_NOT_ALLOWED
    );
    assert_eq!(format!("{:?}", shared.fleet()), before);
}

#[tokio::test]
async fn what_is_shown_needs_a_session_of_a_console() {
    let (router, _shared, store) = console().await;
    for path in READ {
        let status = ask(&router, Method::GET, path, "", "").await.status();
        let expected = if path == "/" { StatusCode::SEE_OTHER } else { StatusCode::UNAUTHORIZED };
        assert_eq!(status, expected, "{path}");
    }
    // The log of a vehicle lies at the hub, which is not there.
    let of_log = ["/history", "/a/log", "at=2026-05-28T20:26:40Z"];
    let status = |path: &str| match of_log.iter().any(|end| path.ends_with(end)) {
        true => StatusCode::SERVICE_UNAVAILABLE,
        false => StatusCode::OK,
    };
    for role in Role::OF_CONSOLE {
        let session = cookie(&router, role.as_str()).await;
        for path in READ {
            assert_eq!(ask(&router, Method::GET, path, &session, "").await.status(), status(path), "{path}");
        }
        assert_eq!(ask(&router, Method::POST, "/logout", &session, "").await.status(), StatusCode::OK);
        let after = ask(&router, Method::GET, "/overview", &session, "").await;
        assert_eq!(after.status(), StatusCode::UNAUTHORIZED);
    }
    assert_eq!(log_in(&router, "developer", SECRET).await.status(), StatusCode::FORBIDDEN);
    let user = store.authenticate("developer", SECRET).await.unwrap().unwrap();
    let (token, _) = store.open_session(&user).await.unwrap();
    let foreign = ask(&router, Method::GET, "/overview", &format!("telltale={}", token.as_str()), "").await;
    assert_eq!(foreign.status(), StatusCode::UNAUTHORIZED, "a session of a vehicle");
    for path in ["/healthz", "/readyz", "/login"] {
        assert_eq!(ask(&router, Method::GET, path, "", "").await.status(), StatusCode::OK, "{path}");
    }
    let first = log_in(&router, "control_room", SECRET).await;
    let mut known = first.headers().get_all(header::SET_COOKIE).iter().filter_map(|it| it.to_str().ok());
    let known = known.next_back().unwrap().to_owned();
    assert!(known.starts_with("telltale-device="), "{known}");
    for _ in 0..3 {
        assert_eq!(log_in(&router, "control_room", "wrong").await.status(), StatusCode::UNAUTHORIZED);
    }
    let waits = log_in(&router, "control_room", SECRET).await;
    assert_eq!(waits.status(), StatusCode::TOO_MANY_REQUESTS);
    assert!(waits.headers().contains_key(header::RETRY_AFTER));
    // A browser from which the user logged in before does not wait for strangers.
    let known = known.split(';').next().unwrap();
    let form = format!("name=control_room&secret={}", SECRET.replace(' ', "+"));
    assert_eq!(ask(&router, Method::POST, "/login", known, &form).await.status(), StatusCode::OK);
    let said: Vec<String> = store
        .audit_entries(None, 100)
        .await
        .unwrap()
        .iter()
        .map(|it| format!("{} {}", it.action, it.who))
        .collect();
    for expected in ["login control_room", "logout authority"] {
        assert!(said.iter().any(|it| it == expected), "{expected}: {said:?}");
    }
}

#[tokio::test]
async fn a_foreign_page_neither_logs_in_nor_out_and_a_foreign_name_reads_nothing() {
    let (router, ..) = console().await;
    let session = cookie(&router, "engineer").await;
    let foreign = |path: &str, host: &str, origin: &str| {
        let request = Request::builder()
            .method(if path == "/overview" { Method::GET } else { Method::POST })
            .uri(path)
            .header(header::HOST, host)
            .header(header::ORIGIN, origin)
            .header(header::COOKIE, &session);
        router.clone().oneshot(request.body(Body::empty()).unwrap())
    };
    for path in ["/login", "/logout"] {
        let answer = foreign(path, "127.0.0.1:8080", "http://elsewhere.example").await.unwrap();
        assert_eq!(answer.status(), StatusCode::FORBIDDEN, "{path}");
    }
    let answer = foreign("/overview", "elsewhere.example", "http://127.0.0.1:8080").await.unwrap();
    assert_eq!(answer.status(), StatusCode::MISDIRECTED_REQUEST);
}

#[tokio::test]
async fn programs_read_the_vehicles_with_their_causes() {
    let (router, ..) = console().await;
    let session = cookie(&router, "engineer").await;
    let vehicles = json(&router, "/api/v1/vehicles", &session).await;
    let vehicle = &vehicles[0];
    assert_eq!(vehicle["id"], "a");
    assert_eq!((&vehicle["state"], &vehicle["contact"]), (&Value::from("error"), &Value::from("live")));
    assert_eq!(vehicle["cause"]["node"], "sensors/lidar");
    assert_eq!(
        (&vehicle["stage"], &vehicle["since"]),
        (&"standby".into(), &"2026-05-28T20:26:40.000Z".into())
    );
    assert_eq!((&vehicle["version"], &vehicle["config"]), (&"0.1.0".into(), &"c0ffee".into()));
    assert_eq!(vehicle["age_s"], 0.0);
    let snapshot = json(&router, "/api/v1/vehicles/a/snapshot", &session).await;
    assert_eq!(snapshot["roots"], serde_json::json!([{ "node": "sensors/lidar", "masks": 1 }]));
    assert_eq!((&snapshot["overall"], &snapshot["whole"]), (&"error".into(), &true.into()));
    assert_eq!(snapshot["groups"][1]["modules"][0]["message"], "no data");
    for path in
        ["/api/v1/vehicles/b/snapshot", "/api/v1/vehicles/B%2F/snapshot", "/api/v1/vehicles/b/history"]
    {
        assert_eq!(ask(&router, Method::GET, path, &session, "").await.status(), StatusCode::NOT_FOUND);
    }
    let wrong = ask(&router, Method::GET, "/api/v1/incidents?group=colour", &session, "").await;
    assert_eq!(wrong.status(), StatusCode::BAD_REQUEST);
}

#[tokio::test]
async fn a_vehicle_has_a_page_with_its_faults_and_who_waits_for_them() {
    let (router, shared, _store) = console().await;
    let session = cookie(&router, "authority").await;
    let page = async |path: &str| {
        let request = Request::get(path)
            .header(header::HOST, "127.0.0.1:8080")
            .header(header::COOKIE, &session)
            .header(header::ACCEPT, "text/html");
        let answer = router.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap();
        let status = answer.status();
        let body = to_bytes(answer.into_body(), 1 << 20).await.unwrap();
        (status, String::from_utf8(body.to_vec()).unwrap())
    };
    let (status, shown) = page("/vehicles/a").await;
    assert_eq!(status, StatusCode::OK);
    assert!(!shown.contains("<img") && shown.contains("&#60;img"), "{shown}");
    for expected in [
        "<b>no data</b> <small>sensors/lidar</small>",
        "one waits for it: planning/route",
        "The log cannot be read now",
        "data-contact=\"live\"",
    ] {
        assert!(shown.contains(expected), "{expected}: {shown}");
    }
    assert!(!shown.contains("<form method=\"post\" action=\"/v"), "{shown}");
    shared.fleet().line_ended("cut", shared.clock.now());
    let (_, part) = page("/vehicles/a/state").await;
    assert!(part.starts_with("<div id=\"state\"") && part.contains("data-contact=\"hub_down\""), "{part}");
    assert!(part.contains("class=\"age\""), "{part}");
    for path in ["/vehicles/b", "/vehicles/b/state", "/vehicles/B%2F", "/vehicles/b/log", "/nowhere"] {
        let (status, shown) = page(path).await;
        assert_eq!(status, StatusCode::NOT_FOUND, "{path}");
        assert!(shown.contains("Back to the fleet") && !shown.contains("the vehicle"), "{path}: {shown}");
    }
    assert_eq!(page("/vehicles/a?log=2h").await.0, StatusCode::BAD_REQUEST);
}

/// Tells a console of more vehicles: each third one in ERROR, with one of two versions.
fn tell_of(shared: &Shared, count: u64) {
    for n in 1..=count {
        let is_ill = n.is_multiple_of(3);
        let head = Head {
            name: format!("Nr. {n}"),
            state: if is_ill { State::Error } else { State::Ok },
            cause: is_ill.then(|| Cause { node: "can/bus".into(), words: "=bus, silent".into() }),
            since: 1_780_000_000_000,
            stage: Stage::Active,
            drives: true,
            speed_kmh: Some(9),
            unacknowledged: 0,
            version: if is_ill { "0.2.0" } else { "0.1.0" }.into(),
            config: "c0ffee".into(),
            last: 1,
            ending: false,
        };
        let id = VehicleId::new(&format!("n{n:03}")).unwrap();
        let epoch = Epoch { start: 1, nonce: 0 };
        let messages = vec![Message { epoch, n: 1, at: 1_780_000_000_000, content: Content::Head(head) }];
        let batch = Batch { id: id.clone(), key: "UA".into(), sent: 1_780_000_000_000, messages };
        let (stored_ms, age) = (1_780_000_000_000, Span::ZERO);
        let arrived = Arrived { stream: Stream::Head, id, batch: Ok(batch), stored_ms, age };
        shared.fleet().take(arrived, shared.clock.now());
    }
}

#[tokio::test]
async fn the_overview_goes_with_the_number_of_vehicles_and_finds_some_of_them() {
    let (router, shared, _store) = console().await;
    let session = cookie(&router, "engineer").await;
    let get = async |path: &str| {
        let answer = ask(&router, Method::GET, path, &session, "").await;
        assert_eq!(answer.status(), StatusCode::OK, "{path}");
        String::from_utf8(to_bytes(answer.into_body(), 1 << 22).await.unwrap().to_vec()).unwrap()
    };
    let lines = |page: &str| page.matches("<li id=\"v-").count();
    let few = get("/overview").await;
    assert!(few.contains("data-size=\"few\"") && lines(&few) == 1 && !few.contains("folded"), "{few}");

    tell_of(&shared, 49);
    let some = get("/overview").await;
    assert!(some.contains("data-size=\"some\"") && some.contains("<summary>33 OK</summary>"), "{some}");
    let (in_full, folded) = some.split_once("<details").unwrap();
    assert_eq!((lines(in_full), lines(folded)), (17, 33));
    let found = get("/overview?q=BUS+0.2").await;
    assert!(found.contains("16 vehicles found.") && !found.contains("v-n001"), "{found}");
    assert!(found.contains("data-part=\"/overview?q=BUS%200.2\""), "{found}");
    let hostile = get("/?q=%22%3E%3Cscript%3E").await;
    assert!(!hostile.contains("<script>") && hostile.contains("0 vehicles found."), "{hostile}");

    tell_of(&shared, 499);
    let many = get("/overview").await;
    assert!(many.contains("data-size=\"many\"") && lines(&many) == 10, "{many}");
    assert_eq!(many.matches("<a href=\"/vehicles/").count(), 500 + 10 + 12 + 1);
    assert!(many.contains("<b class=\"count\">166</b>") && many.contains("<b>only 0.2.0</b>"), "{many}");

    let csv = get("/api/v1/vehicles?format=csv&q=n003").await;
    let expected =
        "n003,Nr. 3,error,live,can/bus,\"'=bus, silent\",2026-05-28T20:26:40.000Z,active,9,0,0.0,0.2.0,";
    let mut rows = csv.lines();
    assert!(rows.next().unwrap().starts_with("id,name,state,contact,node,words,"), "{csv}");
    assert!(rows.next().unwrap().starts_with(expected) && rows.next().is_none(), "{csv}");
    let csv = get("/api/v1/incidents?format=csv").await;
    assert_eq!(csv, "group,count,vehicles,versions,first,last,fetched\r\n");
    let csv = get("/api/v1/groups?format=csv&q=n00").await;
    let expected = "contact,state,node,words,count,versions,vehicles\r\n\
        live,error,can/bus,\"'=bus, silent\",3,0.2.0,n003 n006 n009\r\n";
    assert_eq!(csv, expected);
    assert!(many.contains("<a href=\"/?q=can/bus\">can/bus</a>"), "{many}");
}

#[tokio::test]
async fn a_page_escapes_what_vehicles_say_and_shows_no_old_data_as_ok() {
    let (router, shared, _store) = console().await;
    let session = cookie(&router, "control_room").await;
    let page = async || {
        let answer = ask(&router, Method::GET, "/", &session, "").await;
        let policy = answer.headers()[header::CONTENT_SECURITY_POLICY].to_str().unwrap().to_owned();
        assert!(policy.contains("script-src 'self'"), "{policy}");
        String::from_utf8(to_bytes(answer.into_body(), 1 << 20).await.unwrap().to_vec()).unwrap()
    };
    let shown = page().await;
    assert!(!shown.contains("<img") && shown.contains("&#60;img"), "{shown}");
    assert!(shown.contains("data-contact=\"live\""));
    shared.fleet().line_ended("cut", shared.clock.now());
    let shown = page().await;
    assert!(shown.contains("data-contact=\"hub_down\"") && shown.contains("data-hub-down"), "{shown}");
    assert_eq!(ask(&router, Method::GET, "/readyz", "", "").await.status(), StatusCode::OK);
}

/// Tells a console of an incident of vehicle `a`.
fn tell_of_incident(shared: &Shared, number: u64, sha256: Option<String>) {
    let incident = Incident {
        number,
        since: 1_780_000_000_000,
        until: sha256.as_ref().map(|_| 1_780_000_009_000),
        stage: "active".into(),
        causes: vec![HOSTILE.into()],
        triggers: 1,
        version: "0.1.0".into(),
        config: "c0ffee".into(),
        bytes: 1_500_000,
        sha256,
    };
    let id = VehicleId::new("a").unwrap();
    let (epoch, at) = (Epoch { start: 1, nonce: 0 }, 1_780_000_000_000);
    let messages = vec![Message { epoch, n: number + 10, at, content: Content::Incident(incident) }];
    let batch = Ok(Batch { id: id.clone(), key: "UA".into(), sent: at, messages });
    let arrived = Arrived { stream: Stream::Log, id, batch, stored_ms: at, age: Span::ZERO };
    shared.fleet().take(arrived, shared.clock.now());
}

#[tokio::test]
async fn an_engineer_asks_for_a_recording_and_no_other_role_does() {
    let (router, shared, store) = console().await;
    tell_of_incident(&shared, 7, Some("ab".repeat(32)));
    tell_of_incident(&shared, 8, None);
    let of = |number: &str, what: &str| format!("/vehicles/a/incidents/{number}/{what}");
    let button = "action=\"/vehicles/a/incidents/7/fetch\"><button type=\"submit\">Fetch recording";
    for (role, asks, takes) in [
        (Role::ControlRoom, StatusCode::FORBIDDEN, StatusCode::FORBIDDEN),
        (Role::Authority, StatusCode::FORBIDDEN, StatusCode::NOT_FOUND),
        (Role::Engineer, StatusCode::ACCEPTED, StatusCode::NOT_FOUND),
    ] {
        let session = cookie(&router, role.as_str()).await;
        let answer = ask(&router, Method::GET, "/vehicles/a", &session, "").await;
        let page = to_bytes(answer.into_body(), 1 << 20).await.unwrap();
        let page = String::from_utf8(page.to_vec()).unwrap();
        assert!(
            page.contains("<li id=\"incident-7\" data-recording=\"none\">") && page.contains("1.5 MB"),
            "{page}"
        );
        assert!(!page.contains("<img"), "{page}");
        assert_eq!(page.contains(button), role == Role::Engineer, "{page}");
        assert!(!page.contains("incidents/8/fetch"), "it is still recorded: {page}");
        let status = ask(&router, Method::GET, &of("7", "recording"), &session, "").await.status();
        assert_eq!(status, takes, "{role:?}");
        let status = ask(&router, Method::POST, &of("7", "fetch"), &session, "").await.status();
        assert_eq!(status, asks, "{role:?}");
    }
    let session = cookie(&router, "engineer").await;
    let told = json(&router, "/api/v1/vehicles/a/incidents", &session).await;
    assert_eq!((&told[0]["number"], &told[0]["recording"]), (&8.into(), &"none".into()), "{told}");
    assert_eq!((&told[1]["recording"], &told[1]["bytes"]), (&"asked".into(), &1_500_000.into()), "{told}");
    for (number, status) in [
        ("7", StatusCode::ACCEPTED),
        ("8", StatusCode::CONFLICT),
        ("9", StatusCode::NOT_FOUND),
        ("07", StatusCode::NOT_FOUND),
        ("..%2F7", StatusCode::NOT_FOUND),
    ] {
        assert_eq!(
            ask(&router, Method::POST, &of(number, "fetch"), &session, "").await.status(),
            status,
            "{number}"
        );
    }
    for path in [of("7", "fetch"), of("7", "recording")] {
        let method = if path.ends_with("fetch") { Method::POST } else { Method::GET };
        assert_eq!(ask(&router, method, &path, "", "").await.status(), StatusCode::UNAUTHORIZED);
    }
    let foreign = Request::post(of("7", "fetch"))
        .header(header::HOST, "127.0.0.1:8080")
        .header(header::ORIGIN, "http://elsewhere.example")
        .header(header::COOKIE, &session);
    let answer = router.clone().oneshot(foreign.body(Body::empty()).unwrap()).await.unwrap();
    assert_eq!(answer.status(), StatusCode::FORBIDDEN);
    let part = ask(&router, Method::GET, "/vehicles/a/state", &session, "").await;
    let part = String::from_utf8(to_bytes(part.into_body(), 1 << 20).await.unwrap().to_vec()).unwrap();
    assert!(part.contains("data-recording=\"asked\"") && !part.contains(button), "{part}");
    let said = store.audit_entries(None, 100).await.unwrap();
    let asked: Vec<_> = said.iter().filter(|it| it.action == "recording asked for").collect();
    assert_eq!(asked.iter().filter(|it| it.was_refused()).count(), 2);
    assert!(asked.iter().all(|it| it.target == "a/7") && asked.len() == 4, "{asked:?}");
}

#[tokio::test]
async fn each_route_for_programs_is_described_and_answers_as_that() {
    let (router, shared, _store) = console().await;
    tell_of_incident(&shared, 7, Some("ab".repeat(32)));
    let session = cookie(&router, "engineer").await;
    let document = json(&router, "/api/v1/openapi.json", &session).await;
    let mut ids = std::collections::HashSet::new();
    for route in super::routes() {
        let Some((method, _, operation)) = route.told else {
            assert!(!route.path.starts_with("/api/"), "{} is not described", route.path);
            continue;
        };
        let told = &document["paths"][route.path][method.as_str().to_lowercase()];
        assert_eq!(told["operationId"], operation.id, "{}", route.path);
        assert!(ids.insert(operation.id) && !operation.summary.is_empty(), "{}", operation.id);
        assert_eq!(route.path.matches('{').count(), operation.in_path.len(), "{}", route.path);
        let path = route.path.replace("{id}", "a").replace("{number}", "7");
        let answer = ask(&router, method, &path, &session, "").await;
        let status = answer.status().as_str().to_owned();
        let described = &told["responses"][&status];
        assert!(described.is_object(), "{path}: {status} is not described");
        let media = answer.headers()[header::CONTENT_TYPE].to_str().unwrap().to_owned();
        let body = to_bytes(answer.into_body(), 1 << 20).await.unwrap();
        if status == "200" && media == "application/json" {
            let pointer = format!(
                "/paths/{}/get/responses/200/content/application~1json/schema",
                route.path.replace('/', "~1")
            );
            let value = serde_json::from_slice(&body).unwrap();
            assert_eq!(Strict::at(&document, &pointer).fault(&value), None, "{path}");
        }
        if let Some((_, query)) = told["x-curl"].as_str().unwrap().trim_end_matches('"').split_once('?') {
            let answer = ask(&router, Method::GET, &format!("{path}?{query}"), &session, "").await;
            let is_there = matches!(answer.status().as_u16(), 200 | 503);
            assert!(is_there || status == "404", "{path}?{query}: {}", answer.status());
        }
    }
    let described = document["paths"].as_object().unwrap().values();
    assert_eq!(described.map(|it| it.as_object().unwrap().len()).sum::<usize>(), ids.len());
    assert_eq!(document["paths"]["/api/v1/incidents"]["get"]["x-roles"][0], "control_room");
}
