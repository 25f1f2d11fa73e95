//! Who may log in, from where and for how long: PINs, the one operator who leads the vehicle, idle
//! sessions, tokens of programs.

use std::net::SocketAddr;

use axum::http::header::{AUTHORIZATION, COOKIE, ORIGIN};
use axum::http::{Method, StatusCode};
use telltale_clock::Clock;
use telltale_engine::input::Input;
use telltale_engine::model::Stage;
use telltale_engine::model::monitors::TopicId;
use telltale_engine::model::motion::{PositionSource, WatchedField};
use telltale_engine::snapshot::{Moving, Snapshot};
use telltale_engine::time::Span;
use telltale_store::Role;
use telltale_web::{DEVELOPER_IDLE_MAX, Enrolled, Peer, Proxies, VehicleDisplay};

use crate::fixture::{Answer, Fixture, as_program, form_request, login_from, request, settled, until};

async fn log_in_from(fixture: &Fixture, source: &str, form: &str) -> Answer {
    fixture.send(login_from(source, form)).await
}

#[tokio::test]
async fn a_pin_will_do_at_an_enrolled_display_and_a_password_everywhere() {
    let fixture = Fixture::new().await;
    fixture.store.add_user("anna", Role::Operator, "a long password").await.unwrap();
    fixture.store.add_user("bert", Role::Operator, "975310").await.unwrap();
    let cases = [
        ("127.0.0.1", "name=anna&secret=a+long+password", StatusCode::OK),
        ("::1", "name=anna&secret=a+long+password", StatusCode::OK),
        ("10.0.0.7", "name=anna&secret=a+long+password", StatusCode::OK),
        ("10.0.0.7", "name=bert&secret=975310", StatusCode::FORBIDDEN),
        // The same words whether or not the PIN is right, and whether or not there is such a user.
        ("10.0.0.8", "name=bert&secret=975311", StatusCode::FORBIDDEN),
        ("10.0.0.9", "name=nobody&secret=975310", StatusCode::FORBIDDEN),
        ("127.0.0.1", "name=bert&secret=975310&take_over=1", StatusCode::OK),
    ];
    let mut refused = Vec::new();
    for (source, form, expected) in cases {
        let answer = log_in_from(&fixture, source, form).await;
        assert_eq!(answer.status, expected, "{source} {form}: {}", answer.body);
        if expected == StatusCode::FORBIDDEN {
            refused.push(answer.body);
        }
    }
    assert!(refused.iter().all(|body| *body == refused[0] && body.contains("password")), "{refused:?}");
}

#[tokio::test]
async fn strangers_do_not_delay_the_right_pin_at_an_enrolled_display() {
    let mut fixture = Fixture::new().await;
    fixture.store.add_user("anna", Role::Operator, "975310").await.unwrap();
    fixture.set(|settings| {
        settings.enrolled = Enrolled::new(vec![VehicleDisplay::At("10.0.0.7".parse().unwrap())])
    });
    for stranger in 66..72 {
        let form = "name=anna&secret=wrong-password-1";
        log_in_from(&fixture, &format!("10.0.0.{stranger}"), form).await;
    }
    let stranger = log_in_from(&fixture, "10.0.0.80", "name=anna&secret=wrong-password-1").await;
    assert_eq!(stranger.status, StatusCode::TOO_MANY_REQUESTS);
    // Nor do those who come through a proxy on this machine.
    fixture.store.add_user("bert", Role::Operator, "a long password").await.unwrap();
    for _ in 0..4 {
        log_in_from(&fixture, "127.0.0.1", "name=bert&secret=wrong-password-1").await;
    }
    for name_and_secret in ["name=bert&secret=a+long+password", "name=anna&secret=975310&take_over=1"] {
        let display = log_in_from(&fixture, "10.0.0.7", name_and_secret).await;
        assert_eq!(display.status, StatusCode::OK, "{}", display.body);
    }
}

#[tokio::test]
async fn one_operator_is_in_charge_and_is_replaced_in_so_many_words() {
    let (fixture, hand) = Fixture::with_hand().await;
    fixture.store.add_user("bert", Role::Operator, "975310").await.unwrap();
    let first = fixture.cookie_of("operator").await;
    for active in [false, true] {
        fixture.drive(active).await;
        let asked = fixture.log_in("bert", "975310").await;
        assert_eq!((asked.status, asked.cookie()), (StatusCode::CONFLICT, None));
        assert!(asked.body.contains("operator is the operator"), "{}", asked.body);
        assert!(
            asked.body.contains(r#"name="take_over" value="1""#) && asked.body.contains("Take the place of ")
        );
        let wrong = fixture.log_in("bert", "975311&take_over=1").await;
        assert_eq!(wrong.status, StatusCode::UNAUTHORIZED);
        assert_eq!(fixture.get("/", Some(&first)).await.status, StatusCode::OK, "nothing was changed");
    }
    let taken = fixture.log_in("bert", "975310&take_over=1").await;
    assert_eq!(taken.leads_to(), Some("/"));
    let second = taken.cookie().unwrap();
    settled().await;
    assert_eq!(fixture.stage(), Stage::Active);
    assert_eq!(fixture.get("/", Some(&first)).await.status, StatusCode::OK, "it is said before it happens");
    hand.advance(Span::from_secs(5));
    fixture.until(|snapshot| snapshot.operator.as_deref() == Some("bert")).await;
    until(async || fixture.get("/", Some(&first)).await.status != StatusCode::OK).await;
    assert_eq!(fixture.store.operator_in_charge().await.unwrap().as_deref(), Some("bert"));
    assert_eq!(fixture.get("/", Some(&first)).await.leads_to(), Some("/login"), "its sessions ended");
    assert_eq!(fixture.get("/", Some(&second)).await.status, StatusCode::OK);
    let entries = fixture.store.audit_entries(None, 2).await.unwrap();
    let actions = entries.iter().map(|it| (&*it.action, &*it.who, &*it.target)).collect::<Vec<_>>();
    assert_eq!(actions, [("hand-over", "bert", "from operator"), ("login", "bert", "bert")]);

    let program = as_program(form_request("/login", None, "name=operator&secret=246810"));
    let answer = fixture.send(program).await;
    let body: serde_json::Value = serde_json::from_str(&answer.body).unwrap();
    assert_eq!((answer.status, &body["operator"]), (StatusCode::CONFLICT, &serde_json::json!("bert")));
    // The same operator at another display takes nothing over, and others need not be in charge.
    assert_eq!(fixture.log_in("bert", "975310").await.leads_to(), Some("/"));
    fixture.cookie_of("developer").await;
    assert_eq!(fixture.get("/", Some(&second)).await.status, StatusCode::OK);
}

#[tokio::test]
async fn a_take_over_is_confirmed_once_soon_and_on_the_page_that_asked() {
    let (fixture, hand) = Fixture::with_hand().await;
    fixture.store.add_user("bert", Role::Operator, "975310").await.unwrap();
    fixture.store.add_user("carl", Role::Operator, "864209").await.unwrap();
    fixture.cookie_of("operator").await;
    let token = async || {
        let asked = fixture.log_in("bert", "975310").await;
        assert_eq!(asked.status, StatusCode::CONFLICT);
        assert!(!asked.body.contains(r#"name="secret""#), "the secret was given");
        let (_, rest) = asked.body.split_once(r#"name="confirm" value=""#).unwrap();
        rest.split_once('"').unwrap().0.to_owned()
    };
    let confirm = async |name: &str, source: &str, token: &str| {
        let form = format!("name={name}&take_over=1&confirm={token}");
        log_in_from(&fixture, source, &form).await.status
    };
    let mut first = token().await;
    for (name, source, token) in [
        ("bert", "127.0.0.1", ""),
        ("bert", "127.0.0.1", &*"0".repeat(64)),
        ("carl", "127.0.0.1", &*first),
        ("bert", "10.0.0.7", &*first),
    ] {
        assert_eq!(confirm(name, source, token).await, StatusCode::UNAUTHORIZED, "{name} {source}");
    }
    hand.advance(Span::from_secs(30));
    assert_eq!(confirm("bert", "127.0.0.1", &first).await, StatusCode::UNAUTHORIZED, "too late");
    // Another one has taken over meanwhile: the question was about somebody else.
    first = token().await;
    let taken = log_in_from(&fixture, "127.0.0.1", "name=carl&secret=864209&take_over=1").await;
    assert_eq!(taken.status, StatusCode::OK);
    assert_eq!(confirm("bert", "127.0.0.1", &first).await, StatusCode::CONFLICT);
    first = token().await;
    assert_eq!(confirm("bert", "127.0.0.1", &first).await, StatusCode::OK);
    fixture.until(|snapshot| snapshot.operator.as_deref() == Some("bert")).await;
    assert_eq!(confirm("bert", "127.0.0.1", &first).await, StatusCode::UNAUTHORIZED, "it is good once");
    // A secret that was changed meanwhile proves nothing.
    fixture.log_in("operator", "246810&take_over=1").await;
    fixture.until(|snapshot| snapshot.operator.as_deref() == Some("operator")).await;
    first = token().await;
    fixture.store.change_secret("bert", "246975").await.unwrap();
    assert_ne!(confirm("bert", "127.0.0.1", &first).await, StatusCode::OK);
    assert_eq!(fixture.link.snapshots.borrow().snapshot.operator.as_deref(), Some("operator"));
}

#[tokio::test]
async fn the_vehicles_own_displays_offer_the_operators_names_and_others_nobodys() {
    let fixture = Fixture::new().await;
    let page = async |source: &str| {
        let mut page = request(Method::GET, "/login", None);
        page.extensions_mut().insert(Peer(SocketAddr::new(source.parse().unwrap(), 40_000)));
        fixture.send(page).await.body
    };
    fixture.store.add_user("bert", Role::Operator, "975310").await.unwrap();
    let near = page("127.0.0.1").await;
    let offers = |page: &str, name: &str| page.contains(&format!(">{name}</button>"));
    assert!(offers(&near, "bert") && offers(&near, "operator") && !offers(&near, "developer"), "{near}");
    let far = page("10.0.0.7").await;
    assert!(!far.contains("bert") && !offers(&far, "operator"), "{far}");
    for name in ["carl", "dora", "emil"] {
        fixture.store.add_user(name, Role::Operator, "975310").await.unwrap();
    }
    assert!(!page("127.0.0.1").await.contains("bert"), "too many to choose from");
}

#[tokio::test]
async fn a_developer_who_does_nothing_is_logged_out_and_nobody_else_is() {
    let (fixture, hand) = Fixture::with_hand().await;
    let developer = fixture.cookie_of("developer").await;
    let operator = fixture.cookie_of("operator").await;
    let authority = fixture.cookie_of("authority").await;
    let get = async |cookie: &str, renewal: bool| {
        let mut request = as_program(request(Method::GET, "/api/v1/snapshot", Some(cookie)));
        if renewal {
            request.headers_mut().insert("telltale-renewal", "1".parse().unwrap());
        }
        fixture.send(request).await.status
    };
    let minute = Span::from_secs(60);
    for _ in 0..3 {
        hand.advance(DEVELOPER_IDLE_MAX - minute);
        assert_eq!(get(&developer, false).await, StatusCode::OK, "it was used in time");
    }
    // An open page that renews itself does not count as activity.
    hand.advance(DEVELOPER_IDLE_MAX - minute);
    assert_eq!(get(&developer, true).await, StatusCode::OK);
    hand.advance(minute);
    assert_eq!(get(&developer, true).await, StatusCode::UNAUTHORIZED);
    assert_eq!(get(&developer, false).await, StatusCode::UNAUTHORIZED);
    for cookie in [&operator, &authority] {
        assert_eq!(get(cookie, false).await, StatusCode::OK);
    }
    // A session ends with its day, but the operator's of a vehicle that drives.
    fixture.drive(true).await;
    hand.advance(Span::from_secs(12 * 3600));
    assert_eq!(get(&authority, false).await, StatusCode::UNAUTHORIZED);
    assert_eq!(get(&operator, false).await, StatusCode::OK);
}

#[tokio::test]
async fn a_programs_token_is_a_bearer_and_no_cookie() {
    let fixture = Fixture::new().await;
    let developer = fixture.store.add_token("developer", "dashboard", 1).await.unwrap();
    let authority = fixture.store.add_token("authority", "", 1).await.unwrap();
    let send = async |method: Method, path: &str, token: &str| {
        let mut request = as_program(request(method, path, None));
        request.headers_mut().insert(AUTHORIZATION, format!("Bearer {token}").parse().unwrap());
        fixture.send(request).await.status
    };
    let (developer, authority) = (developer.as_str(), authority.as_str());
    for (method, path, token, expected) in [
        (Method::GET, "/api/v1/snapshot", developer, StatusCode::OK),
        (Method::GET, "/api/v1/snapshot", authority, StatusCode::OK),
        (Method::GET, "/developer/audit", authority, StatusCode::OK),
        (Method::POST, "/demo/fault", authority, StatusCode::FORBIDDEN),
        // It is accepted without an origin: no browser sends this header by itself.
        (Method::POST, "/demo/fault", developer, StatusCode::UNSUPPORTED_MEDIA_TYPE),
    ] {
        assert_eq!(send(method.clone(), path, token).await, expected, "{method} {path}");
    }
    let mut as_cookie = request(Method::GET, "/api/v1/snapshot", None);
    as_cookie.headers_mut().insert(COOKIE, format!("telltale={developer}").parse().unwrap());
    assert_eq!(fixture.send(as_cookie).await.status, StatusCode::UNAUTHORIZED);
    let mut foreign = request(Method::POST, "/logout", None);
    foreign.headers_mut().insert(COOKIE, format!("telltale={developer}").parse().unwrap());
    foreign.headers_mut().insert(ORIGIN, "http://evil.example".parse().unwrap());
    assert_ne!(fixture.send(foreign).await.status, StatusCode::OK);
    for token in fixture.store.tokens().await.unwrap() {
        fixture.store.revoke_token(token.number).await.unwrap();
    }
    assert_eq!(send(Method::GET, "/api/v1/snapshot", developer).await, StatusCode::UNAUTHORIZED);
}

#[tokio::test]
async fn an_expired_programs_token_opens_nothing() {
    let (fixture, hand) = Fixture::with_hand().await;
    let token = fixture.store.add_token("developer", "", 1).await.unwrap();
    let mut statuses = Vec::new();
    for _ in 0..2 {
        let mut request = request(Method::GET, "/api/v1/snapshot", None);
        request.headers_mut().insert(AUTHORIZATION, format!("Bearer {}", token.as_str()).parse().unwrap());
        statuses.push(fixture.send(request).await.status);
        hand.advance(Span::from_secs(24 * 3600));
    }
    assert_eq!(statuses, [StatusCode::OK, StatusCode::UNAUTHORIZED]);
}

#[tokio::test]
async fn without_users_the_page_says_how_to_make_the_first_one() {
    let fixture = Fixture::new().await;
    for (name, _, _) in telltale_store::DEMO_USERS {
        fixture.store.remove_user(name).await.unwrap();
    }
    let page = fixture.get("/login", None).await;
    assert!(page.body.contains("telltale user add"), "{}", page.body);
}

#[tokio::test]
async fn while_it_drives_operators_change_at_its_displays_alone() {
    let (fixture, hand) = Fixture::with_hand().await;
    fixture.store.add_user("bert", Role::Operator, "a long password").await.unwrap();
    let driver = fixture.cookie_of("operator").await;
    fixture.drive(true).await;
    let form = "name=bert&secret=a+long+password&take_over=1";
    let refused = log_in_from(&fixture, "10.0.0.9", form).await;
    assert_eq!((refused.status, refused.cookie()), (StatusCode::CONFLICT, None), "{}", refused.body);
    assert!(refused.body.contains("the vehicle drives"), "{}", refused.body);
    hand.advance(Span::from_secs(6));
    settled().await;
    assert_eq!(fixture.get("/", Some(&driver)).await.status, StatusCode::OK);
    fixture.drive(false).await;
    assert_eq!(log_in_from(&fixture, "10.0.0.9", form).await.status, StatusCode::OK);
}

#[tokio::test]
async fn while_it_moves_in_standby_nobody_takes_it_over_from_elsewhere() {
    let (clock, _hand) = Clock::with_hand();
    let (fixture, speed) = Fixture::with_speed(clock).await;
    fixture.store.add_user("bert", Role::Operator, "a long password").await.unwrap();
    let driver = fixture.cookie_of("operator").await;
    fixture.drive(true).await;
    fixture.input(speed(5.0)).await;
    // Its mission component was started again between stops.
    fixture.input(Input::Signal { name: "active".into(), value: false }).await;
    fixture.until(|it| it.stage == Stage::Standby && it.motion.moving == Moving::Yes).await;
    let form = "name=bert&secret=a+long+password&take_over=1";
    let far = log_in_from(&fixture, "10.0.0.9", form).await;
    assert_eq!((far.status, far.cookie()), (StatusCode::CONFLICT, None), "{}", far.body);
    let near = log_in_from(&fixture, "127.0.0.1", form).await;
    assert_eq!(near.status, StatusCode::OK, "{}", near.body);
    assert!(fixture.app.hand_overs.is_announced());
    let developer = form_request("/login", Some(&driver), "name=developer&secret=demo-developer");
    assert_eq!(fixture.send(developer).await.status, StatusCode::CONFLICT, "in the operator's browser");
    assert_eq!(fixture.get("/", Some(&driver)).await.status, StatusCode::OK);
}

#[tokio::test]
async fn a_locked_vehicle_that_is_driven_by_hand_gets_its_operator_at_its_displays_alone() {
    let (clock, _hand) = Clock::with_hand();
    let (fixture, speed) = Fixture::with_speed(clock).await;
    fixture.store.add_user("bert", Role::Operator, "a long password").await.unwrap();
    fixture.input(speed(5.0)).await;
    fixture.until(|it| it.stage == Stage::Locked && it.motion.moving == Moving::Yes).await;
    let form = "name=bert&secret=a+long+password";
    let far = log_in_from(&fixture, "10.0.0.9", form).await;
    assert_eq!((far.status, far.cookie()), (StatusCode::CONFLICT, None), "{}", far.body);
    let near = log_in_from(&fixture, "127.0.0.1", form).await;
    assert_eq!(near.status, StatusCode::OK, "{}", near.body);
}

#[tokio::test]
async fn between_stops_the_place_is_kept_for_its_operator_and_an_empty_one_is_open_to_all() {
    let (clock, hand) = Clock::with_hand();
    let (fixture, speed) = Fixture::with_speed_and(clock, |parts| {
        // Nothing tells that it is at one of its stops.
        let value = WatchedField { topic: TopicId(0), field: 0 };
        parts.driving.position = Some(PositionSource { value, timeout: Span::from_secs(1) });
        assert!(!parts.driving.stops.is_empty());
    })
    .await;
    fixture.store.add_user("bert", Role::Operator, "a long password").await.unwrap();
    let driver = fixture.cookie_of("operator").await;
    fixture.input(Input::Signal { name: "active".into(), value: true }).await;
    fixture.until(|it| it.stage == Stage::Active).await;
    fixture.input(speed(5.0)).await;
    fixture.input(Input::Signal { name: "active".into(), value: false }).await;
    fixture.until(|it| it.stage == Stage::Standby && it.motion.moving == Moving::Yes).await;
    fixture.input(speed(0.0)).await;
    hand.advance(Span::from_secs(2));
    fixture.input(speed(0.0)).await;
    fixture.until(|it| it.motion.moving == Moving::No && it.may_set_off).await;
    let form = "name=bert&secret=a+long+password&take_over=1";
    assert_eq!(log_in_from(&fixture, "10.0.0.9", form).await.status, StatusCode::CONFLICT);
    let left = fixture.post("/logout", Some(&driver), "").await;
    assert_eq!(left.status, StatusCode::SEE_OTHER, "{}", left.body);
    fixture.until(|it| it.operator.is_none() && it.may_set_off).await;
    assert_eq!(log_in_from(&fixture, "10.0.0.9", form).await.status, StatusCode::OK);
    fixture.until(|it| it.operator.as_deref() == Some("bert")).await;
}

#[tokio::test]
async fn a_machine_without_stages_never_drives_and_has_its_operator_wherever_a_password_is_typed() {
    let fixture = Fixture::without_stages().await;
    for name in ["anna", "bert"] {
        fixture.store.add_user(name, Role::Operator, "a long password").await.unwrap();
    }
    for name in ["anna", "bert"] {
        let form = format!("name={name}&secret=a+long+password&take_over=1");
        let answer = log_in_from(&fixture, "10.0.0.9", &form).await;
        assert_eq!(answer.status, StatusCode::OK, "{name}: {}", answer.body);
        let snapshot = fixture.until(|snapshot| snapshot.operator.as_deref() == Some(name)).await;
        assert_eq!((snapshot.stage, fixture.app.hand_overs.is_announced()), (Stage::Active, false));
    }
}

#[tokio::test]
async fn a_driving_vehicle_without_operator_gets_one_at_its_displays_alone() {
    let (fixture, hand) = Fixture::with_hand().await;
    for name in ["anna", "bert"] {
        fixture.store.add_user(name, Role::Operator, "a long password").await.unwrap();
    }
    // It drives before anybody has logged in.
    fixture.drive(true).await;
    let far = log_in_from(&fixture, "10.0.0.9", "name=anna&secret=a+long+password").await;
    assert_eq!((far.status, far.cookie()), (StatusCode::CONFLICT, None), "{}", far.body);
    assert!(far.body.contains("the vehicle drives"), "{}", far.body);
    let near = log_in_from(&fixture, "127.0.0.1", "name=anna&secret=a+long+password").await;
    assert_eq!(near.status, StatusCode::OK, "{}", near.body);
    let in_charge =
        |name: &'static str| move |snapshot: &Snapshot| snapshot.operator.as_deref() == Some(name);
    let snapshot = fixture.until(in_charge("anna")).await;
    assert_eq!(
        (snapshot.stage, fixture.app.hand_overs.is_announced()),
        (Stage::Active, false),
        "at once: nobody leads it"
    );
    // Its operator is removed, and has no session any more.
    fixture.store.remove_user("anna").await.unwrap();
    assert!(!fixture.store.sessions().iter().any(|it| &*it.user == "anna"));
    let form = "name=bert&secret=a+long+password&take_over=1";
    assert_eq!(log_in_from(&fixture, "10.0.0.9", form).await.status, StatusCode::CONFLICT);
    assert_eq!(log_in_from(&fixture, "127.0.0.1", form).await.status, StatusCode::OK);
    assert!(fixture.app.hand_overs.is_announced());
    hand.advance(Span::from_secs(5));
    fixture.until(in_charge("bert")).await;
    assert_eq!(fixture.stage(), Stage::Active);
}

#[tokio::test]
async fn a_user_who_takes_a_driving_vehicle_over_and_logs_out_again_takes_nothing() {
    let (fixture, hand) = Fixture::with_hand().await;
    fixture.store.add_user("bert", Role::Operator, "975310").await.unwrap();
    let driver = fixture.cookie_of("operator").await;
    fixture.drive(true).await;
    let next = fixture.log_in("bert", "975310&take_over=1").await.cookie().unwrap();
    let third = fixture.log_in("bert", "975310&take_over=1").await;
    assert_eq!(third.status, StatusCode::SERVICE_UNAVAILABLE, "one at a time");
    assert_eq!(fixture.post("/logout", Some(&next), "").await.status, StatusCode::SEE_OTHER);
    hand.advance(Span::from_secs(6));
    until(async || !fixture.app.hand_overs.is_announced()).await;
    assert_eq!(fixture.get("/", Some(&driver)).await.status, StatusCode::OK);
    assert_eq!(fixture.store.operator_in_charge().await.unwrap().as_deref(), Some("operator"));
}

#[tokio::test]
async fn logins_of_the_same_account_do_not_end_the_session_of_who_drives() {
    let fixture = Fixture::new().await;
    fixture.store.add_user("anna", Role::Operator, "a long password").await.unwrap();
    let form = "name=anna&secret=a+long+password";
    let driver = log_in_from(&fixture, "127.0.0.1", form).await.cookie().unwrap();
    let place = fixture.app.displays.enter(&fixture.session(&driver)).unwrap();
    fixture.drive(true).await;
    for _ in 0..20 {
        let other = log_in_from(&fixture, "10.0.0.9", form).await;
        assert_eq!(other.status, StatusCode::OK, "{}", other.body);
    }
    assert_eq!(fixture.get("/", Some(&driver)).await.status, StatusCode::OK);
    assert!(fixture.store.sessions().len() <= 17);
    drop(place);
}

#[tokio::test]
async fn strangers_never_delay_the_right_secret_on_a_known_browser_nor_behind_a_proxy() {
    let (mut fixture, hand, _timers) = Fixture::without_time().await;
    for name in ["anna", "bert"] {
        fixture.store.add_user(name, Role::Authority, "a long password").await.unwrap();
    }
    let proxies = Proxies::new(vec!["127.0.0.1".parse().unwrap()]);
    fixture.set(|settings| settings.enrolled = Enrolled::default().behind(proxies));
    let log_in = async |from: &str, name: &str, secret: &str, device: &str| {
        let mut login =
            as_program(form_request("/login", Some(device), &format!("name={name}&secret={secret}")));
        login.extensions_mut().insert(Peer(SocketAddr::from(([127, 0, 0, 1], 40_000))));
        login.headers_mut().insert("x-forwarded-for", format!("10.0.0.7, {from}").parse().unwrap());
        fixture.send(login).await
    };
    let (own, other) = ("203.0.113.5", "203.0.113.6");
    let pin = log_in(own, "anna", "135791", "").await;
    assert_eq!(pin.status, StatusCode::FORBIDDEN, "nobody behind the proxy is a display of the vehicle");
    let first = log_in(own, "anna", "a+long+password", "").await;
    let set = first.headers.get_all("set-cookie").iter().map(|line| line.to_str().unwrap());
    let device = set.filter_map(|line| line.split(';').next()).find(|it| it.starts_with("telltale-device="));
    let device = device.expect("the browser is known from now on").to_owned();
    for round in 0..8 {
        // Each guess as soon as it is looked at, from the same address.
        hand.advance(Span::from_secs(60));
        let guess = log_in(own, "anna", "a+wrong+password", "").await;
        assert_eq!(guess.status, StatusCode::UNAUTHORIZED, "round {round}");
        let right = log_in(own, "anna", "a+long+password", &device).await;
        assert_eq!(right.status, StatusCode::OK, "round {round}: {}", right.body);
        assert_eq!(right.headers.get_all("set-cookie").iter().count(), 1, "it is known already");
    }
    let stranger = log_in(own, "anna", "a+long+password", "").await;
    assert_eq!(stranger.status, StatusCode::TOO_MANY_REQUESTS);
    // The cookie is good for its user alone, and others behind the proxy are others.
    assert_eq!(log_in(own, "bert", "a+long+password", &device).await.status, StatusCode::TOO_MANY_REQUESTS);
    assert_eq!(log_in(other, "bert", "a+long+password", "").await.status, StatusCode::OK);
}

#[tokio::test]
async fn behind_a_proxy_that_names_no_browser_no_pin_will_do() {
    let (mut fixture, hand, _timers) = Fixture::without_time().await;
    fixture.store.add_user("anna", Role::Operator, "135791").await.unwrap();
    let proxies = Proxies::new(vec!["127.0.0.9/32".parse().unwrap()]);
    fixture.set(|settings| settings.enrolled = Enrolled::default().behind(proxies));
    let log_in = async |from: [u8; 4], header: Option<&str>| {
        let mut login = as_program(form_request("/login", None, "name=anna&secret=135791"));
        login.extensions_mut().insert(Peer(SocketAddr::from((from, 40_000))));
        if let Some(header) = header {
            login.headers_mut().insert("x-forwarded-for", header.parse().unwrap());
        }
        hand.advance(Span::from_secs(60));
        fixture.send(login).await.status
    };
    let headers = [
        None,
        Some(""),
        Some("unknown"),
        Some("[::1]:80"),
        Some("203.0.113.5"),
        Some("203.0.113.5,"),
        Some("203.0.113.5:1234"),
        Some("127.0.0.1"),
        Some("203.0.113.5, 127.0.0.1"),
        Some("127.0.0.1, 203.0.113.5"),
        Some("127.0.0.9"),
    ];
    for header in headers {
        assert_eq!(log_in([127, 0, 0, 9], header).await, StatusCode::FORBIDDEN, "{header:?}");
    }
    assert_eq!(log_in([127, 0, 0, 1], Some("203.0.113.5")).await, StatusCode::OK, "no trusted proxy");
}

#[tokio::test(flavor = "multi_thread")]
async fn right_logins_at_once_wait_for_nobody_at_a_display_and_in_a_known_browser() {
    let fixture = Fixture::new().await;
    fixture.store.add_user("anna", Role::Operator, "135791").await.unwrap();
    fixture.store.add_user("dora", Role::Developer, "a long password").await.unwrap();
    let known = log_in_from(&fixture, "203.0.113.5", "name=dora&secret=a+long+password").await;
    let cookies = known.headers.get_all("set-cookie").iter().map(|line| line.to_str().unwrap());
    let device =
        cookies.filter_map(|line| line.split(';').next()).find(|it| it.starts_with("telltale-device="));
    let device = device.expect("the browser is known from now on").to_owned();
    for (from, cookie, form) in [
        ("127.0.0.1", "", "name=anna&secret=135791"),
        ("203.0.113.5", &*device, "name=dora&secret=a+long+password"),
    ] {
        let log_in = |secret: &str| {
            let mut login = as_program(form_request("/login", Some(cookie), &format!("{form}{secret}")));
            login.extensions_mut().insert(Peer(SocketAddr::new(from.parse().unwrap(), 40_000)));
            fixture.start(login)
        };
        let at_once: Vec<_> = (0..8).map(|_| log_in("")).collect();
        for (number, login) in at_once.into_iter().enumerate() {
            assert_eq!(login.await.unwrap().status, StatusCode::OK, "{from}: login {number} of 8");
        }
        // Guesses at once are delayed as they are one after the other.
        let guesses: Vec<_> = (0..8).map(|_| log_in("1")).collect();
        let mut delayed = 0;
        for guess in guesses {
            delayed += usize::from(guess.await.unwrap().status == StatusCode::TOO_MANY_REQUESTS);
        }
        assert!(delayed > 0, "{from}");
    }
}
