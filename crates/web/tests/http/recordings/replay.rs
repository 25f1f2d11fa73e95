//! A recording behind the web server: what is shown goes forwards and back, and nothing acts.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, UNIX_EPOCH};

use axum::http::StatusCode;
use futures_util::SinkExt;
use serde_json::Value;
use telltale_engine::Engine;
use telltale_engine::input::{Input, OperatorAction, StatusArray};
use telltale_engine::time::Timestamp;
use telltale_runtime::{Published, Version};
use telltale_web::live::frame::Frames;
use telltale_web::texts::Lang;
use telltale_web::view::Trends;
use telltale_web::{AppState, Origins, Player, Replay, Settings, router};
use tokio_tungstenite::tungstenite::Message;

use crate::connections::sockets::{Server, next_json};
use crate::fixture::{ADDRESS, Fixture, as_program, form_request, model};

/// Seconds since the beginning of the recording, and what the LiDAR says.
const RECORDED: [(u64, u8, &str); 5] = [
    (1, 0, "fine"),
    (3, 0, "fine, 10 Hz"),
    (5, 2, "no packets"),
    (7, 2, "no packets at all"),
    (9, 0, "fine"),
];

fn recording() -> Vec<Published> {
    let mut engine = Engine::new(Arc::new(model()), Timestamp::ZERO);
    let login = Input::Operator(OperatorAction::Login { name: "anna".into() });
    engine.handle(&login, Timestamp::from_millis(500));
    let take = |&(second, level, words): &(u64, u8, &str)| {
        let mut array = StatusArray::default();
        for (name, level, words) in [("lidar", level, words), ("imu", 0, "fine"), ("tf", 0, "fine")] {
            array.push_status(level, name, words, "");
            array.push_value("hz", &(second * 10).to_string());
        }
        engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(second * 1000));
        let at = UNIX_EPOCH + Duration::from_secs(1_795_176_000 + second);
        Published { replay: true, ..Published::recorded(engine.snapshot(), at) }
    };
    RECORDED.iter().map(take).collect()
}

fn start() -> (Vec<Published>, Player, Replay) {
    let recording = recording();
    let (player, replay) = Player::start(recording[0].clone());
    (recording, player, replay)
}

/// A page as its messages make it: its elements in sight by their ids, and those behind by theirs.
#[derive(Default, PartialEq, Debug)]
struct Page(BTreeMap<String, String>);

impl Page {
    fn take(&mut self, message: &str) {
        let message: Value = serde_json::from_str(message).unwrap();
        for element in elements(message["content"].as_str().unwrap_or_default()) {
            let id = element.split("id=\"").nth(1).and_then(|it| it.split('"').next()).unwrap();
            self.0.insert(id.to_owned(), element.to_owned());
        }
        for (id, html) in message["behind"].as_object().into_iter().flatten() {
            self.0.insert(id.clone(), html.as_str().unwrap().to_owned());
        }
    }
}

/// The elements that stand beside one another in a piece of HTML.
fn elements(html: &str) -> Vec<&str> {
    let (mut found, mut depth, mut start, mut at) = (Vec::new(), 0, 0, 0);
    const VOID: [&str; 4] = ["input", "br", "img", "hr"];
    while let Some(open) = html[at..].find('<').map(|it| at + it) {
        let close = open + html[open..].find('>').expect("a tag ends") + 1;
        let tag = &html[open + 1..close - 1];
        let name = tag.trim_start_matches('/').split([' ', '/', '\n']).next().unwrap_or_default();
        let is_alone = tag.ends_with('/') || VOID.contains(&name) || tag.starts_with('!');
        if !is_alone {
            depth += if tag.starts_with('/') { -1 } else { 1 };
        }
        at = close;
        if depth == 0 {
            found.push(html[start..close].trim());
            start = close;
        }
    }
    found
}

#[test]
fn frames_are_right_forwards_and_back() {
    let (recording, player, replay) = start();
    let (frames, trends) = (Frames::default(), Trends::default());
    let app_published = || replay.snapshots().borrow().clone();
    let (mut page, mut shown) = (Page::default(), None::<Version>);
    let mut rewinds = Vec::new();
    for place in [0, 1, 3, 4, 2, 3, 0, 0, 4, 1] {
        player.show(recording[place].clone());
        let published = app_published();
        rewinds.push(published.rewinds);
        trends.sample(&published);
        for lang in Lang::ALL {
            frames.html(&published, lang, &trends);
        }
        let frame = frames.html(&published, Lang::En, &trends);
        let step = shown.map_or_else(|| Some(frame.full()), |shown| frame.since_with_details(shown, shown));
        page.take(step.as_ref().map_or("{}", |step| step.as_str()));
        shown = Some(frame.revision());
        let mut whole = Page::default();
        whole.take(frame.full().as_str());
        assert_eq!(page, whole, "what changed makes the page of {place}");
        let anew = Frames::default();
        let json = frames.json(&published);
        assert_eq!(json.as_str(), anew.json(&recording[place]).as_str(), "{place}");
        if published.snapshot.seq == recording[place].snapshot.seq && is_first_of(&rewinds) {
            let fresh = anew.html(&recording[place], Lang::En, &trends);
            assert_eq!(frame.full().as_str(), fresh.full().as_str(), "after a step back to {place}");
        }
        let is_broken = page.0["causes"].contains(r#"data-node="sensors/lidar""#);
        assert_eq!(is_broken, RECORDED[place].1 == 2, "{place}: {}", page.0["causes"]);
    }
    assert_eq!(rewinds, [0, 0, 0, 0, 1, 1, 2, 2, 2, 3]);
}

fn is_first_of(rewinds: &[u64]) -> bool {
    matches!(rewinds, [.., before, last] if before != last)
}

#[test]
fn a_step_back_forgets_the_past_of_numbers() {
    let (recording, player, replay) = start();
    let trends = Trends::default();
    let drawn = || trends.of(0, "sensors/lidar", 36).len();
    for place in [0, 1, 2] {
        player.show(recording[place].clone());
        trends.sample(&replay.snapshots().borrow());
    }
    assert_eq!(drawn(), 1);
    player.show(recording[1].clone());
    trends.sample(&replay.snapshots().borrow());
    assert_eq!(drawn(), 0, "it has one sample");
    player.show(recording[2].clone());
    trends.sample(&replay.snapshots().borrow());
    assert_eq!(drawn(), 1);
}

/// What the store holds that somebody could have written.
async fn written(fixture: &Fixture) -> (Vec<String>, usize, bool) {
    let log = fixture.store.audit_entries(None, 1000).await.unwrap();
    let log = log.iter().map(|entry| format!("{entry:?}")).collect();
    (log, fixture.store.sessions().len(), fixture.store.recall().await.unwrap().is_some())
}

#[tokio::test]
async fn nothing_acts_in_a_replay() {
    let mut fixture = Fixture::new().await;
    let mut cookies = Vec::new();
    for name in ["operator", "developer"] {
        cookies.push(fixture.cookie_of(name).await);
    }
    let (recording, player, replay) = start();
    let (store, clock) = (fixture.store.clone(), fixture.clock);
    let showing = |replay: Replay| {
        let settings = Settings::plain(Origins::of_listener(ADDRESS.parse().unwrap(), false), false);
        let app = AppState::new(replay, store.clone(), clock, settings);
        assert!(app.live().is_none());
        router(app)
    };
    fixture.router = showing(replay);
    player.show(recording[2].clone());
    let before = written(&fixture).await;
    let [operator, developer] = &cookies[..] else { panic!("there are two") };
    let seq = recording[2].snapshot.seq;
    for (path, cookie, form) in [
        ("/vehicle/stop", operator, format!("version={seq}")),
        ("/vehicle/localize", operator, format!("version={seq}&stop=depot")),
        ("/vehicle/clearance", operator, format!("version={seq}")),
        ("/vehicle/clearance/confirm", operator, "token=0".to_owned()),
        ("/vehicle/shutdown", operator, String::new()),
        ("/alarms/1/acknowledge", operator, format!("version={seq}")),
        ("/modules/sensors/lidar/reset", operator, format!("version={seq}")),
        ("/developer/configuration/reload", developer, String::new()),
        ("/login", operator, "name=operator&secret=246810".to_owned()),
        ("/logout", operator, String::new()),
    ] {
        let answer = fixture.send(as_program(form_request(path, Some(cookie), &form))).await;
        assert_eq!(answer.status, StatusCode::CONFLICT, "{path}: {}", answer.body);
        assert!(
            answer.body.contains("A recording is shown, so nothing was done."),
            "{path}: {}",
            answer.body
        );
    }
    // A refused request is no reason to write either.
    let answer = fixture.send(form_request("/vehicle/stop", Some(developer), "version=1")).await;
    assert_eq!(answer.status, StatusCode::FORBIDDEN);
    let mut foreign = form_request("/vehicle/stop", Some(operator), "version=1");
    foreign.headers_mut().insert("origin", "http://evil.example".parse().unwrap());
    assert_eq!(fixture.send(foreign).await.status, StatusCode::FORBIDDEN);

    // Every page shows the recording as if nothing had been shown before, forwards and back.
    for place in [2, 4, 1, 3, 0] {
        player.show(recording[place].clone());
        let (_player, alone) = Player::start(recording[place].clone());
        let mut anew = showing(alone);
        for (path, cookie) in [
            ("/api/v1/snapshot", operator),
            ("/", operator),
            ("/developer", developer),
            ("/developer/graph", developer),
            ("/developer/masking", developer),
            ("/developer/why?node=sensors/lidar", developer),
        ] {
            let page = fixture.get(path, Some(cookie)).await;
            std::mem::swap(&mut fixture.router, &mut anew);
            let expected = fixture.get(path, Some(cookie)).await;
            std::mem::swap(&mut fixture.router, &mut anew);
            assert_eq!((page.status, expected.status), (StatusCode::OK, StatusCode::OK), "{path}");
            // Forwards, a button is shown with the version since which its subject is as it is.
            if path != "/" || [1, 0].contains(&place) {
                assert_eq!(page.body, expected.body, "{path} at {place}");
            }
        }
    }
    assert_eq!(written(&fixture).await, before);
}

#[tokio::test]
async fn a_socket_follows_a_replay_back_and_refuses_a_stop() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("operator").await;
    let (recording, player, replay) = start();
    let store = fixture.store.clone();
    let server = Server::showing(replay, fixture, store).await;
    let before = written(&server.fixture).await;
    let mut page = server.connect("/ws", &cookie).await;
    let mut stream = server.connect("/api/v1/stream", &cookie).await;
    next_json(&mut page, |it| it.get("content").is_some()).await;
    for place in [2, 4, 2, 0, 3] {
        player.show(recording[place].clone());
        let seq = recording[place].snapshot.seq;
        next_json(&mut page, |it| it["seq"] == seq && it.get("content").is_some()).await;
        // A page confirms what it shows, also where its number is smaller than the one before.
        page.send(Message::text(format!("{{\"shown\":{seq}}}"))).await.unwrap();
        let beat = next_json(&mut page, |it| it.get("beat").is_some() && it["seq"] == seq).await;
        assert_eq!(beat["at"], format!("2026-11-20T12:00:0{}.000Z", RECORDED[place].0));
        let snapshot = next_json(&mut stream, |it| it["seq"] == seq).await;
        assert_eq!(snapshot["groups"][0]["modules"][0]["message"], RECORDED[place].2);
    }
    // A late confirmation of a state before the step back.
    page.send(Message::text(format!("{{\"shown\":{}}}", recording[4].snapshot.seq))).await.unwrap();
    page.send(Message::text(r#"{"stop":{"version":1,"tap":"t1"}}"#)).await.unwrap();
    let refused = next_json(&mut page, |it| it.get("tap").is_some()).await;
    assert_eq!((refused["tap"].as_str(), refused["status"].as_u64()), (Some("t1"), Some(409)), "{refused}");
    server.shutdown.send(()).unwrap();
    server.served.await.unwrap().unwrap();
    assert_eq!(written(&server.fixture).await, before);
}
