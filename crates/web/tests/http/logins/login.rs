//! Login, logout, cookies, and their effect on the vehicle.

use axum::http::header::SET_COOKIE;
use axum::http::{Method, StatusCode};
use telltale_engine::model::Stage;
use telltale_engine::time::Span;
use telltale_store::audit::Entry;
use telltale_store::{DEMO_USERS, DemoSecrets, Role};
use telltale_web::{SelfCheck, Stuck};
use tokio::sync::watch;

use crate::fixture::{ADDRESS, COMPONENTS, Fixture, as_program, form_request, request, until};
use crate::folder::TestFolder;

#[tokio::test]
async fn an_operators_login_unlocks_the_vehicle_and_the_others_do_not() {
    let fixture = Fixture::new().await;
    for name in ["developer", "authority"] {
        let cookie = fixture.cookie_of(name).await;
        assert_eq!(fixture.stage(), Stage::Locked);
        assert_eq!(fixture.get("/developer", Some(&cookie)).await.status, StatusCode::OK, "where it leads");
    }
    let cookie = fixture.cookie_of("operator").await;
    assert_eq!(fixture.stage(), Stage::Localizing);
    assert_eq!(fixture.store.operator_in_charge().await.unwrap().as_deref(), Some("operator"));
    assert_eq!(fixture.get("/", Some(&cookie)).await.status, StatusCode::OK);
    assert_eq!(fixture.get("/login", Some(&cookie)).await.leads_to(), Some("/"));
}

#[tokio::test]
async fn another_operator_logs_in_at_the_display_of_the_present_one() {
    const CHANGE: &str = "/login?change";
    let fixture = Fixture::new().await;
    fixture.store.add_user("bert", Role::Operator, "975310").await.unwrap();
    assert!(!fixture.get(CHANGE, None).await.body.contains("take_over"), "nobody is in charge");
    let cookie = fixture.cookie_of("operator").await;
    let page = fixture.get(CHANGE, Some(&cookie)).await.body;
    for part in ["On duty: operator. Who is next?", r#"name="take_over""#, r#"href="/""#] {
        assert!(page.contains(part), "{part}: {page}");
    }
    for query in ["?change=1", "?other", ""] {
        let answer = fixture.get(&format!("/login{query}"), Some(&cookie)).await;
        assert_eq!(answer.leads_to(), Some("/"), "{query}");
    }
    let developer = fixture.cookie_of("developer").await;
    assert_eq!(fixture.get(CHANGE, Some(&developer)).await.leads_to(), Some("/"), "is not in charge");
    let wrong = fixture.post("/login", Some(&cookie), "name=bert&secret=000000&take_over=1").await;
    assert_eq!(wrong.status, StatusCode::UNAUTHORIZED);
    assert!(wrong.body.contains("Who is next?"), "{}", wrong.body);
    let right = fixture.post("/login", Some(&cookie), "name=bert&secret=975310&take_over=1").await;
    assert_eq!(right.leads_to(), Some("/"));
    assert_eq!(fixture.store.operator_in_charge().await.unwrap().as_deref(), Some("bert"));
    assert_eq!(fixture.get("/", Some(&cookie)).await.leads_to(), Some("/login"), "that session has ended");
}

#[tokio::test]
async fn a_page_reads_an_error_in_its_language() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("developer").await;
    for (cookies, expect) in [
        (cookie.clone(), "Your role does not permit this."),
        (format!("{cookie}; lang=de"), "Ihre Rolle erlaubt das nicht."),
    ] {
        let stop = form_request("/vehicle/stop", Some(&cookies), "version=1");
        let answer = fixture.send(as_program(stop)).await;
        assert_eq!(answer.status, StatusCode::FORBIDDEN);
        assert!(answer.body.contains(expect), "{}", answer.body);
    }
}

#[tokio::test]
async fn while_the_vehicle_is_locked_nobody_sees_a_diagnosis() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("developer").await;
    fixture.status("lidar", 2, "broken").await;
    fixture.until(|snapshot| snapshot.counters.statuses > 0).await;
    for path in ["/", "/developer", "/api/v1/snapshot"] {
        let answer = fixture.get(path, Some(&cookie)).await;
        assert_eq!(answer.status, StatusCode::OK, "{path}");
        for name in COMPONENTS {
            assert!(!answer.body.to_lowercase().contains(name), "{path} tells of {name}");
        }
    }
    let snapshot = fixture.get_json("/api/v1/snapshot", &cookie).await;
    assert_eq!((snapshot["stage"].as_str(), &snapshot["groups"]), (Some("locked"), &serde_json::json!([])));
    fixture.cookie_of("operator").await;
    let snapshot = fixture.get_json("/api/v1/snapshot", &cookie).await;
    assert_eq!(snapshot["groups"].as_array().unwrap().len(), 3);
}

#[tokio::test]
async fn a_cookie_is_for_this_server_alone() {
    for (secure, prefix, suffix) in [(false, "telltale=", ""), (true, "__Host-telltale=", "; Secure")] {
        let fixture = Fixture::with("127.0.0.1:8080", secure, DemoSecrets::Accepted).await;
        let mut login = form_request("/login", None, "name=operator&secret=246810");
        if secure {
            login.headers_mut().insert("origin", "https://127.0.0.1:8080".parse().unwrap());
        }
        let answer = fixture.send(login).await;
        let line = answer.header(SET_COOKIE.as_str()).unwrap();
        let token = line.strip_prefix(prefix).unwrap().split(';').next().unwrap();
        assert!(token.len() == 64 && token.bytes().all(|byte| byte.is_ascii_hexdigit()), "{token}");
        let attributes = format!("; Path=/; Max-Age=86400; HttpOnly; SameSite=Strict{suffix}");
        assert_eq!(line, format!("{prefix}{token}{attributes}"));
        let transport = answer.header("strict-transport-security");
        assert_eq!(transport, secure.then_some("max-age=31536000"));
    }
}

#[tokio::test]
async fn of_two_session_cookies_none_is_taken_for_the_others() {
    let fixture = Fixture::new().await;
    let (own, planted) = (fixture.cookie_of("operator").await, fixture.cookie_of("authority").await);
    let forged = format!("telltale={}", "0".repeat(64));
    for (cookies, status) in [
        (format!("{own}; {forged}"), StatusCode::OK),
        (format!("{forged}; {own}"), StatusCode::OK),
        (format!("telltale=; {own}; {own}"), StatusCode::OK),
        (format!("{planted}; {own}"), StatusCode::UNAUTHORIZED),
        (format!("{own}; {planted}"), StatusCode::UNAUTHORIZED),
    ] {
        assert_eq!(fixture.get("/api/v1/snapshot", Some(&cookies)).await.status, status, "{cookies}");
    }
}

#[tokio::test]
async fn a_failed_login_says_the_same_whatever_was_wrong() {
    let fixture = Fixture::new().await;
    let bodies = [("operator", "135791"), ("nobody", "246810"), ("operator", "demo-developer")];
    let mut answers = Vec::new();
    for (name, secret) in bodies {
        let login = form_request("/login", None, &format!("name={name}&secret={secret}"));
        let answer = fixture.send(as_program(login)).await;
        assert_eq!((answer.status, answer.cookie()), (StatusCode::UNAUTHORIZED, None));
        answers.push(answer.body);
    }
    assert!(answers.iter().all(|body| *body == answers[0]), "{answers:?}");
    assert_eq!(fixture.stage(), Stage::Locked);
    let answer = fixture.log_in("operator", "246810").await;
    assert_eq!(answer.status, StatusCode::TOO_MANY_REQUESTS, "the source failed three times");
    assert_eq!(answer.header("retry-after"), Some("1"));
}

#[tokio::test]
async fn what_is_no_login_form_is_refused() {
    let fixture = Fixture::new().await;
    for form in ["", "name=operator", "secret=246810", "name=operator&name=x&secret=1", "%ff=%ff", "{}"] {
        let status = fixture.post("/login", None, form).await.status;
        assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{form}");
    }
}

#[tokio::test]
async fn a_vehicle_refuses_the_secrets_of_the_demonstration() {
    let fixture = Fixture::with(ADDRESS, false, DemoSecrets::Refused).await;
    for (name, _, secret) in DEMO_USERS {
        let answer = fixture.log_in(name, secret).await;
        assert_eq!((answer.status, answer.cookie()), (StatusCode::UNAUTHORIZED, None), "{name}");
    }
    for (_, role, secret) in DEMO_USERS {
        assert!(fixture.store.add_user("new", role, secret).await.is_err());
    }
    fixture.store.add_user("anna", Role::Operator, "135791").await.unwrap();
}

#[tokio::test]
async fn a_login_gives_a_new_token_and_ends_the_session_before() {
    let fixture = Fixture::new().await;
    let planted = format!("telltale={}", "a".repeat(64));
    assert_eq!(fixture.get("/", Some(&planted)).await.leads_to(), Some("/login"));
    let first = fixture.post("/login", Some(&planted), "name=developer&secret=demo-developer").await;
    let first = first.cookie().unwrap();
    assert_ne!(first, planted);
    assert_eq!(fixture.get("/", Some(&planted)).await.leads_to(), Some("/login"));
    let second = fixture.post("/login", Some(&first), "name=developer&secret=demo-developer").await;
    let second = second.cookie().unwrap();
    assert_ne!(second, first);
    assert_eq!(fixture.get("/", Some(&first)).await.leads_to(), Some("/login"));
    assert_eq!(fixture.get("/", Some(&second)).await.status, StatusCode::OK);
}

#[tokio::test]
async fn logout_ends_the_session_and_locks_the_vehicle() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("operator").await;
    let other_display = fixture.cookie_of("operator").await;
    let answer = fixture.post("/logout", Some(&cookie), "").await;
    assert_eq!((answer.status, answer.leads_to()), (StatusCode::SEE_OTHER, Some("/login")));
    assert!(answer.header("set-cookie").unwrap().starts_with("telltale=; Path=/; Max-Age=0; "));
    assert_eq!(fixture.stage(), Stage::Locked);
    for cookie in [cookie, other_display] {
        assert_eq!(fixture.get("/", Some(&cookie)).await.leads_to(), Some("/login"));
    }
    assert_eq!(fixture.store.operator_in_charge().await.unwrap(), None);
}

#[tokio::test]
async fn the_operator_stays_while_the_vehicle_drives_and_is_told_why() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("operator").await;
    let developer = fixture.cookie_of("developer").await;
    fixture.drive(true).await;
    let answer = fixture.send(as_program(form_request("/logout", Some(&cookie), ""))).await;
    assert_eq!(answer.status, StatusCode::CONFLICT);
    let body: serde_json::Value = serde_json::from_str(&answer.body).unwrap();
    assert_eq!(body["refused"].as_array().unwrap().len(), 1, "{body}");
    assert_eq!(fixture.get("/", Some(&cookie)).await.status, StatusCode::OK);
    assert_eq!(fixture.post("/logout", Some(&cookie), "").await.status, StatusCode::CONFLICT);
    assert_eq!(fixture.post("/logout", Some(&developer), "").await.leads_to(), Some("/login"));
    fixture.drive(false).await;
    assert_eq!(fixture.post("/logout", Some(&cookie), "").await.leads_to(), Some("/login"));
}

#[tokio::test]
async fn a_driving_vehicle_without_an_operator_asks_for_a_login() {
    let fixture = Fixture::new().await;
    fixture.drive(true).await;
    assert_eq!(fixture.get("/", None).await.leads_to(), Some("/login"));
    let cookie = fixture.cookie_of("operator").await;
    assert_eq!(fixture.stage(), Stage::Active);
    assert_eq!(fixture.get("/", Some(&cookie)).await.status, StatusCode::OK);
}

#[tokio::test]
async fn readiness_needs_engine_and_store_and_health_neither() {
    let fixture = Fixture::new().await;
    for path in ["/healthz", "/readyz"] {
        assert_eq!(fixture.send(request(Method::GET, path, None)).await.status, StatusCode::OK, "{path}");
    }
}

#[tokio::test]
async fn a_server_whose_bridge_has_ended_is_not_ready_and_asks_for_a_restart() {
    let (fixture, hand) = Fixture::with_hand().await;
    let (works, working) = watch::channel(fixture.clock.now());
    let fixture = fixture.bridged(working);
    let check = SelfCheck::new(fixture.app.clone());
    hand.advance(Span::from_secs(16));
    // The engine lives on, by its own clock.
    until(async || check.run().await == Err(Stuck::Bridge)).await;
    assert_eq!(fixture.get("/readyz", None).await.status, StatusCode::SERVICE_UNAVAILABLE);
    works.send_replace(fixture.clock.now());
    assert_eq!(fixture.get("/readyz", None).await.status, StatusCode::OK);
}

#[tokio::test]
async fn a_browser_that_leaves_in_the_middle_of_a_logout_is_logged_out_all_the_same() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("operator").await;
    let mut snapshots = fixture.link.snapshots.clone();
    {
        let leaving = fixture.post("/logout", Some(&cookie), "");
        let locked = snapshots.wait_for(|published| published.snapshot.stage == Stage::Locked);
        tokio::select! {
            biased;
            _ = locked => {}
            _ = leaving => {}
        }
    }
    let ended = async {
        while fixture.get("/api/v1/snapshot", Some(&cookie)).await.status != StatusCode::UNAUTHORIZED {
            tokio::task::yield_now().await;
        }
    };
    tokio::time::timeout(std::time::Duration::from_secs(5), ended).await.expect("the session ends");
}

#[tokio::test]
async fn a_logout_that_cannot_be_written_changes_nothing_and_names_the_disk() {
    let folder = TestFolder::new("logout");
    let fixture = Fixture::in_folder(&folder).await;
    let cookie = fixture.cookie_of("operator").await;
    let stage = fixture.stage();
    let disk = rusqlite::Connection::open(folder.join("telltale.db")).unwrap();
    for table in ["audit", "sessions", "seat"] {
        let full = format!(
            "CREATE TRIGGER full BEFORE {} ON {table} BEGIN SELECT RAISE(ABORT, 'no room'); END",
            if table == "audit" { "INSERT" } else { "DELETE" }
        );
        disk.execute_batch(&full).unwrap();
        for path in ["/logout", "/vehicle/shutdown"] {
            let answer = fixture.post(path, Some(&cookie), "").await;
            assert_eq!((answer.status, answer.cookie()), (StatusCode::SERVICE_UNAVAILABLE, None), "{path}");
            assert!(answer.body.contains("The disk is full or broken"), "{}", answer.body);
            assert_eq!(fixture.stage(), stage, "{path}");
            assert_eq!(fixture.store.operator_in_charge().await.unwrap().as_deref(), Some("operator"));
            assert_eq!(fixture.get("/api/v1/snapshot", Some(&cookie)).await.status, StatusCode::OK);
        }
        disk.execute_batch("DROP TRIGGER full").unwrap();
    }
    assert_eq!(fixture.post("/logout", Some(&cookie), "").await.leads_to(), Some("/login"));
    assert_eq!(fixture.stage(), Stage::Locked);
    assert_eq!(fixture.store.verify_audit().await.unwrap().breach, None);
}

#[tokio::test]
async fn a_login_over_the_operators_session_is_a_logout_and_is_refused_like_one() {
    let fixture = Fixture::new().await;
    fixture.store.add_user("bert", Role::Operator, "975310").await.unwrap();
    let first = fixture.cookie_of("operator").await;
    fixture.drive(true).await;
    let over = async |cookie: &str, form: &str| fixture.post("/login", Some(cookie), form).await;
    let refused = over(&first, "name=developer&secret=demo-developer").await;
    assert_eq!((refused.status, refused.cookie()), (StatusCode::CONFLICT, None));
    assert!(refused.body.contains("Log out after it has arrived"), "{}", refused.body);
    assert_eq!(fixture.get("/", Some(&first)).await.status, StatusCode::OK, "nothing was changed");
    // The operator may log in again, and hand the vehicle over.
    let second = over(&first, "name=operator&secret=246810").await.cookie().unwrap();
    assert_eq!(fixture.get("/", Some(&first)).await.leads_to(), Some("/login"));
    let third = over(&second, "name=bert&secret=975310&take_over=1").await.cookie().unwrap();
    assert_eq!(fixture.stage(), Stage::Active);
    fixture.drive(false).await;
    assert!(over(&third, "name=developer&secret=demo-developer").await.cookie().is_some());
    assert_eq!(fixture.get("/", Some(&third)).await.leads_to(), Some("/login"));
    let entries = fixture.store.audit_entries(None, 9).await.unwrap();
    let line = |it: &Entry| format!("{} {} {} {}", it.action, it.who, it.target, it.outcome);
    let lines: Vec<String> = entries.iter().rev().map(line).collect();
    assert_eq!(
        lines[1..],
        [
            "login developer developer refused: [LogoutWhileActive]",
            "session ended operator login of operator done",
            "login operator operator done",
            "session ended operator login of bert done",
            "hand-over bert from operator done",
            "login bert bert done",
            "session ended bert login of developer done",
            "login developer developer done",
        ]
    );
}

#[tokio::test]
async fn the_end_of_the_oldest_of_too_many_sessions_is_recorded() {
    let fixture = Fixture::new().await;
    for _ in 0..17 {
        fixture.cookie_of("developer").await;
    }
    let entries = fixture.store.audit_entries(None, 3).await.unwrap();
    let ended: Vec<_> = entries.iter().filter(|it| &*it.action == "session ended").collect();
    assert_eq!(ended.len(), 1);
    assert_eq!((&*ended[0].who, &*ended[0].target), ("developer", "1 of too many, the oldest"));
}
