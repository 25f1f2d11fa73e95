//! Guests with roles for some vehicles: nothing of the others is in any answer, and what they may do is a matter of each
//! vehicle.

use super::*;
use crate::state::recordings::Step;
use telltale_fleet::message::{Pieces, Recording};
use telltale_store::audit::Entry;
use telltale_store::{Grant, Grants, Pattern, Token};

const FOREIGN: &str = "robot-9";
/// Words that only the other vehicle has: its id, name, fault, version, configuration and incident.
const SECRETS: [&str; 7] = ["robot-9", "Kiste", "arm/joint", "glows", "9.8.7", "beef99", "2026-05-29"];
const AT: i64 = 1_780_000_000_000;

/// Vehicle `a`, with an incident of the same version as one of the other vehicle's, and a recording of each.
async fn world(folder: &Path) -> (Router, Shared, Store) {
    let (router, shared, store) = console_in(folder).await;
    tell_of_incident(&shared, 7, Some("ab".repeat(32)));
    let tell = |stream, of: &str, n, content| {
        let id = VehicleId::new(of).unwrap();
        let messages = vec![Message { epoch: Epoch { start: 1, nonce: 0 }, n, at: AT, content }];
        let batch = Ok(Batch { id: id.clone(), key: "UB".into(), sent: AT, messages });
        let arrived = Arrived { stream, id, batch, stored_ms: AT, age: Span::ZERO };
        shared.fleet().take(arrived, shared.clock.now());
    };
    let head = Head {
        name: "Kiste".into(),
        state: State::Error,
        cause: Some(Cause { node: "arm/joint".into(), words: "glows".into() }),
        since: AT,
        stage: Stage::Active,
        drives: false,
        speed_kmh: None,
        unacknowledged: 1,
        version: "9.8.7".into(),
        config: "beef99".into(),
        last: 1,
        ending: false,
    };
    tell(Stream::Head, FOREIGN, 1, Content::Head(head));
    let node = Node {
        node: "arm/joint".into(),
        state: State::Error,
        own: State::Error,
        cause: None,
        words: "glows".into(),
        gone: false,
    };
    let keyframe = NodeStates { stage: Stage::Active, nodes: vec![node] };
    tell(Stream::Log, FOREIGN, 1, Content::Keyframe(keyframe));
    for (number, version) in [(7, "0.1.0"), (8, "9.8.7")] {
        let incident = Incident {
            number,
            since: AT + 24 * 3_600_000,
            until: Some(AT + 24 * 3_600_000),
            stage: "active".into(),
            causes: vec!["arm/joint".into()],
            triggers: 1,
            version: version.into(),
            config: "beef99".into(),
            bytes: 1_500_000,
            sha256: Some("cd".repeat(32)),
        };
        tell(Stream::Log, FOREIGN, number, Content::Incident(incident));
    }
    for (of, hash) in [("a", "ab"), (FOREIGN, "cd")] {
        let pieces = Pieces::of(&hash.repeat(32), 1_500_000).unwrap();
        let said = Recording { incident: 7, pieces: Some(pieces.clone()), refused: None };
        tell(Stream::Log, of, 30, Content::Recording(said));
        shared.fleet().recording_is(&VehicleId::new(of).unwrap(), 7, &pieces, Step::Here(pieces.clone()));
    }
    (router, shared, store)
}

fn guest(store: &Store, grants: &[(Role, &str)]) -> String {
    let pattern = |text: &str| Pattern::new(text).unwrap();
    let grant = |(role, text): &(Role, &str)| Grant { role: *role, vehicles: vec![pattern(text)] };
    let grants = Grants::new(grants.iter().map(grant).collect()).unwrap();
    let (token, _): (Token, _) = store.open_guest("gast@id.example", grants).unwrap();
    format!("telltale={}", token.as_str())
}

/// The status, and all that is said.
async fn said(
    router: &Router,
    method: Method,
    path: &str,
    cookie: &str,
    kind: &str,
    body: &str,
) -> (StatusCode, String) {
    let answer = ask_for(kind, router, method, path, cookie, body).await;
    let (status, headers) = (answer.status(), format!("{:?}", answer.headers()));
    let body = to_bytes(answer.into_body(), 1 << 20).await.unwrap();
    (status, headers + &String::from_utf8_lossy(&body))
}

/// Starts a what-if over the incidents of a version, and waits for its end.
async fn run(router: &Router, cookie: &str, version: &str) -> u64 {
    let form = format!("group=version&of={version}&name=a.yaml&text=x");
    let answer = ask(router, Method::POST, "/incidents/what-if", cookie, &form).await;
    assert_eq!(answer.status(), StatusCode::ACCEPTED);
    let body: Value = serde_json::from_slice(&to_bytes(answer.into_body(), 1000).await.unwrap()).unwrap();
    let number = body["number"].as_u64().unwrap();
    while json(router, &format!("/api/v1/what-ifs/{number}"), cookie).await["progress"] != "done" {
        tokio::task::yield_now().await;
    }
    number
}

#[tokio::test]
async fn no_answer_of_any_route_has_anything_of_a_vehicle_that_a_guest_does_not_see() {
    let folder = tempfile::tempdir().unwrap();
    let (router, shared, store) = world(folder.path()).await;
    let engineer = cookie(&router, "engineer").await;
    assert_eq!(run(&router, &engineer, "0.1.0").await, 1);
    let guest = guest(&store, &[(Role::Engineer, "a*"), (Role::Authority, "a")]);
    assert_eq!(run(&router, &guest, "0.1.0").await, 2);
    let before = format!("{:?}", shared.fleet().vehicle(&VehicleId::new(FOREIGN).unwrap()));
    let queries = [
        "",
        "?format=csv",
        "?q=joi",
        "?q=kist",
        "?q=joi&format=csv",
        "?group=version",
        "?group=config",
        "?log=14d",
        "?at=2026-05-28T20:26:40Z",
        "?from=2026-05-01T00:00:00Z&to=2026-06-30T00:00:00Z",
        "?group=version&of=0.1.0",
        "?group=version&of=0.1.0&from=1",
        "?group=cause&of=arm%2Fjoint",
    ];
    let body = "group=cause&of=arm%2Fjoint&name=a.yaml&text=x";
    let (mut asked, mut shown) = (0, 0);
    for route in super::super::routes().into_iter().filter(|it| it.path != "/logout") {
        let route = route.path.replace("/replay/{*path}", "/replay/{id}.{number}");
        for (id, number) in [("a", "7"), (FOREIGN, "7"), (FOREIGN, "8"), ("a", "1"), ("a", "2")] {
            let path = route.replace("{id}", id).replace("{number}", number);
            for (method, query, kind) in [Method::GET, Method::POST].iter().flat_map(|method| {
                let kinds = ["text/html", "application/json"];
                queries.iter().flat_map(move |query| kinds.map(|kind| (method, query, kind)))
            }) {
                let path = format!("{path}{query}");
                let (status, text) = said(&router, method.clone(), &path, &guest, kind, body).await;
                asked += 1;
                shown += usize::from(status == StatusCode::OK);
                for secret in SECRETS {
                    assert!(!text.contains(secret), "{method} {path} says {secret}: {text}");
                }
                // An unknown vehicle is answered alike, so nobody learns that there is this one.
                if id == FOREIGN && route.contains("{id}") {
                    let unknown = path.replace(FOREIGN, "robot-8");
                    let other = said(&router, method.clone(), &unknown, &guest, kind, body).await;
                    assert_eq!((status, text), other, "{method} {path}");
                    assert!(matches!(status.as_u16(), 400 | 404 | 405), "{method} {path}: {status}");
                }
            }
        }
    }
    assert!(asked > 5000 && shown > 500, "{asked} {shown}");
    let after = format!("{:?}", shared.fleet().vehicle(&VehicleId::new(FOREIGN).unwrap()));
    assert_eq!(before, after);
    // The same words are there for a user, so the test looks for the right ones.
    let (_, text) = said(&router, Method::GET, "/api/v1/vehicles", &engineer, "application/json", "").await;
    let (_, more) = said(&router, Method::GET, "/api/v1/incidents", &engineer, "application/json", "").await;
    for secret in SECRETS {
        assert!(text.contains(secret) || more.contains(secret), "{secret}");
    }
}

#[tokio::test]
async fn a_guest_counts_finds_and_judges_its_own_vehicles_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (router, _shared, store) = world(folder.path()).await;
    let engineer = cookie(&router, "engineer").await;
    run(&router, &engineer, "0.1.0").await;
    let guest = guest(&store, &[(Role::Engineer, "a")]);
    let vehicles = json(&router, "/api/v1/vehicles", &guest).await;
    assert_eq!((vehicles.as_array().unwrap().len(), &vehicles[0]["id"]), (1, &"a".into()));
    let groups = json(&router, "/api/v1/incidents?group=version", &guest).await;
    assert_eq!((&groups[0]["count"], &groups[0]["vehicles"]), (&1.into(), &serde_json::json!(["a"])));
    assert_eq!(json(&router, "/api/v1/what-ifs", &guest).await, serde_json::json!([]));
    for path in ["/what-ifs/1", "/what-ifs/1/state", "/api/v1/what-ifs/1"] {
        assert_eq!(ask(&router, Method::GET, path, &guest, "").await.status(), StatusCode::NOT_FOUND);
    }
    let cancel = ask(&router, Method::POST, "/what-ifs/1/cancel", &guest, "").await.status();
    assert_eq!(cancel, StatusCode::NOT_FOUND);
    let own = run(&router, &guest, "0.1.0").await;
    let told = json(&router, &format!("/api/v1/what-ifs/{own}"), &guest).await;
    assert_eq!((&told["incidents"], &told["who"]), (&1.into(), &"gast@id.example".into()));
    assert_eq!(told["rows"].as_array().unwrap().len(), 1);
    let both = json(&router, "/api/v1/what-ifs/1", &engineer).await;
    assert_eq!(both["incidents"], 2);
}

#[tokio::test]
async fn a_guest_does_with_each_vehicle_what_its_role_there_permits() {
    let folder = tempfile::tempdir().unwrap();
    let (router, shared, store) = world(folder.path()).await;
    tell_of_incident(&shared, 9, Some("ef".repeat(32)));
    let fetch = async |cookie: &str, of: &str| {
        let path = format!("/vehicles/{of}/incidents/{}/fetch", if of == "a" { 9 } else { 8 });
        ask(&router, Method::POST, &path, cookie, "").await.status()
    };
    let both = guest(&store, &[(Role::ControlRoom, "a"), (Role::Engineer, "robot-*")]);
    assert_eq!(fetch(&both, "a").await, StatusCode::FORBIDDEN);
    assert_eq!(fetch(&both, FOREIGN).await, StatusCode::ACCEPTED);
    let copies = guest(&store, &[(Role::Authority, "a")]);
    assert_eq!(fetch(&copies, "a").await, StatusCode::FORBIDDEN);
    assert_eq!(fetch(&copies, FOREIGN).await, StatusCode::NOT_FOUND);
    for (cookie, of, status) in [(&both, "a", 403), (&copies, "a", 404), (&copies, FOREIGN, 404)] {
        // Its file is not there.
        let path = format!("/vehicles/{of}/incidents/7/recording");
        assert_eq!(ask(&router, Method::GET, &path, cookie, "").await.status(), status, "{of}");
    }
    let form = "group=version&of=0.1.0&name=a.yaml&text=x";
    let start = ask(&router, Method::POST, "/incidents/what-if", &copies, form).await.status();
    assert_eq!(start, StatusCode::FORBIDDEN);
    let page = said(&router, Method::GET, "/incidents?group=version", &copies, "text/html", "").await.1;
    assert!(page.contains("0.1.0") && !page.contains("/incidents/what-if?"), "{page}");
    assert_eq!(ask(&router, Method::POST, "/logout", &copies, "").await.status(), StatusCode::OK);
    let after = ask(&router, Method::GET, "/overview", &copies, "").await.status();
    assert_eq!(after, StatusCode::UNAUTHORIZED);
    let records = store.audit_entries(None, 100).await.unwrap();
    let is_own = |it: &&Entry| it.action == "logout" && it.who == "gast@id.example" && it.role == "authority";
    assert_eq!(records.iter().filter(is_own).count(), 1);
    let refused = records.iter().filter(|it| it.action == "recording asked for" && it.was_refused());
    assert_eq!(refused.count(), 3);
}
