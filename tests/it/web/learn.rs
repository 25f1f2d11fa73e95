//! The page of learned dependencies: the roles that may have the history evaluated, its proposals, and that only one evaluation runs.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, mpsc};

use axum::http::StatusCode;
use telltale::cli::running::server::learn::learner;
use telltale::cli::running::server::what_if::examiner;
use telltale::clock::Clock;
use telltale::config;
use telltale::engine::model::Parts;
use telltale::msg::fields::Definitions;
use telltale::record::summary::{Recording, Summary};
use telltale::runtime::{ConfigurationText, Written};
use telltale::store::History;
use telltale::web::developer::learn::{Learner, NotLearned};
use tokio::sync::watch;

use super::fixture::{Fixture, until};
use crate::folder::TestFolder;
use crate::learning::{CONFIG, SILENT, past, silent_past};

const PATH: &str = "/developer/learn";

/// A vehicle with this history, the configuration of the command's tests, and this learner.
async fn vehicle(data: &TestFolder, text: &str, learner: Learner) -> Fixture {
    let loaded = config::parse("config.yaml", text).unwrap();
    let mut fixture = Fixture::changed(|parts| *parts = Parts::clone(&loaded.model)).await;
    let (history, _) = History::open(data, Clock::start()).unwrap();
    let texts = [ConfigurationText { name: "config.yaml".into(), text: text.into() }].into();
    fixture.set(|settings| {
        settings.history = Some(history);
        settings.learner = Some(learner);
        settings.what_if = Some(examiner(Definitions::default()));
        settings.written = Some(watch::channel(Arc::new(Written { texts, lines: Default::default() })).1);
    });
    fixture
}

async fn page(fixture: &Fixture, path: &str, cookie: &str) -> String {
    let answer = fixture.get(path, Some(cookie)).await;
    assert_eq!(answer.status, StatusCode::OK, "{path}: {}", answer.body);
    answer.body
}

async fn run(fixture: &Fixture, cookie: &str) {
    let answer = fixture.get(&format!("{PATH}?run=yes"), Some(cookie)).await;
    assert_eq!((answer.status, answer.leads_to()), (StatusCode::SEE_OTHER, Some(PATH)), "{}", answer.body);
}

#[tokio::test]
async fn a_press_has_the_history_evaluated_and_everything_stands_beside_each_proposal() {
    let data = TestFolder::new("learn-page");
    past(&data).await;
    let fixture = vehicle(&data, CONFIG, learner(Definitions::default())).await;
    let recording = Recording { finished: true, ..Recording::default() };
    let summary = Summary { id: 7, until_ms: Some(i64::MAX / 2), recording, ..Summary::default() };
    fixture.store.incident_finished(&summary).await.unwrap();
    // A newer one, without any of the failures.
    let (since_ms, recording) = (i64::MAX / 2, summary.recording.clone());
    let other = Summary { id: 8, since_ms, recording, ..Summary::default() };
    fixture.store.incident_finished(&other).await.unwrap();
    let (developer, authority) = (fixture.cookie_of("developer").await, fixture.cookie_of("authority").await);
    let button = "name=\"run\"";
    assert!(page(&fixture, PATH, &developer).await.contains(button));
    // An authority may only look, and starts nothing.
    let read_only = page(&fixture, &format!("{PATH}?run=yes"), &authority).await;
    assert!(read_only.contains("data-progress=\"none\"") && !read_only.contains(button), "{read_only}");
    run(&fixture, &developer).await;
    let is_done = async || page(&fixture, PATH, &authority).await.contains("data-progress=\"done\"");
    until(is_done).await;
    let found = page(&fixture, PATH, &developer).await;
    for part in [
        "data-kind=\"add\"",
        "in 10 of 10 failures of the cause (72 % to 100 %), ",
        " times as often as by chance (p ",
        "0.5 s after the cause",
        "sensors/lidar began to fail earlier, by about 0.5 s",
        "data-kind=\"remove\"",
        "sensors/camera failed 20 times, and perception/objects in 0 of them (at most 16 %).",
        "/developer/timeline?node=sensors%2Fcamera&#38;node=perception%2Fobjects&#38;span=120&#38;until=",
        "<a href=\"/incidents/7\">incident 7</a>",
        ">+14<",
        "--- config.yaml\n+++ config.yaml\n@@ -8,4 +8,4 @@\n",
        "-        depends_on: [sensors/camera]\n+        depends_on: [sensors/lidar]\n",
        "`check` accepts the changed configuration",
        "href=\"/incidents/7/what-if?from=proposed\"",
    ] {
        assert!(found.contains(part), "{part}: {found}");
    }
    let german = page(&fixture, PATH, &format!("{developer}; lang=de")).await;
    assert!(
        german.contains("bei 10 von 10 Ausfällen der Ursache") && german.contains("um etwa 0,5 s"),
        "{german}"
    );
    assert!(!page(&fixture, PATH, &authority).await.contains("what-if"), "no what-if is for an authority");
    // Nothing is drawn of it unless that is asked for, and nothing is in force.
    let dotted = "class=\"line proposed\"";
    assert!(page(&fixture, "/developer/graph?proposed=yes", &authority).await.contains(dotted));
    assert!(!page(&fixture, "/developer/graph", &developer).await.contains(dotted));
    let tried = page(&fixture, "/incidents/7/what-if?from=proposed", &developer).await;
    assert!(tried.contains("        depends_on: [sensors/lidar]"), "{tried}");
}

#[tokio::test]
async fn a_module_that_is_silent_in_a_state_has_its_when_and_its_counterexamples() {
    let data = TestFolder::new("learn-page-silent");
    silent_past(&data).await;
    let fixture = vehicle(&data, SILENT, learner(Definitions::default())).await;
    let developer = fixture.cookie_of("developer").await;
    run(&fixture, &developer).await;
    until(async || page(&fixture, PATH, &developer).await.contains("data-progress=\"done\"")).await;
    let found = page(&fixture, PATH, &developer).await;
    for part in [
        "<code>when: { signals: { moving: true } }</code>",
        ">moving is false</th><td>silent 29 of 30 times (83 % to 99 %)<",
        "/developer/timeline?node=sensors%2Fwheels&#38;span=120&#38;until=",
    ] {
        assert!(found.contains(part), "{part}: {found}");
    }
    assert!(!found.contains("id=\"patch\""), "there is no dependency to change");
}

#[tokio::test]
async fn one_evaluation_runs_at_once_and_what_is_too_much_is_said() {
    let data = TestFolder::new("learn-once");
    let (end, ended) = mpsc::channel::<()>();
    let (count, ended) = (Arc::new(AtomicUsize::new(0)), Mutex::new(ended));
    let counted = count.clone();
    let held = Learner(Box::new(move |_, _, go_on| {
        counted.fetch_add(1, Ordering::Relaxed);
        ended.lock().unwrap().recv().unwrap();
        assert!(go_on(1 << 20) && !go_on(1 << 30), "its memory has a bound");
        Err(NotLearned::TooMuch)
    }));
    past(&data).await;
    let fixture = vehicle(&data, CONFIG, held).await;
    let developer = fixture.cookie_of("developer").await;
    run(&fixture, &developer).await;
    run(&fixture, &developer).await;
    assert!(page(&fixture, PATH, &developer).await.contains("data-progress=\"running\""));
    end.send(()).unwrap();
    until(async || page(&fixture, PATH, &developer).await.contains("use `telltale learn` there")).await;
    assert_eq!(count.load(Ordering::Relaxed), 1);
    // While the vehicle is locked its past is not shown either.
    let locked = Fixture::new().await;
    let cookie = locked.cookie_of("developer").await;
    assert_eq!(locked.get(&format!("{PATH}?run=yes"), Some(&cookie)).await.status, StatusCode::CONFLICT);
}
