//! A vehicle as it was: its page and its snapshot of a moment of the log at a real hub.

#[path = "../../../../tests/it/schemas.rs"]
#[allow(dead_code, reason = "the tests of a vehicle's interface use the rest")]
mod schemas;

use telltale_console::state::time;
use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_fleet::message::{Alarm, Epoch, Gap, GapReason, Message, Node, NodeStates};

use schemas::Strict;

use super::*;

fn node(name: &str, state: State, cause: Option<&str>) -> Node {
    let (own, words) = (state, if state == State::Error { "no packets" } else { "" });
    Node { node: name.into(), state, own, cause: cause.map(str::to_owned), words: words.into(), gone: false }
}

fn alarm(acknowledged: bool) -> Content {
    let (node, words) = ("sensors/lidar".to_owned(), "no packets".to_owned());
    Content::Alarm(Alarm { number: 1, node, active: true, acknowledged, words })
}

/// A drive of twenty minutes with a fault, and messages that are missing later.
fn drive(began_ms: i64) -> Vec<Message> {
    let all = |state, cause: Option<&str>| {
        let planning = if cause.is_some() { State::Ignore } else { state };
        vec![
            node("planning", planning, cause),
            node("sensors", state, None),
            node("sensors/lidar", state, None),
        ]
    };
    let stage = |stage, nodes| NodeStates { stage, nodes };
    let told = [
        (1, 60, Content::Keyframe(stage(Stage::Standby, all(State::Ok, None)))),
        (2, 120, Content::Delta(stage(Stage::Active, Vec::new()))),
        (3, 300, alarm(false)),
        (4, 300, Content::Delta(stage(Stage::Active, all(State::Error, Some("sensors/lidar"))))),
        (5, 400, alarm(true)),
        (6, 500, Content::Gap(Gap { to: 8, why: GapReason::Overflow })),
        (9, 600, Content::Delta(stage(Stage::Active, all(State::Ok, None)))),
        (10, 700, Content::Keyframe(stage(Stage::Active, all(State::Ok, None)))),
        (11, 1200, Content::Goodbye),
    ];
    let message = |(n, at_s, content): (u64, i64, Content)| Message {
        epoch: Epoch { start: 7, nonce: 9 },
        n,
        at: began_ms + at_s * 1000,
        content,
    };
    told.into_iter().map(message).collect()
}

/// Tells messages in one batch, after so many others.
async fn tell(hub: &Hub, after: u64, messages: &[Message]) {
    let (id, key) = (VehicleId::new("a").unwrap(), Identity::read(&hub.key_file("a")).unwrap());
    let line = Line::open(&hub.address(), &id, &key).await.unwrap();
    let lines: Vec<String> = messages.iter().map(|it| serde_json::to_string(it).unwrap()).collect();
    let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
    let packed = Batch::pack(&id, key.public(), messages.last().unwrap().at, &lines).unwrap();
    assert_eq!(line.requests().log(after, packed).await, Answer::Stored(after + 1));
}

impl Running {
    async fn html(&self, path: &str) -> (StatusCode, String) {
        let request = Request::get(path)
            .header(header::HOST, "127.0.0.1:8080")
            .header(header::COOKIE, &self.engineer)
            .header(header::ACCEPT, "text/html");
        let answer = self.router.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap();
        let status = answer.status();
        let body = to_bytes(answer.into_body(), 1 << 22).await.unwrap();
        (status, String::from_utf8(body.to_vec()).unwrap())
    }
}

#[tokio::test]
async fn a_vehicle_is_shown_as_it_was_and_what_is_missing_is_not_known() {
    let mut hub = Hub::start("past").await;
    hub.enrol("a");
    let data = TempDir::new().unwrap();
    let console = Running::start(&hub, &data).await;
    // The hub takes it now, as of a vehicle that was offline.
    let began_ms = unix_ms(Clock::start().wall()) - 3_600_000;
    tell(&hub, 0, &drive(began_ms)).await;
    console.vehicle_with("the vehicle", |it| it["id"] == "a").await;
    let then = |at_s: i64| time(began_ms + at_s * 1000);
    let snapshot = async |at_s: i64| {
        let (status, it) = console.get(&format!("/api/v1/vehicles/a/snapshot?at={}", then(at_s))).await;
        assert_eq!((status, &it["moment"]), (StatusCode::OK, &then(at_s).into()), "{it}");
        [&it["contact"], &it["overall"], &it["stage"]].map(|it| it.as_str().unwrap_or_default().to_owned())
    };
    assert_eq!(snapshot(30).await, ["lost", "unknown", ""], "nothing was told yet");
    assert_eq!(snapshot(60).await, ["live", "ok", "standby"]);
    assert_eq!(snapshot(299).await, ["live", "ok", "active"]);
    assert_eq!(snapshot(350).await, ["live", "error", "active"]);
    assert_eq!(snapshot(550).await, ["lost", "error", "active"]);
    assert_eq!(snapshot(650).await, ["lost", "unknown", "active"], "no keyframe came after the gap");
    assert_eq!(snapshot(750).await, ["live", "ok", "active"]);
    assert_eq!(snapshot(1300).await, ["off", "ok", "active"]);

    let document = console.get("/api/v1/openapi.json").await.1;
    for (what, query) in
        [("history", "?from=2020-01-01T00:00:00Z"), ("snapshot", &format!("?at={}", then(350)))]
    {
        let path = format!("~1api~1v1~1vehicles~1{{id}}~1{what}");
        let schema = Strict::at(
            &document,
            &format!("/paths/{path}/get/responses/200/content/application~1json/schema"),
        );
        let (_, answer) = console.get(&format!("/api/v1/vehicles/a/{what}{query}")).await;
        assert_eq!(schema.fault(&answer), None, "{what}");
    }

    let page = async |at_s: i64| {
        let (status, page) = console.html(&format!("/vehicles/a?at={}", then(at_s))).await;
        assert_eq!(status, StatusCode::OK, "{page}");
        page
    };
    let fault = page(350).await;
    for expected in [
        "data-replay".to_owned(),
        format!("Replay <time datetime=\"{}\">", then(350)),
        "<b>no packets</b> <small>sensors/lidar</small> <small>one waits for it: planning</small>".to_owned(),
        ">unacknowledged</small>".to_owned(),
        "data-reason=\"masked\"".to_owned(),
        format!("href=\"/vehicles/a?at={}&#38;log=24h\" rel=\"prev\"", then(300)),
        format!("href=\"/vehicles/a?at={}&#38;log=24h\" rel=\"next\"", then(400)),
        "<a href=\"/vehicles/a\">Back to now</a>".to_owned(),
        "data-contact=\"live\"".to_owned(),
    ] {
        assert!(fault.contains(&expected), "{expected}: {fault}");
    }
    // It is not followed, and nothing in it is asked for.
    for absent in ["data-part", "data-log", "/fetch", "Telltale ended"] {
        assert!(!fault.contains(absent), "{absent}: {fault}");
    }
    let gone = page(650).await;
    assert!(gone.contains("data-contact=\"lost\"") && gone.contains("<b>Not known</b>"), "{gone}");
    assert!(gone.contains("Messages about this moment are missing") && !gone.contains("Nothing is wrong"));
    let none = page(30).await;
    assert!(none.contains("has no full picture") && !none.contains("class=\"tile\""), "{none}");
    assert!(none.contains("no message of this vehicle from this time") && !none.contains("Nothing happened"));
    assert!(none.contains("aria-disabled=\"true\" rel=\"prev\""), "{none}");
    let off = page(1300).await;
    assert!(off.contains("<b>Telltale ended</b>") || off.contains("<b>Vehicle off</b>"), "{off}");
    assert!(off.contains("1 min before") && off.contains("data-contact=\"off\""), "{off}");
    // The log of now leads there, and its lines to their moments.
    let now = console.html("/vehicles/a").await.1;
    assert!(now.contains(&format!("href=\"/vehicles/a?at={}&amp;log=24h\"", then(1200))), "{now}");
    let csv = async |what: &str| {
        let path = format!("/api/v1/vehicles/a/{what}?format=csv&from={}&to={}", then(250), then(750));
        console.html(&path).await.1
    };
    let line = |at_s: i64, rest: &str| format!("{},{rest}\r\n", then(at_s));
    let expected = ["at,kind,word,text,node\r\n".to_owned()]
        .into_iter()
        .chain([
            line(300, "alarm,Alarm,no packets,sensors/lidar"),
            line(400, "seen,Acknowledged,no packets,sensors/lidar"),
            line(600, "gap,Not known,3 messages are missing: the vehicle had no room for more,"),
        ])
        .collect::<String>();
    assert_eq!(csv("log").await, expected);
    let history = csv("history").await;
    let kinds: Vec<&str> = history.lines().skip(1).filter_map(|row| row.split(',').nth(3)).collect();
    assert_eq!(kinds, ["alarm", "delta", "alarm", "", "delta", "keyframe"], "{history}");
    assert!(history.contains("0000000700000009,6,,,"), "{history}");
    let milliseconds = format!("/vehicles/a?at={}&log=1h", began_ms + 350_000);
    assert!(console.html(&milliseconds).await.1.contains("no packets"));

    for (at, status, said) in [
        ("yesterday", StatusCode::BAD_REQUEST, "at=2026-11-25T15:44:04.5Z"),
        ("", StatusCode::BAD_REQUEST, "at=2026-11-25T15:44:04.5Z"),
        ("2099-01-01T00:00:00Z", StatusCode::NOT_FOUND, "Choose an earlier one"),
        ("9999999999999999", StatusCode::NOT_FOUND, "Choose an earlier one"),
    ] {
        let (found, page) = console.html(&format!("/vehicles/a?at={at}")).await;
        assert!(found == status && page.contains(said), "{at}: {page}");
        let found = console.ask(Method::GET, &format!("/api/v1/vehicles/a/snapshot?at={at}")).await.status();
        assert!(found == status || found == StatusCode::BAD_REQUEST, "{at}: {found}");
    }
    for at in ["0", "-9223372036854775808", "1970-01-01T00:00:00Z"] {
        let (status, page) = console.html(&format!("/vehicles/a?at={at}")).await;
        assert!(status == StatusCode::OK && page.contains("has no full picture"), "{at}: {page}");
    }
    assert_eq!(console.html("/vehicles/b?at=0").await.0, StatusCode::NOT_FOUND);
    console.end().await;
}

#[tokio::test]
async fn a_clock_that_was_ahead_for_a_while_hides_nothing_that_came_after_it() {
    let mut hub = Hub::start("ahead").await;
    hub.enrol("a");
    let data = TempDir::new().unwrap();
    let console = Running::start(&hub, &data).await;
    let now_ms = unix_ms(Clock::start().wall());
    let shown = |state| NodeStates { stage: Stage::Active, nodes: vec![node("sensors", state, None)] };
    let told = [
        (now_ms - 600_000, Content::Keyframe(shown(State::Ok))),
        (now_ms + 365 * 86_400_000, Content::Delta(shown(State::Ok))),
        (now_ms - 300_000, Content::Delta(shown(State::Error))),
    ];
    for (n, (at, content)) in (1..).zip(told) {
        let message = Message { epoch: Epoch { start: 7, nonce: 9 }, n, at, content };
        tell(&hub, n - 1, &[message]).await;
    }
    console.vehicle_with("the vehicle", |it| it["id"] == "a").await;
    let from = time(now_ms - 400_000);
    let (_, history) =
        console.get(&format!("/api/v1/vehicles/a/history?from={from}&to={}", time(now_ms))).await;
    assert_eq!((&history["whole"], &history["messages"][0]["n"]), (&true.into(), &3.into()), "{history}");
    let (_, then) = console.get(&format!("/api/v1/vehicles/a/snapshot?at={}", time(now_ms - 200_000))).await;
    assert_ne!((&then["contact"], &then["overall"]), (&"live".into(), &"ok".into()), "{then}");
    assert_eq!(then["contact"], "lost", "the vehicle's clock ran back over this moment");
}
