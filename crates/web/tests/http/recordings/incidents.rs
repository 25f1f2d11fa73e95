//! Incidents over HTTP: lists with filters, recordings with ranges, marks, notes, and what is kept.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use axum::http::header::RANGE;
use axum::http::{Method, StatusCode};
use serde_json::json;
use telltale_engine::time::Span;
use telltale_msg::fields::Definitions;
use telltale_record::feed::Feed;
use telltale_record::folder::{file_name, folder_in};
use telltale_record::incident::Margins;
use telltale_record::recorder::{Recorder, Settings as RecorderSettings};
use telltale_record::retention::Policy;
use telltale_record::summary::{FrozenNode, Recording, Summary, TriggerLine, kind};
use telltale_record::writer::Place;
use telltale_web::{AppState, Marker, Marking, NotMarked, Origins, RecordingState, Settings, router};
use tokio::sync::watch;

use crate::fixture::{ADDRESS, Answer, Fixture, form_request, request};
use crate::folder::TestFolder;

pub(super) const BYTES: &[u8] = b"\x89MCAP0\r\n a recording \x89MCAP0\r\n";

/// A vehicle with a folder of recordings.
pub(super) struct Recorded {
    pub fixture: Fixture,
    pub data: TestFolder,
    marks: Arc<Mutex<Vec<(String, String)>>>,
    pub fault: watch::Sender<Option<Arc<str>>>,
}

impl Recorded {
    pub async fn new(name: &str) -> Recorded {
        let data = TestFolder::new(&format!("incidents-{name}"));
        std::fs::create_dir_all(folder_in(&data)).unwrap();
        let mut fixture = Fixture::new().await;
        let marks: Arc<Mutex<Vec<(String, String)>>> = Arc::default();
        let noted = marks.clone();
        let mark = move |by: &str, note: &str| {
            noted.lock().unwrap().push((by.to_owned(), note.to_owned()));
            let came_to = match note {
                "unsure" => Err(NotMarked::Unsure { incident: Some(7) }),
                "early" => Err(NotMarked::Unsure { incident: None }),
                "full" => Err(NotMarked::Full),
                _ => Ok(7_u64),
            };
            Box::pin(async move { came_to }) as Marking
        };
        let (fault, faults) = watch::channel(None);
        let (first, clock) = (fixture.link.snapshots.borrow().snapshot.clone(), fixture.clock);
        let recording = RecorderSettings {
            margins: Margins::default(),
            memory: 1 << 20,
            longest_memory: Span::ZERO,
            configuration: Arc::default(),
        };
        let recorder = Recorder::start(Feed::new(clock).1, first, recording, 1, clock).unwrap();
        let settings = Settings {
            recordings: Some(folder_in(&data)),
            marker: Some(Marker::new(mark)),
            recording: Some(RecordingState {
                recorder,
                place: Place {
                    folder: folder_in(&data),
                    definitions: Definitions::default(),
                    about: BTreeMap::new(),
                },
                fault: faults,
                policy: watch::channel(Policy::default()).1,
            }),
            ..Settings::plain(Origins::of_listener(ADDRESS.parse().unwrap(), false), false)
        };
        let (link, store) = (fixture.link.clone(), fixture.store.clone());
        fixture.app = AppState::new(link, store, fixture.clock, settings);
        fixture.router = router(fixture.app.clone());
        Recorded { fixture, data, marks, fault }
    }

    /// An incident of this node, finished or not, with its file.
    pub async fn add(&self, id: u64, node: &str, finished: bool) {
        let sha256 = finished.then(|| format!("{id:064x}"));
        let recording = Recording {
            file: file_name(id),
            bytes: BYTES.len() as u64,
            pre_roll_s: 30.0,
            finished,
            sha256,
            messages: 12,
            ..Recording::default()
        };
        let trigger = TriggerLine {
            at_ms: 1_000,
            kind: kind::ROOT.into(),
            what: node.into(),
            alarm: Some(id),
            note: String::new(),
        };
        let frozen = FrozenNode {
            node: node.into(),
            state: "error".into(),
            message: "no packets".into(),
            values: vec![("rate".into(), "0".into())],
            at_ms: None,
        };
        let summary = Summary {
            id,
            since_ms: 1_000 * id as i64,
            until_ms: finished.then_some(1_000 * id as i64 + 500),
            stage: "active".into(),
            triggers: vec![trigger],
            roots: vec![node.into()],
            freeze: vec![frozen],
            recording,
            ..Summary::default()
        };
        std::fs::write(folder_in(&self.data).join(file_name(id)), BYTES).unwrap();
        match finished {
            true => self.fixture.store.incident_finished(&summary).await.unwrap(),
            false => self.fixture.store.incident_opened(&summary).await.unwrap(),
        }
    }

    async fn ids(&self, query: &str, cookie: &str) -> Vec<u64> {
        let list = self.fixture.get_json(&format!("/api/v1/incidents{query}"), cookie).await;
        list.as_array().unwrap().iter().map(|it| it["id"].as_u64().unwrap()).collect()
    }

    async fn part(&self, path: &str, cookie: &str, range: &str) -> Answer {
        let mut request = request(Method::GET, path, Some(cookie));
        if !range.is_empty() {
            request.headers_mut().insert(RANGE, range.parse().unwrap());
        }
        request.headers_mut().insert("accept-encoding", "gzip, br".parse().unwrap());
        self.fixture.send(request).await
    }
}

#[tokio::test]
async fn programs_list_incidents_and_read_all_of_one() {
    let recorded = Recorded::new("list").await;
    let cookie = recorded.fixture.cookie_of("developer").await;
    assert!(recorded.ids("", &cookie).await.is_empty());
    recorded.add(1, "sensors/velodyne_packet_alive", true).await;
    recorded.add(2, "localization/tf_map", false).await;
    for (query, expected) in [
        ("", vec![2, 1]),
        ("?count=1", vec![2]),
        ("?before=2", vec![1]),
        ("?cause=velo", vec![1]),
        ("?group=localization", vec![2]),
        ("?stage=standby", vec![]),
        ("?marked=true", vec![]),
        ("?kept=false&since=1970-01-01T00:00:01.2Z", vec![2, 1]),
        ("?until=1970-01-01T00:00:01Z", vec![1]),
    ] {
        assert_eq!(recorded.ids(query, &cookie).await, expected, "{query}");
    }
    for wrong in ["?count=0", "?count=-1", "?count=x", "?since=yesterday", "?until=1", "?marked=maybe"] {
        let answer = recorded.fixture.get(&format!("/api/v1/incidents{wrong}"), Some(&cookie)).await;
        assert_eq!(answer.status, StatusCode::BAD_REQUEST, "{wrong}");
        let field = wrong[1..].split('=').next().unwrap();
        assert!(answer.body.contains(field), "{wrong}: {}", answer.body);
    }
    let list = recorded.fixture.get_json("/api/v1/incidents", &cookie).await;
    let (lasts, over) = (&list[0], &list[1]);
    assert_eq!((&lasts["until"], &lasts["recording"]["finished"]), (&json!(null), &json!(false)));
    assert_eq!(over["since"], "1970-01-01T00:00:01.000Z");
    assert_eq!(over["roots"], json!(["sensors/velodyne_packet_alive"]));
    assert_eq!(
        (&over["recording"]["bytes"], &over["recording"]["pre_roll_s"]),
        (&json!(BYTES.len()), &json!(30.0))
    );
    let one = recorded.fixture.get_json("/api/v1/incidents/1", &cookie).await;
    assert_eq!(one["triggers"][0]["what"], "sensors/velodyne_packet_alive");
    assert_eq!(one["freeze"][0]["values"], json!({ "rate": "0" }));
    assert_eq!(one["recording"]["sha256"], format!("{:064x}", 1));
    for missing in ["9", "x", "-1", "99999999999999999999"] {
        let answer = recorded.fixture.get(&format!("/api/v1/incidents/{missing}"), Some(&cookie)).await;
        assert_eq!(answer.status, StatusCode::NOT_FOUND, "{missing}");
    }
}

#[tokio::test]
async fn a_recording_is_sent_whole_or_in_parts_as_it_lies_on_the_disk() {
    let recorded = Recorded::new("download").await;
    let cookie = recorded.fixture.cookie_of("authority").await;
    recorded.add(1, "a/b", true).await;
    recorded.add(2, "a/b", false).await;
    let whole = recorded.part("/incidents/1.mcap", &cookie, "").await;
    assert_eq!((whole.status, whole.body.len()), (StatusCode::OK, String::from_utf8_lossy(BYTES).len()));
    assert_eq!(whole.header("content-length"), Some(&*BYTES.len().to_string()));
    assert_eq!(whole.header("content-encoding"), None);
    assert_eq!(whole.header("content-disposition"), Some("attachment; filename=\"incident-1.mcap\""));
    let part = recorded.part("/incidents/1.mcap", &cookie, "bytes=1-4").await;
    assert_eq!((part.status, &*part.body), (StatusCode::PARTIAL_CONTENT, "MCAP"));
    assert_eq!(part.header("content-range"), Some(&*format!("bytes 1-4/{}", BYTES.len())));
    let beyond = recorded.part("/incidents/1.mcap", &cookie, "bytes=1000-").await;
    assert_eq!(beyond.status, StatusCode::RANGE_NOT_SATISFIABLE);
    let unfinished = recorded.fixture.get("/incidents/2.mcap", Some(&cookie)).await;
    assert_eq!(unfinished.status, StatusCode::CONFLICT);
    std::fs::remove_file(folder_in(&recorded.data).join(file_name(1))).unwrap();
    for missing in ["1.mcap", "3.mcap", "3", "x", "x.mcap", "..%2ftelltale.db", "1.mcap%00"] {
        let answer = recorded.fixture.get(&format!("/incidents/{missing}"), Some(&cookie)).await;
        assert_eq!(answer.status, StatusCode::NOT_FOUND, "{missing}");
    }
}

#[tokio::test]
async fn a_report_is_a_document_of_its_own_for_those_who_may_read_incidents() {
    let recorded = Recorded::new("report").await;
    recorded.add(1, "sensors/<velodyne>", true).await;
    recorded.add(2, "a/b", false).await;
    let get = async |path: &str, cookie: Option<&str>| recorded.fixture.get(path, cookie).await;
    let nobody = get("/incidents/1.html", None).await;
    assert_eq!((nobody.status, nobody.leads_to()), (StatusCode::SEE_OTHER, Some("/login")));
    let operator = recorded.fixture.cookie_of("operator").await;
    assert_eq!(get("/incidents/1.html", Some(&operator)).await.status, StatusCode::FORBIDDEN);
    for role in ["developer", "authority"] {
        let cookie = recorded.fixture.cookie_of(role).await;
        let report = get("/incidents/1.html", Some(&cookie)).await;
        assert_eq!(report.status, StatusCode::OK);
        assert_eq!(report.header("content-type"), Some("text/html; charset=utf-8"));
        assert_eq!(report.header("content-disposition"), Some("inline; filename=\"incident-1.html\""));
        let policy = report.header("content-security-policy").unwrap();
        let own = policy.strip_suffix("; frame-ancestors 'none'").unwrap();
        assert!(own.starts_with("default-src 'none'; style-src 'sha256-"), "{policy}");
        for (name, value) in crate::access::HEADERS.iter().skip(1) {
            assert_eq!(report.header(name), Some(*value), "{name}");
        }
        // No recording has these bytes: that is said, and the rest is there.
        for part in ["sensors/&#60;velodyne&#62;", "Incident report 1", "not as it was recorded"] {
            assert!(report.body.contains(part), "{part}: {}", report.body);
        }
        assert!(
            report.body.contains(&own.replace('\'', "&#39;")),
            "the same holds for a copy: {}",
            report.body
        );
        let german = get("/incidents/1.html", Some(&format!("{cookie}; lang=de"))).await;
        assert!(german.body.contains("Vorfallbericht 1"), "{}", german.body);
        assert_eq!(get("/incidents/2.html", Some(&cookie)).await.status, StatusCode::CONFLICT);
        for missing in ["3.html", "x.html", ".html", "-1.html", "1.html.mcap"] {
            let answer = get(&format!("/incidents/{missing}"), Some(&cookie)).await;
            assert_eq!(answer.status, StatusCode::NOT_FOUND, "{missing}");
        }
    }
    let cookie = recorded.fixture.cookie_of("developer").await;
    let has_link = async |id: u64| {
        let page = get(&format!("/incidents/{id}"), Some(&cookie)).await.body;
        page.contains(&format!("href=\"/incidents/{id}.html\""))
    };
    assert!(has_link(1).await && !has_link(2).await);
    std::fs::remove_file(folder_in(&recorded.data).join(file_name(1))).unwrap();
    let report = get("/incidents/1.html", Some(&cookie)).await;
    assert!(
        report.status == StatusCode::OK && report.body.contains("its file is missing"),
        "{}",
        report.body
    );
    assert!(has_link(1).await);
}

#[tokio::test]
async fn a_mark_has_a_name_a_note_and_a_record() {
    let recorded = Recorded::new("mark").await;
    let operator = recorded.fixture.cookie_of("operator").await;
    let answer = recorded.fixture.post("/api/v1/mark", Some(&operator), "note=it+braked+hard").await;
    assert_eq!((answer.status, &*answer.body), (StatusCode::OK, r#"{"incident":7}"#));
    // Nothing of a note is lost unsaid.
    let long = format!("note={}", "%C3%A4".repeat(1001));
    let answer = recorded.fixture.post("/api/v1/mark", Some(&operator), &long).await;
    assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY);
    assert!(answer.body.contains("at most 2,000 bytes"), "{}", answer.body);
    let mut json = form_request("/api/v1/mark", Some(&operator), r#"{"note":"it braked hard"}"#);
    json.headers_mut().insert("content-type", "application/json".parse().unwrap());
    json.headers_mut().insert("content-length", "25".parse().unwrap());
    let answer = recorded.fixture.send(json).await;
    assert_eq!(answer.status, StatusCode::UNSUPPORTED_MEDIA_TYPE);
    assert!(answer.body.contains("application/x-www-form-urlencoded"), "{}", answer.body);
    let marks = recorded.marks.lock().unwrap().clone();
    assert_eq!(marks, [("operator".to_owned(), "it braked hard".to_owned())]);
    let full = recorded.fixture.post("/api/v1/mark", Some(&operator), "note=full").await;
    assert_eq!(full.status, StatusCode::TOO_MANY_REQUESTS);
    assert!(full.body.contains("It is recorded all the same"), "{}", full.body);
    let log = recorded.fixture.store.audit_entries(None, 5).await.unwrap();
    let mark = log.iter().find(|it| it.target == "7: it braked hard").unwrap();
    assert_eq!((&*mark.action, &*mark.who), ("mark", "operator"));
    // Without a body.
    let mut bare = request(Method::POST, "/api/v1/mark", Some(&operator));
    bare.headers_mut().insert("origin", crate::fixture::OWN_ORIGIN.parse().unwrap());
    assert_eq!(recorded.fixture.send(bare).await.status, StatusCode::OK);
    // By a developer's page.
    let developer = recorded.fixture.cookie_of("developer").await;
    let answer = recorded.fixture.post("/incidents/mark", Some(&developer), "note=here").await;
    assert_eq!((answer.status, answer.leads_to()), (StatusCode::SEE_OTHER, Some("/incidents")));
    assert_eq!(recorded.marks.lock().unwrap().last().unwrap().1, "here");
    // The disk does not take it, or does not say.
    for (note, record) in [("early", "early"), ("unsure", "7: unsure")] {
        let answer = recorded.fixture.post("/api/v1/mark", Some(&operator), &format!("note={note}")).await;
        assert_eq!(answer.status, StatusCode::SERVICE_UNAVAILABLE, "{note}");
        assert!(
            answer.body.contains("it is not sure") && answer.body.contains("Note the time"),
            "{}",
            answer.body
        );
        let log = recorded.fixture.store.audit_entries(None, 1).await.unwrap();
        assert!(log[0].target == record && log[0].was_refused(), "{log:?}");
    }
    // Without a recorder.
    let without = Fixture::new().await;
    let cookie = without.cookie_of("developer").await;
    let answer = without.post("/api/v1/mark", Some(&cookie), "note=x").await;
    assert_eq!(answer.status, StatusCode::SERVICE_UNAVAILABLE);
    assert!(answer.body.contains("Nothing is recorded"), "{}", answer.body);
}

#[tokio::test]
async fn the_operators_page_has_a_mark_and_tells_what_the_recorder_does() {
    let recorded = Recorded::new("sign").await;
    let page = async |user: &str| {
        let cookie = recorded.fixture.cookie_of(user).await;
        recorded.fixture.get("/", Some(&cookie)).await.body
    };
    for (user, may_mark) in [("operator", true), ("developer", true), ("authority", false)] {
        let page = page(user).await;
        assert!(page.contains(" data-recorder=\"ready\""), "{user}");
        assert_eq!(page.contains("name=\"mark\""), may_mark, "{user}");
    }
    recorded.fault.send_replace(Some("the disk is full".into()));
    assert!(page("operator").await.contains(" data-recorder=\"off\""));
    let without = Fixture::new().await;
    let cookie = without.cookie_of("operator").await;
    let page = without.get("/", Some(&cookie)).await.body;
    assert!(!page.contains("data-recorder") && !page.contains("name=\"mark\""));
}

#[tokio::test]
async fn a_developer_writes_notes_and_keeps_incidents() {
    let recorded = Recorded::new("keep").await;
    let cookie = recorded.fixture.cookie_of("developer").await;
    recorded.add(1, "a/b", true).await;
    let post = async |path: &str, form: &str| recorded.fixture.post(path, Some(&cookie), form).await;
    let answer = post("/api/v1/incidents/1/note", "note=worn+cable").await;
    let said: serde_json::Value = serde_json::from_str(&answer.body).unwrap();
    assert_eq!((&said["note"]["text"], &said["note"]["by"]), (&json!("worn cable"), &json!("developer")));
    let answer = post("/api/v1/incidents/1/keep", "kept=true").await;
    assert!(answer.status == StatusCode::OK && answer.body.contains(r#""kept":true"#), "{}", answer.body);
    assert_eq!(recorded.ids("?kept=true", &cookie).await, [1]);
    let long = format!("note={}", "x".repeat(2001));
    for (path, form) in [("1/note", &*long), ("1/note", ""), ("1/keep", "kept=maybe"), ("1/keep", "")] {
        let answer = post(&format!("/api/v1/incidents/{path}"), form).await;
        assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY, "{path} {form}");
    }
    for (path, form) in [("2/note", "note=x"), ("2/keep", "kept=true"), ("x/keep", "kept=true")] {
        let answer = post(&format!("/api/v1/incidents/{path}"), form).await;
        assert_eq!(answer.status, StatusCode::NOT_FOUND, "{path}");
    }
    let log = recorded.fixture.store.audit_entries(None, 3).await.unwrap();
    let said: Vec<(&str, &str)> = log.iter().map(|it| (&*it.action, &*it.target)).take(2).collect();
    assert_eq!(said, [("incident kept", "1"), ("incident note", "1: worn cable")]);
}

#[tokio::test]
async fn pages_show_incidents_whose_recording_is_gone_or_no_recording() {
    let recorded = Recorded::new("pages").await;
    let developer = recorded.fixture.cookie_of("developer").await;
    let page = async |path: &str, cookie: &str| recorded.fixture.get(path, Some(cookie)).await;
    let empty = page("/incidents", &developer).await;
    assert_eq!(empty.status, StatusCode::OK);
    assert!(empty.body.contains("id=\"none\"") && empty.body.contains("/incidents/mark"), "{}", empty.body);
    assert!(!empty.body.contains("recording: false"), "{}", empty.body);
    let without = Fixture::new().await;
    let cookie = without.cookie_of("developer").await;
    let empty = without.get("/incidents", Some(&cookie)).await.body;
    assert!(empty.contains("recording: false") && !empty.contains("/incidents/mark"), "{empty}");
    recorded.add(1, "sensors/<velodyne>", true).await;
    recorded.add(2, "localization/tf_map", false).await;
    let rows = async |query: &str| {
        let list = page(&format!("/incidents{query}"), &developer).await.body;
        let has = |id: u64| list.contains(&format!("data-incident=\"{id}\""));
        [1, 2].into_iter().filter(|id| has(*id)).collect::<Vec<u64>>()
    };
    for (query, expected) in [
        ("", vec![1, 2]),
        ("?cause=VELO", vec![1]),
        ("?group=localization", vec![2]),
        ("?stage=active&marked=false&kept=false", vec![1, 2]),
        ("?marked=true", vec![]),
        ("?before=2", vec![1]),
        ("?marked=maybe&before=x", vec![1, 2]),
    ] {
        assert_eq!(rows(query).await, expected, "{query}");
    }
    let one = page("/incidents/1", &developer).await;
    assert_eq!(one.status, StatusCode::OK);
    for part in ["sensors/&#60;velodyne&#62;", "no packets", "The file is not completed", "name=\"keep\""] {
        assert!(one.body.contains(part), "{part}: {}", one.body);
    }
    std::fs::remove_file(folder_in(&recorded.data).join(file_name(1))).unwrap();
    let one = page("/incidents/1", &developer).await;
    assert!(one.body.contains("The recording is not there any more"), "{}", one.body);
    let json = recorded.fixture.get_json("/api/v1/incidents/1", &developer).await;
    assert_eq!(json["story"], json!(null));
    // A form leads back to the page; an authority has none.
    let answer = recorded.fixture.post("/incidents/1/note", Some(&developer), "note=worn+cable").await;
    assert_eq!((answer.status, answer.header("location")), (StatusCode::SEE_OTHER, Some("/incidents/1")));
    let answer = recorded.fixture.post("/incidents/1/keep", Some(&developer), "kept=true").await;
    assert_eq!(answer.status, StatusCode::SEE_OTHER);
    let authority = recorded.fixture.cookie_of("authority").await;
    let one = page("/incidents/1", &authority).await;
    assert!(one.body.contains("worn cable") && !one.body.contains("name=\"keep\""), "{}", one.body);
    let refused = recorded.fixture.post("/incidents/1/keep", Some(&authority), "kept=false").await;
    assert_eq!(refused.status, StatusCode::FORBIDDEN);
}
