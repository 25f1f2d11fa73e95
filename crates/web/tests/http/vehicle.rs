//! The operator's actions: which are done, which are refused and why, and the effect of a late tap.

use axum::http::StatusCode;
use serde_json::Value;
use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::time::Span;

use crate::fixture::{Answer, Fixture, as_program, form_request};

/// An operator at a display, at a vehicle that reports that all is well.
pub struct Operator {
    pub fixture: Fixture,
    pub cookie: String,
}

impl Operator {
    async fn localizing() -> Operator {
        Operator::localizing_in(Fixture::new().await).await
    }

    async fn localizing_in(fixture: Fixture) -> Operator {
        fixture.drive(false).await;
        let cookie = fixture.cookie_of("operator").await;
        for status in ["lidar", "imu", "tf", "planner"] {
            fixture.status(status, 0, "fine").await;
        }
        let operator = Operator { fixture, cookie };
        operator.fixture.until(|snapshot| snapshot.overall == State::Ok).await;
        operator
    }

    pub async fn standing() -> Operator {
        Operator::standing_in(Fixture::new().await).await
    }

    pub async fn standing_in(fixture: Fixture) -> Operator {
        let operator = Operator::localizing_in(fixture).await;
        let answer = operator.post("/vehicle/localize", "stop=depot").await;
        assert_eq!(answer.status, StatusCode::OK, "{}", answer.body);
        operator.fixture.until(|snapshot| snapshot.stage == Stage::Standby).await;
        operator
    }

    fn seq(&self) -> u64 {
        self.fixture.link.snapshots.borrow().snapshot.seq
    }

    /// A tap on the present state.
    pub async fn post(&self, path: &str, fields: &str) -> Answer {
        // Somebody must be shown a state before anybody can act on it.
        self.fixture.get_json("/api/v1/snapshot", &self.cookie).await;
        self.post_at(self.seq(), path, fields).await
    }

    async fn post_at(&self, version: u64, path: &str, fields: &str) -> Answer {
        let form = format!("version={version}&{fields}");
        self.fixture.send(as_program(form_request(path, Some(&self.cookie), &form))).await
    }

    async fn token(&self) -> String {
        self.token_for("/vehicle/clearance").await
    }

    pub async fn token_for(&self, path: &str) -> String {
        let answer = json(&self.post(path, "").await, StatusCode::OK);
        assert_eq!(answer["expires_s"], 10);
        answer["token"].as_str().unwrap().to_owned()
    }

    async fn confirm(&self, token: &str) -> Answer {
        self.confirm_at("/vehicle/clearance", token).await
    }

    pub async fn confirm_at(&self, path: &str, token: &str) -> Answer {
        let request = form_request(&format!("{path}/confirm"), Some(&self.cookie), &format!("token={token}"));
        self.fixture.send(as_program(request)).await
    }

    async fn requests(&self) -> usize {
        let snapshot = self.fixture.get_json("/api/v1/snapshot", &self.cookie).await;
        snapshot["countermeasures"].as_array().unwrap().len()
    }
}

#[track_caller]
fn json(answer: &Answer, status: StatusCode) -> Value {
    assert_eq!(answer.status, status, "{}", answer.body);
    serde_json::from_str(&answer.body).unwrap()
}

#[track_caller]
pub fn refused(answer: &Answer) -> Vec<String> {
    let answer = json(answer, StatusCode::CONFLICT);
    answer["refused"].as_array().unwrap().iter().map(|it| it.as_str().unwrap().to_owned()).collect()
}

#[tokio::test]
async fn the_way_from_the_login_to_a_stop_on_the_road() {
    let operator = Operator::standing().await;
    operator.fixture.look(&operator.cookie);
    let token = operator.token().await;
    assert_eq!(operator.fixture.stage(), Stage::Standby, "the first step clears nothing");
    assert_eq!(operator.confirm(&token).await.status, StatusCode::OK);
    assert_eq!(operator.fixture.stage(), Stage::Cleared);
    operator.fixture.drive(true).await;
    assert_eq!(operator.post("/vehicle/stop", "").await.status, StatusCode::OK);
    let snapshot = operator.fixture.get_json("/api/v1/snapshot", &operator.cookie).await;
    assert_eq!(snapshot["countermeasures"][0]["request"], "maneuver_stop");
    assert_eq!(snapshot["countermeasures"][0]["cause"], "operator");
    operator.fixture.look(&operator.cookie);
    let release = "/vehicle/release";
    let token = operator.token_for(release).await;
    assert_eq!(operator.requests().await, 1, "the first step releases nothing");
    refused(&operator.confirm(&token).await);
    assert_eq!(operator.confirm_at(release, &token).await.status, StatusCode::OK);
    assert_eq!(operator.requests().await, 0);
    assert_eq!(refused(&operator.post(release, "").await), ["Nothing keeps the vehicle from driving on."]);
    let log = operator.fixture.store.audit_entries(None, 100).await.unwrap();
    let done: Vec<&str> = log.iter().filter(|it| it.outcome == "done").map(|it| &*it.action).collect();
    assert!(done.contains(&"release asked") && done.contains(&"release"), "{done:?}");
}

#[tokio::test]
async fn an_acknowledgement_releases_nothing_and_a_token_of_before_neither() {
    let operator = Operator::standing().await;
    operator.fixture.look(&operator.cookie);
    operator.fixture.drive(true).await;
    assert_eq!(operator.post("/vehicle/stop", "").await.status, StatusCode::OK);
    operator.fixture.status("lidar", 2, "broken").await;
    operator.fixture.until(|snapshot| !snapshot.alarms.is_empty()).await;
    assert_eq!(operator.post("/alarms/1/acknowledge", "").await.status, StatusCode::OK);
    assert_eq!(operator.requests().await, 1);
    // A token of before is no use once things have changed.
    operator.fixture.look(&operator.cookie);
    let token = operator.token_for("/vehicle/release").await;
    operator.fixture.drive(false).await;
    operator.fixture.get_json("/api/v1/snapshot", &operator.cookie).await;
    refused(&operator.confirm_at("/vehicle/release", &token).await);
}

#[tokio::test]
async fn a_clearance_is_withdrawn_before_the_vehicle_drives_and_a_stop_does_that_too() {
    for path in ["/vehicle/clearance/withdraw", "/vehicle/stop"] {
        let operator = Operator::standing().await;
        operator.fixture.look(&operator.cookie);
        refused(&operator.post(path, "").await);
        let token = operator.token().await;
        assert_eq!(operator.confirm(&token).await.status, StatusCode::OK);
        assert_eq!(operator.fixture.stage(), Stage::Cleared);
        let over = operator.post("/login", "name=developer&secret=demo-developer").await;
        assert_eq!((over.status, over.cookie()), (StatusCode::CONFLICT, None), "it would end the session");
        assert_eq!(operator.post(path, "").await.status, StatusCode::OK, "{path}");
        assert_eq!(operator.fixture.stage(), Stage::Standby, "{path}");
    }
}

#[tokio::test]
async fn a_stop_counts_whatever_was_shown_and_however_late() {
    for fields in ["version=0", "version=99999999", "", "version=0&beat=2020-01-01T00:00:00.000Z&tap=late"] {
        let operator = Operator::standing().await;
        operator.fixture.drive(true).await;
        let request = form_request("/vehicle/stop", Some(&operator.cookie), fields);
        assert_eq!(operator.fixture.send(as_program(request)).await.status, StatusCode::OK, "{fields}");
        assert_eq!(operator.requests().await, 1, "{fields}");
    }
}

#[tokio::test]
async fn a_clearance_is_refused_with_every_reason_by_the_names_that_are_shown() {
    let operator = Operator::standing().await;
    operator.fixture.status("lidar", 2, "broken").await;
    operator.fixture.until(|snapshot| !snapshot.roots.is_empty()).await;
    let reasons = refused(&operator.post("/vehicle/clearance", "").await);
    let words = reasons.join("\n");
    assert_eq!(reasons.len(), 3, "{words}");
    for part in ["Sensors is in error", "Localization: waits for Sensors", "display is not up to date"] {
        assert!(words.contains(part), "{part}: {words}");
    }
    let mut request =
        form_request("/vehicle/clearance", Some(&operator.cookie), &format!("version={}", operator.seq()));
    request.headers_mut().insert("accept-language", "de".parse().unwrap());
    let answer = operator.fixture.send(request).await;
    assert_eq!(answer.status, StatusCode::CONFLICT);
    assert!(answer.body.contains("Die Anzeige ist nicht aktuell"), "{}", answer.body);
}

#[tokio::test]
async fn a_token_is_good_once_for_one_login_and_for_the_state_it_was_given_for() {
    let operator = Operator::standing().await;
    operator.fixture.look(&operator.cookie);
    let mut unknown = Vec::new();
    for wrong in ["", "0", &"f".repeat(32), "../../etc"] {
        unknown = refused(&operator.confirm(wrong).await);
    }
    let first = operator.token().await;
    let second = operator.token().await;
    assert_ne!(first, second);
    refused(&operator.confirm(&first).await);
    assert_eq!(operator.fixture.stage(), Stage::Standby, "a replaced token opens nothing");
    assert_eq!(operator.confirm(&second).await.status, StatusCode::OK);
    // Not only because the vehicle is cleared by now.
    assert_eq!(refused(&operator.confirm(&second).await), unknown);

    let operator = Operator::standing().await;
    operator.fixture.look(&operator.cookie);
    let token = operator.token().await;
    operator.fixture.status("tf", 1, "unsure").await;
    operator.fixture.until(|snapshot| snapshot.overall == State::Warning).await;
    // Somebody was shown it, if only for a moment.
    operator.fixture.get_json("/api/v1/snapshot", &operator.cookie).await;
    operator.fixture.status("tf", 0, "fine").await;
    operator.fixture.until(|snapshot| snapshot.overall == State::Ok).await;
    refused(&operator.confirm(&token).await);
    assert_eq!(operator.fixture.stage(), Stage::Standby);

    let operator = Operator::standing().await;
    operator.fixture.look(&operator.cookie);
    let token = operator.token().await;
    let other = Operator { cookie: operator.fixture.cookie_of("operator").await, fixture: operator.fixture };
    other.fixture.look(&other.cookie);
    refused(&other.confirm(&token).await);
    assert_eq!(other.fixture.stage(), Stage::Standby, "it was given to another login");
}

#[tokio::test]
async fn a_tap_on_an_older_state_does_nothing_and_says_so() {
    let operator = Operator::standing().await;
    operator.fixture.look(&operator.cookie);
    let shown = operator.seq();
    operator.post("/vehicle/localize", "stop=depot").await;
    operator.fixture.status("lidar", 2, "broken").await;
    operator.fixture.until(|snapshot| !snapshot.alarms.is_empty()).await;
    operator.fixture.get_json("/api/v1/snapshot", &operator.cookie).await;
    let before = operator.fixture.until(|_| true).await;
    for (path, fields) in [
        ("/vehicle/localize", "stop=depot"),
        ("/vehicle/clearance", ""),
        ("/vehicle/release", ""),
        ("/vehicle/clearance/withdraw", ""),
        ("/alarms/1/acknowledge", ""),
        ("/alarms/sensors/acknowledge", ""),
        ("/modules/sensors/lidar/reset", ""),
    ] {
        for version in [0, shown, operator.seq() + 1000] {
            let answer = json(&operator.post_at(version, path, fields).await, StatusCode::CONFLICT);
            assert!(answer["seq"].as_u64() >= Some(before.seq), "{path} {version}: {answer}");
        }
    }
    let after = operator.fixture.until(|_| true).await;
    assert_eq!((after.alarms[0].acknowledged, after.localization.number), (false, 1 + 1));
}

#[tokio::test]
async fn what_does_not_concern_an_action_does_not_make_its_tap_late() {
    let operator = Operator::standing().await;
    operator.fixture.look(&operator.cookie);
    operator.fixture.drive(true).await;
    operator.fixture.get_json("/api/v1/snapshot", &operator.cookie).await;
    let shown = operator.seq();
    for round in 0..20 {
        operator.fixture.status("lidar", round % 2 + 1, "flaps").await;
    }
    operator.fixture.until(|snapshot| snapshot.seq > shown + 2).await;
    operator.fixture.get_json("/api/v1/snapshot", &operator.cookie).await;
    let answer = operator.post_at(shown, "/vehicle/localize", "stop=depot").await;
    let wrong_stage = "The vehicle drives. Wait until it has arrived.";
    assert_eq!(refused(&answer), [wrong_stage], "it is not called stale");
}

#[tokio::test]
async fn a_tap_that_waited_on_its_way_does_nothing() {
    let operator = Operator::standing().await;
    for beat in ["2020-01-01T00:00:00.000Z", "2120-01-01T00:00:00Z", "yesterday", ""] {
        let fields = format!("stop=depot&beat={beat}");
        refused(&operator.post("/vehicle/localize", &fields).await);
    }
    let now = humantime::format_rfc3339_millis(operator.fixture.clock.wall());
    let answer = operator.post("/vehicle/localize", &format!("stop=depot&beat={now}")).await;
    assert_eq!(answer.status, StatusCode::OK, "{}", answer.body);
}

#[tokio::test]
async fn what_is_no_form_or_no_place_is_told_apart() {
    let operator = Operator::localizing().await;
    let places = "stop, x, y, yaw_deg";
    for (fields, named) in [
        ("", places),
        ("x=1", places),
        ("x=1&y=2", places),
        ("stop=depot&x=1&y=2&yaw_deg=3", places),
        ("x=1&y=2&yaw_deg=left", ": yaw_deg."),
    ] {
        let answer = operator.post("/vehicle/localize", fields).await;
        assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY, "{fields}");
        assert!(answer.body.contains(named), "{fields}: {}", answer.body);
    }
    let not_driving = "The vehicle does not drive.";
    assert_eq!(refused(&operator.post("/vehicle/stop", "").await), [not_driving]);
    for fields in ["stop=nowhere", "x=NaN&y=0&yaw_deg=0", "x=0&y=inf&yaw_deg=0", "x=99999&y=0&yaw_deg=0"] {
        refused(&operator.post("/vehicle/localize", fields).await);
    }
    let german = format!("{}; lang=de", operator.cookie);
    for (cookie, words) in [(&operator.cookie, "Missing or wrong: version."), (&german, "falsch: version.")] {
        let answer = operator.fixture.send(form_request("/vehicle/clearance", Some(cookie), "")).await;
        assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY);
        assert!(answer.body.contains(words), "{}", answer.body);
    }
    for path in ["/alarms/1", "/alarms/acknowledge", "/modules/x", "/modules/x/acknowledge"] {
        assert_eq!(operator.post(path, "").await.status, StatusCode::NOT_FOUND, "{path}");
    }
    assert_eq!(operator.fixture.stage(), Stage::Localizing);
    let answer = operator.post("/vehicle/localize", "x=10.5&y=-3&yaw_deg=90").await;
    assert_eq!(answer.status, StatusCode::OK, "{}", answer.body);
}

#[tokio::test]
async fn alarms_and_warnings_are_acknowledged_by_number_and_by_name() {
    let operator = Operator::standing().await;
    operator.fixture.status("lidar", 2, "broken").await;
    operator.fixture.until(|snapshot| !snapshot.alarms.is_empty()).await;
    assert_eq!(operator.post("/alarms/1/acknowledge", "").await.status, StatusCode::OK);
    let snapshot = operator.fixture.get_json("/api/v1/snapshot", &operator.cookie).await;
    assert_eq!(snapshot["alarms"][0]["acknowledged"], true);
    operator.fixture.status("lidar", 0, "fine").await;
    operator.fixture.status("imu", 1, "warm").await;
    operator.fixture.until(|snapshot| snapshot.overall == State::Warning).await;
    let answer = operator.post("/alarms/sensors/inside/imu/acknowledge", "").await;
    assert_eq!(answer.status, StatusCode::OK, "{}", answer.body);
    refused(&operator.post("/alarms/7/acknowledge", "").await);
    refused(&operator.post("/alarms/nobody/acknowledge", "").await);
    refused(&operator.post("/modules/sensors/lidar/reset", "").await);
}

#[tokio::test]
async fn alarms_that_are_over_are_acknowledged_together_whatever_was_shown_since() {
    let operator = Operator::standing().await;
    for _ in 0..3 {
        for level in [2, 0] {
            operator.fixture.status("lidar", level, "now and then").await;
            operator
                .fixture
                .until(|snapshot| snapshot.alarms.iter().all(|it| it.active == (level == 2)))
                .await;
        }
    }
    operator.fixture.status("lidar", 2, "broken").await;
    operator.fixture.until(|snapshot| snapshot.alarms.len() == 4).await;
    for _ in 0..2 {
        let answer = operator.post_at(0, "/alarms/acknowledge-over", "last=2").await;
        assert_eq!(json(&answer, StatusCode::OK), serde_json::json!({}));
        let left = operator.fixture.until(|snapshot| snapshot.alarms.len() == 2).await;
        let left: Vec<_> = left.alarms.iter().map(|it| (it.id, it.active, it.acknowledged)).collect();
        assert_eq!(left, [(3, false, false), (4, true, false)]);
    }
    let records = operator.fixture.store.audit_entries(None, 2).await.unwrap();
    let written: Vec<_> = records.iter().map(|it| (&*it.action, &*it.target, &*it.outcome)).collect();
    let word = "acknowledge over";
    assert_eq!(written, [(word, "0 up to 2", "done"), (word, "2 up to 2", "done")]);
    let answer = operator.post("/alarms/acknowledge-over", "").await;
    assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY);
}

#[tokio::test]
async fn a_browser_without_scripts_is_led_back_to_its_page() {
    let operator = Operator::localizing().await;
    operator.fixture.get("/", Some(&operator.cookie)).await;
    let form = format!("version={}&stop=depot", operator.seq());
    let answer = operator.fixture.post("/vehicle/localize", Some(&operator.cookie), &form).await;
    assert_eq!((answer.status, answer.leads_to()), (StatusCode::SEE_OTHER, Some("/")));
}

#[tokio::test]
async fn an_operator_who_is_not_in_charge_acts_on_nothing() {
    let operator = Operator::standing().await;
    let login = "name=operator&secret=246810";
    operator.fixture.post("/logout", Some(&operator.cookie), "").await;
    let answer = operator.fixture.post("/login", None, login).await;
    let cookie = answer.cookie().unwrap();
    let gone = operator.post_at(operator.seq(), "/vehicle/localize", "stop=depot").await;
    assert_eq!(gone.status, StatusCode::UNAUTHORIZED, "{}", gone.body);
    let answer = operator.fixture.post("/vehicle/shutdown", Some(&cookie), "").await;
    assert_eq!((answer.status, answer.leads_to()), (StatusCode::SEE_OTHER, Some("/login")));
    assert_eq!(operator.fixture.stage(), Stage::Locked);
}

#[tokio::test]
async fn a_stop_that_nobody_hears_is_not_said_to_be_sent() {
    let operator = Operator::standing().await;
    operator.fixture.drive(true).await;
    operator.fixture.listeners(false).await;
    let answer = json(&operator.post("/vehicle/stop", "").await, StatusCode::SERVICE_UNAVAILABLE);
    assert!(answer["error"].as_str().unwrap().contains("Nobody listens"), "{answer}");
    let german = format!("{}; lang=de", operator.cookie);
    let form = format!("version={}", operator.seq());
    let page = operator.fixture.send(form_request("/vehicle/stop", Some(&german), &form)).await;
    assert_eq!(page.status, StatusCode::SERVICE_UNAVAILABLE);
    assert!(page.body.contains("Niemand hört zu"), "{}", page.body);
    let snapshot = operator.fixture.get_json("/api/v1/snapshot", &operator.cookie).await;
    assert_eq!(snapshot["countermeasures"][0]["state"], "unconfirmed", "it waits for who will listen");
    operator.fixture.listeners(true).await;
    assert_eq!(operator.post("/vehicle/stop", "").await.status, StatusCode::OK);
}

#[tokio::test]
async fn a_silent_module_tells_programs_for_how_long() {
    let (fixture, hand) = Fixture::with_hand().await;
    let cookie = fixture.cookie_of("operator").await;
    fixture.status("lidar", 0, "Points arrive").await;
    fixture.until(|snapshot| snapshot.modules[0].received.is_some()).await;
    let module = async || {
        let snapshot = fixture.get_json("/api/v1/snapshot", &cookie).await;
        snapshot["groups"][0]["modules"][0].clone()
    };
    let fresh = module().await;
    assert_eq!((&fresh["message"], fresh.get("silent_s")), (&"Points arrive".into(), None));
    hand.advance(Span::from_secs(30));
    fixture.status("imu", 0, "fine").await;
    fixture.until(|snapshot| snapshot.modules[0].silent).await;
    let silent = module().await;
    assert_eq!(silent["state"], "unknown");
    assert!((30.0..35.0).contains(&silent["silent_s"].as_f64().unwrap()), "{silent}");
    let message = silent["message"].as_str().unwrap();
    assert!(message.starts_with("silent for 3") && message.ends_with(" s; last: Points arrive"), "{message}");
}

#[tokio::test]
async fn an_acknowledgement_names_all_places_of_a_status_in_the_log() {
    let operator = Operator::standing().await;
    operator.fixture.status("power", 1, "12 V").await;
    operator.fixture.until(|snapshot| snapshot.overall == State::Warning).await;
    let answer = operator.post("/alarms/localization/power/acknowledge", "").await;
    assert_eq!(answer.status, StatusCode::OK, "{}", answer.body);
    let known = operator.fixture.until(|snapshot| snapshot.accepted.len() == 2).await;
    assert_eq!(known.overall, State::Warning);
    let log = operator.fixture.store.audit_entries(None, 1).await.unwrap();
    assert_eq!(log[0].target, "localization/power: localization/power, sensors/inside/power");
}
