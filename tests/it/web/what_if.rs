//! The page of a what-if: who may run it, what it finds, its mistakes and its bounds.

use std::sync::{Mutex, mpsc};

use axum::http::StatusCode;
use serde_json::{Value, json};
use telltale::cli::running::server::what_if::examiner;
use telltale::msg::fields::Definitions;
use telltale::record::folder::{file_name, folder_in};
use telltale::record::summary::{Recording, Summary, TriggerLine, kind};
use telltale::store::audit::{Action, COMMAND_LINE, Record};
use telltale::web::{AppState, Examiner, Origins, Settings, router};

use super::fixture::{ADDRESS, Answer, Fixture, as_program, form_request, request, until};
use crate::folder::TestFolder;
use crate::what_if::{SHUTTLE, record_outage, without_sensors};

/// A vehicle with recordings of scenario 1.
pub struct Vehicle {
    pub fixture: Fixture,
    data: TestFolder,
    pub cookie: String,
}

impl Vehicle {
    pub async fn new(name: &str, incidents: u64) -> Vehicle {
        Vehicle::examined_by(examiner(Definitions::default()), name, incidents).await
    }

    async fn examined_by(examiner: Examiner, name: &str, incidents: u64) -> Vehicle {
        let data = TestFolder::new(&format!("what-if-{name}"));
        std::fs::create_dir_all(folder_in(&data)).unwrap();
        let mut fixture = Fixture::new().await;
        let settings = Settings {
            recordings: Some(folder_in(&data)),
            what_if: Some(examiner),
            ..Settings::plain(Origins::of_listener(ADDRESS.parse().unwrap(), false), false)
        };
        fixture.app = AppState::new(fixture.link.clone(), fixture.store.clone(), fixture.clock, settings);
        fixture.router = router(fixture.app.clone());
        for id in 1..=incidents {
            record_outage(&folder_in(&data).join(file_name(id)));
            let recording =
                Recording { file: file_name(id), bytes: 9, finished: true, ..Recording::default() };
            let trigger = TriggerLine {
                at_ms: 1_800_000_003_000,
                kind: kind::ROOT.into(),
                what: "sensors/velodyne_packet_alive".into(),
                alarm: None,
                note: String::new(),
            };
            let summary = Summary {
                id,
                since_ms: 1_800_000_003_000,
                until_ms: Some(1_800_000_009_000),
                triggers: vec![trigger],
                recording,
                ..Summary::default()
            };
            fixture.store.incident_finished(&summary).await.unwrap();
        }
        let cookie = fixture.cookie_of("developer").await;
        Vehicle { fixture, data, cookie }
    }

    async fn post(&self, id: u64, text: &str, over: &str) -> Answer {
        let fields = [("name", "shuttle.yaml"), ("text", text), ("over", over)];
        let form = encoded_form(&fields);
        self.fixture.post(&format!("/incidents/{id}/what-if"), Some(&self.cookie), &form).await
    }

    async fn page(&self, path: &str) -> String {
        let answer = self.fixture.get(path, Some(&self.cookie)).await;
        assert_eq!(answer.status, StatusCode::OK, "{path}: {}", answer.body);
        answer.body
    }

    /// What a program is told, once everything is run.
    async fn told(&self, id: u64) -> Value {
        let path = format!("/incidents/{id}/what-if");
        let ask = async || {
            let asked = as_program(request(axum::http::Method::GET, &path, Some(&self.cookie)));
            serde_json::from_str::<Value>(&self.fixture.send(asked).await.body).unwrap()
        };
        until(async || ["done", "wrong"].map(Value::from).contains(&ask().await["progress"])).await;
        ask().await
    }
}

/// The fields of a form.
fn encoded_form(fields: &[(&str, &str)]) -> String {
    let encoded = |text: &str| -> String { text.bytes().map(|byte| format!("%{byte:02X}")).collect() };
    let fields: Vec<String> =
        fields.iter().map(|(name, value)| format!("{name}={}", encoded(value))).collect();
    fields.join("&")
}

#[tokio::test]
async fn the_false_alarms_that_a_dependency_hides_are_on_the_page() {
    let vehicle = Vehicle::new("alarms", 1).await;
    let prefilled = vehicle.page("/incidents/1/what-if").await;
    assert!(
        prefilled.contains("<textarea")
            && prefilled.contains("depends_on: [sensors/velodyne_packet_alive, can/wheel_speed]"),
        "{prefilled}"
    );
    assert!(vehicle.page("/incidents/1").await.contains("href=\"/incidents/1/what-if\""));
    let text = without_sensors().replace('\n', "\r\n");
    let answer = vehicle.post(1, &text, "this").await;
    assert_eq!((answer.status, answer.leads_to()), (StatusCode::SEE_OTHER, Some("/incidents/1/what-if")));
    let told = vehicle.told(1).await;
    assert_eq!(told["progress"], "done", "{told}");
    assert_eq!(
        told["differences"],
        json!([
            "group `localization`: depends_on from [sensors/velodyne_packet_alive, can/wheel_speed] to [can/wheel_speed]"
        ])
    );
    let one = &told["compared"][0];
    assert_eq!(one["alarms_new"], json!(["localization/tf_map", "localization/tf_quality"]), "{one}");
    assert_eq!((&one["incident"], &one["first"]["node"]), (&json!(1), &json!("localization/scan_matching")));
    let page = vehicle.page("/incidents/1/what-if").await;
    for part in [
        "data-progress=\"done\"",
        "localization/scan_matching: Ignored because of sensors/velodyne_packet_alive",
        "href=\"/replay/1?at=1800000004000\"",
        "2 &rarr; <b>4</b>",
        "New alarms: <b>localization/tf_map, localization/tf_quality</b>",
        "data-node=\"localization/tf_quality\"",
        "bar bar-masked",
        "depends_on from [sensors/velodyne_packet_alive, can/wheel_speed] to [can/wheel_speed]",
        "    depends_on: [can/wheel_speed]\n",
    ] {
        assert!(page.contains(part), "{part}: {page}");
    }
    let german =
        vehicle.fixture.get("/incidents/1/what-if", Some(&format!("{}; lang=de", vehicle.cookie))).await;
    assert!(
        german.body.contains("Neue Alarme") && german.body.contains("Erster Unterschied"),
        "{}",
        german.body
    );
    // What was recorded can be had again.
    assert!(
        vehicle
            .page("/incidents/1/what-if?from=recorded")
            .await
            .contains("depends_on: [sensors/velodyne_packet_alive, can/wheel_speed]")
    );
}

#[tokio::test]
async fn the_same_configuration_differs_nowhere_and_all_that_are_kept_can_be_run() {
    let vehicle = Vehicle::new("same", 3).await;
    vehicle.post(1, SHUTTLE, "this").await;
    let told = vehicle.told(1).await;
    assert_eq!(
        (&told["differences"], &told["compared"][0]["differs"]),
        (&json!([]), &json!(false)),
        "{told}"
    );
    let page = vehicle.page("/incidents/1/what-if").await;
    assert!(page.contains("Nothing differs") && page.contains("mean the same"), "{page}");
    let keep = Record::of(Action::IncidentKept, COMMAND_LINE);
    vehicle.fixture.store.keep_incident(3, true, keep).await.unwrap();
    vehicle.post(1, &without_sensors(), "all").await;
    let told = vehicle.told(1).await;
    let ids: Vec<&Value> = told["compared"].as_array().unwrap().iter().map(|it| &it["incident"]).collect();
    assert_eq!(ids, [&json!(1), &json!(3)]);
    let page = vehicle.page("/incidents/1/what-if").await;
    assert!(page.contains("href=\"/incidents/1/what-if?of=3\""), "{page}");
    assert!(vehicle.page("/incidents/1/what-if?of=3").await.contains("of incident 3"));
    // A person has one at a time: a newer one ends it, and one of another incident takes its place.
    vehicle.post(1, &without_sensors(), "all").await;
    vehicle.post(1, SHUTTLE, "this").await;
    let told = vehicle.told(1).await;
    assert_eq!((&told["count"], &told["compared"][0]["differs"]), (&json!(1), &json!(false)), "{told}");
    vehicle.post(2, SHUTTLE, "this").await;
    vehicle.told(2).await;
    assert!(!vehicle.page("/incidents/1/what-if").await.contains("data-progress"));
}

#[tokio::test]
async fn mistakes_and_recordings_that_cannot_be_used_are_told_in_their_place() {
    let vehicle = Vehicle::new("wrong", 2).await;
    let wrong = SHUTTLE.replacen("timeout: 1s", "timeout: <soon>", 1);
    let line = wrong.lines().position(|line| line.contains("<soon>")).unwrap() + 1;
    vehicle.post(1, &wrong, "this").await;
    let told = vehicle.told(1).await;
    let problem = &told["problems"][0];
    assert_eq!((&told["progress"], &problem["line"]), (&json!("wrong"), &json!(line)), "{told}");
    assert_eq!((&problem["file"], &told["compared"]), (&json!("shuttle.yaml"), &json!([])));
    let page = vehicle.page("/incidents/1/what-if").await;
    assert!(page.contains(&format!("data-line=\"{line}\">shuttle.yaml:{line}:")), "{page}");
    assert!(page.contains("timeout: &#60;soon&#62;") && page.contains("expected a duration"), "{page}");
    // A field that no message has.
    let wrong = SHUTTLE.replacen("field: twist.linear.x", "field: twist.linear.w", 1);
    vehicle.post(1, &wrong, "this").await;
    let told = vehicle.told(1).await;
    assert_eq!(told["progress"], "wrong", "{told}");
    // A damaged recording, and one that is gone.
    let path = folder_in(&vehicle.data).join(file_name(2));
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..2000]).unwrap();
    vehicle.post(2, SHUTTLE, "this").await;
    let told = vehicle.told(2).await;
    assert!(told["compared"][0]["error"].as_str().unwrap().contains("no configuration of its own"), "{told}");
    std::fs::remove_file(&path).unwrap();
    vehicle.post(2, SHUTTLE, "this").await;
    assert_eq!(vehicle.told(2).await["compared"][0]["error"], "the recording is missing");
    assert!(vehicle.page("/incidents/2/what-if").await.contains("The recording is missing."));
}

#[tokio::test]
async fn of_the_what_ifs_of_one_person_the_newest_waits_and_the_others_are_gone() {
    let (tell, read) = mpsc::channel();
    let (end, held) = mpsc::channel::<()>();
    let held = Mutex::new(held);
    let examiner = Examiner(Box::new(move |texts, _| {
        tell.send(texts[0].text.clone()).unwrap();
        // Until the other end is dropped.
        let _ = held.lock().unwrap().recv();
        Err(Vec::new())
    }));
    let vehicle = Vehicle::examined_by(examiner, "newest", 1).await;
    vehicle.post(1, "first", "this").await;
    assert_eq!(read.recv().unwrap(), "first");
    for number in 0..20 {
        vehicle.post(1, &number.to_string(), "this").await;
    }
    drop(end);
    assert_eq!(vehicle.told(1).await["progress"], "wrong");
    assert_eq!(read.try_iter().collect::<Vec<_>>(), ["19"]);
}

#[tokio::test]
async fn only_developers_run_one_and_a_form_has_bounds() {
    let vehicle = Vehicle::new("bounds", 1).await;
    for role in ["authority", "operator"] {
        let cookie = vehicle.fixture.cookie_of(role).await;
        let path = "/incidents/1/what-if";
        assert_eq!(vehicle.fixture.get(path, Some(&cookie)).await.status, StatusCode::FORBIDDEN);
        let answer = vehicle.fixture.post(path, Some(&cookie), "name=a&text=b").await;
        assert_eq!(answer.status, StatusCode::FORBIDDEN);
        if role == "authority" {
            let page = vehicle.fixture.get("/incidents/1", Some(&cookie)).await.body;
            assert!(!page.contains("what-if"), "{page}");
        }
    }
    let mut foreign = form_request("/incidents/1/what-if", Some(&vehicle.cookie), "name=a&text=b");
    foreign.headers_mut().insert("origin", "http://evil.example".parse().unwrap());
    assert_eq!(vehicle.fixture.send(foreign).await.status, StatusCode::FORBIDDEN);
    let post = async |form: &str| {
        vehicle.fixture.post("/incidents/1/what-if", Some(&vehicle.cookie), form).await.status
    };
    assert_eq!(post("over=this").await, StatusCode::UNPROCESSABLE_ENTITY);
    let long = |bytes: usize| format!("name=a&text={}", "x".repeat(bytes));
    let large = vehicle.fixture.post("/incidents/1/what-if", Some(&vehicle.cookie), &long(256 * 1024)).await;
    assert_eq!(large.status, StatusCode::PAYLOAD_TOO_LARGE);
    assert!(large.body.contains("larger than 256 KiB"), "{}", large.body);
    assert_eq!(post(&long(1024 * 1024)).await, StatusCode::PAYLOAD_TOO_LARGE);
    assert_eq!(post(&"name=a&text=b&".repeat(65)).await, StatusCode::UNPROCESSABLE_ENTITY);
    assert_eq!(post("name=a&text=b").await, StatusCode::SEE_OTHER);
    assert_eq!(vehicle.told(1).await["progress"], "wrong");
    for missing in ["/incidents/9/what-if", "/incidents/x/what-if"] {
        let answer = vehicle.fixture.post(missing, Some(&vehicle.cookie), "name=a&text=b").await;
        assert_eq!(answer.status, StatusCode::NOT_FOUND, "{missing}");
    }
}
