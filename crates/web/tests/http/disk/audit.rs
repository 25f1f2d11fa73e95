//! The audit log: its content, its readers, and that a flood does not fill it.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use axum::http::header::{AUTHORIZATION, ORIGIN};
use axum::http::{Method, StatusCode};
use telltale_engine::Engine;
use telltale_engine::input::{Input, OperatorAction};
use telltale_engine::state::State;
use telltale_engine::time::Timestamp;
use telltale_runtime::Stamped;
use telltale_store::audit::{Action, Entry, Record};
use telltale_web::Peer;

use crate::connections::sockets::Server;
use crate::fixture::{Fixture, as_program, form_request, model, request};
use crate::folder::TestFolder;

/// The records so far, oldest first, as `action who target outcome`.
async fn records(fixture: &Fixture) -> Vec<String> {
    let entries = fixture.store.audit_entries(None, 1000).await.unwrap();
    let line = |entry: &Entry| format!("{} {} {} {}", entry.action, entry.who, entry.target, entry.outcome);
    entries.iter().rev().map(line).filter(|line| !line.starts_with("user added")).collect()
}

#[tokio::test]
async fn what_is_done_and_what_is_refused_is_recorded() {
    let fixture = Fixture::new().await;
    fixture.log_in("operator", "135791").await;
    fixture.log_in("nobody<b>", "135791").await;
    let cookie = fixture.cookie_of("operator").await;
    fixture.get("/developer", Some(&cookie)).await;
    let mut foreign = form_request("/logout", Some(&cookie), "");
    foreign.headers_mut().insert(ORIGIN, "http://evil.example".parse().unwrap());
    fixture.send(foreign).await;
    let mut forged = request(Method::GET, "/api/v1/snapshot", None);
    forged.headers_mut().insert(AUTHORIZATION, format!("Bearer {}", "0".repeat(64)).parse().unwrap());
    fixture.send(forged).await;
    fixture.drive(true).await;
    fixture.post("/logout", Some(&cookie), "").await;
    fixture.drive(false).await;
    fixture.post("/logout", Some(&cookie), "").await;
    let mut records = records(&fixture).await;
    let unknown = records.remove(1);
    assert!(unknown.starts_with("login  (unknown name, "), "{unknown}");
    assert!(unknown.ends_with(") refused: the name or the secret is wrong"), "{unknown}");
    assert_eq!(
        records,
        [
            "login  operator refused: the name or the secret is wrong",
            "login operator operator done",
            "request operator GET /developer refused: Your role does not permit this.",
            "request operator POST /logout refused: This request does not come from a page of this server.",
            "request  GET /api/v1/snapshot refused: the token is not, or no longer, valid",
            "logout operator  refused: [LogoutWhileActive]",
            "logout operator  done",
        ]
    );
    assert_eq!(fixture.store.verify_audit().await.unwrap().breach, None);
}

#[tokio::test]
async fn a_pin_in_the_field_of_the_name_is_not_for_the_readers_of_the_log() {
    let fixture = Fixture::new().await;
    for name in ["246810", "246810", "operatr"] {
        fixture.log_in(name, "246810").await;
    }
    let records = records(&fixture).await;
    let [first, again, other] = &records[..] else { panic!("{records:?}") };
    assert!(first == again && first != other, "repeats can be told apart: {records:?}");
    assert!(records.iter().all(|it| it.contains("(unknown name, ")), "{records:?}");
    assert!(!records.concat().contains("246810") && !records.concat().contains("operatr"));
}

#[tokio::test]
async fn those_who_may_read_the_log_see_it_in_pages_with_whether_it_is_whole() {
    let fixture = Fixture::new().await;
    let authority = fixture.cookie_of("authority").await;
    let operator = fixture.cookie_of("operator").await;
    assert!(fixture.store.record(Record::of(Action::Login, "10.0.0.66").on("<img src=x>"), None).await);
    let page = fixture.get("/developer/audit", Some(&authority)).await;
    assert_eq!(page.status, StatusCode::OK);
    assert!(
        page.body.contains(r#"data-whole="true""#) && page.body.contains("records are as they were written")
    );
    assert!(page.body.contains("&#60;img") && !page.body.contains("<img"), "{}", page.body);
    assert!(!page.body.contains("Older records"));
    assert_eq!(fixture.get("/developer/audit", Some(&operator)).await.status, StatusCode::FORBIDDEN);
    for _ in 0..60 {
        fixture.get("/developer/why?node=x", Some(&operator)).await;
    }
    for _ in 0..50 {
        fixture.cookie_of("authority").await;
    }
    let page = fixture.get("/developer/audit", Some(&authority)).await;
    assert_eq!(page.status, StatusCode::SEE_OTHER, "a user's oldest sessions end");
    let authority = fixture.cookie_of("authority").await;
    let page = fixture.get("/developer/audit", Some(&authority)).await;
    let (_, older) = page.body.split_once("/developer/audit?before=").expect("there is more");
    let older: u64 = older.split('"').next().unwrap().parse().unwrap();
    let page = fixture.get(&format!("/developer/audit?before={older}"), Some(&authority)).await;
    let first = format!("<td class=\"number\" data-head=\"No.\">{}</td>", older - 1);
    assert!(page.body.contains(&first), "{older}");
    // A file gets all rows, whatever page is shown.
    let mut all = request(Method::GET, &format!("/developer/audit?before={older}"), Some(&authority));
    all.headers_mut().insert("telltale-all-rows", "1".parse().unwrap());
    let all = fixture.send(all).await.body;
    assert!(all.contains(&first) && all.contains("<td class=\"number\" data-head=\"No.\">1</td>"), "{older}");
    assert!(all.matches("<tr data-refused").count() > 100 && !all.contains("Older records"));
    for wrong in ["x", "-1", "99999999999999999999"] {
        let answer = fixture.get(&format!("/developer/audit?before={wrong}"), Some(&authority)).await;
        assert_eq!(answer.status, StatusCode::NOT_FOUND, "{wrong}");
    }
}

#[tokio::test]
async fn a_flood_of_refusals_does_not_fill_the_log_and_hides_no_login() {
    let fixture = Fixture::new().await;
    for number in 0..500_u32 {
        let mut login = form_request("/login", None, "name=operator&secret=9999999");
        let source = IpAddr::from((0x0a00_0000 + number).to_be_bytes());
        login.extensions_mut().insert(Peer(SocketAddr::from((source, 1))));
        let answer = fixture.send(as_program(login)).await;
        assert_eq!(answer.status, StatusCode::FORBIDDEN, "a PIN from outside");
    }
    fixture.cookie_of("operator").await;
    let records = records(&fixture).await;
    assert!(records.len() < 70, "{}", records.len());
    assert_eq!(records.last().map(String::as_str), Some("login operator operator done"));
}

#[tokio::test]
async fn records_that_the_disk_refuses_are_written_later() {
    let folder = TestFolder::new("lost");
    let fixture = Fixture::in_folder(&folder).await;
    let cookie = fixture.cookie_of("operator").await;
    let disk = rusqlite::Connection::open(folder.join("telltale.db")).unwrap();
    let full = "CREATE TRIGGER full BEFORE INSERT ON audit BEGIN SELECT RAISE(ABORT, 'no room'); END";
    disk.execute_batch(full).unwrap();
    for _ in 0..3 {
        fixture.get("/developer", Some(&cookie)).await;
    }
    disk.execute_batch("DROP TRIGGER full").unwrap();
    let refused = records(&fixture).await.split_off(1);
    assert_eq!(refused.len(), 3, "{refused:?}");
    assert!(refused.iter().all(|it| it.starts_with("request operator at 20")), "{refused:?}");
}

#[test]
fn storage_that_fails_is_a_warning_until_it_works_again_and_a_reload_does_not_forget_it() {
    let model = Arc::new(model());
    let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
    engine.handle(&Input::Operator(OperatorAction::Login { name: "anna".into() }), Timestamp::ZERO);
    let shown = |engine: &mut Engine| {
        let snapshot = engine.snapshot();
        let node = snapshot.node("telltale/storage").expect("it is always there");
        snapshot.shown(node).0
    };
    assert_eq!(shown(&mut engine), State::Ok);
    for (fault, expected) in [(Some("the disk is full"), State::Warning), (None, State::Ok)] {
        let now = Timestamp::from_millis(1000);
        engine.handle(&Input::Storage { fault: fault.map(Box::from) }, now);
        assert_eq!(shown(&mut engine), expected);
        engine.reload(model.clone(), now);
        assert_eq!(shown(&mut engine), expected, "after a reload");
    }
}

#[tokio::test]
async fn every_change_of_the_stage_is_recorded_however_short() {
    let server = Server::new().await;
    let fixture = &server.fixture;
    fixture.cookie_of("operator").await;
    // All at once: nobody is shown the states between.
    let signal = |value| Input::Signal { name: "active".into(), value };
    for value in [true, false, true] {
        let stamped = Stamped::new(signal(value), fixture.clock.now());
        fixture.link.inputs.send(stamped).await.unwrap();
    }
    let mut seen = Vec::new();
    let recorded = async {
        loop {
            let mut records = fixture.store.audit_entries(None, 50).await.unwrap();
            records.retain(|record| record.action == "stage");
            seen = records.iter().rev().map(|record| record.target.clone()).collect();
            if seen.ends_with(&["active", "standby", "active"].map(String::from)) {
                return;
            }
            tokio::task::yield_now().await;
        }
    };
    let waited = tokio::time::timeout(std::time::Duration::from_secs(20), recorded).await;
    assert!(waited.is_ok(), "{seen:?}");
}
