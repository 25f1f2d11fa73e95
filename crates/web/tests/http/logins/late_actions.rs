//! Actions that waited for others or for the disk are judged again before they are done.

use axum::http::StatusCode;
use telltale_clock::ClockHand;
use telltale_engine::input::Refusal;
use telltale_engine::model::Stage;
use telltale_engine::restart::preview::Preview;
use telltale_engine::state::State;
use telltale_engine::time::Span;
use telltale_runtime::Rehearsal;
use telltale_store::Role;
use telltale_store::audit::{Action, Entry, Record, TELLTALE};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

use super::expired_sessions::Disk;
use crate::fixture::{Answer, Fixture, as_program, form_request, login_from, settled, until};

/// An operator at a vehicle that stands, whose taps wait between their judgement and the disk.
struct Scene {
    fixture: Fixture,
    hand: ClockHand,
    held: mpsc::Receiver<Rehearsal>,
    cookie: String,
}

/// An action that the engine has judged and not received yet.
struct Judged {
    reply: oneshot::Sender<Result<Preview, Vec<Refusal>>>,
    preview: Result<Preview, Vec<Refusal>>,
}

impl Judged {
    fn go_on(self) {
        self.reply.send(self.preview).unwrap();
    }
}

impl Scene {
    async fn standing() -> Scene {
        let (fixture, hand) = Fixture::with_hand().await;
        Scene::standing_in(fixture, hand).await
    }

    async fn standing_in(fixture: Fixture, hand: ClockHand) -> Scene {
        let cookie = fixture.cookie_of("operator").await;
        for status in ["lidar", "imu", "tf", "planner"] {
            fixture.status(status, 0, "fine").await;
        }
        fixture.until(|snapshot| snapshot.overall == State::Ok).await;
        fixture.get("/", Some(&cookie)).await;
        let version = fixture.link.snapshots.borrow().snapshot.seq;
        let form = format!("version={version}&stop=depot");
        let answer = fixture.send(as_program(form_request("/vehicle/localize", Some(&cookie), &form))).await;
        assert_eq!(answer.status, StatusCode::OK, "{}", answer.body);
        fixture.until(|snapshot| snapshot.stage == Stage::Standby).await;
        let (fixture, held) = fixture.held();
        Scene { fixture, hand, held, cookie }
    }

    /// What is shown now.
    async fn version(&self) -> u64 {
        self.fixture.get_json("/api/v1/snapshot", &self.cookie).await["seq"].as_u64().unwrap()
    }

    fn tap(&self, version: u64, path: &str, fields: &str) -> JoinHandle<Answer> {
        let form = format!("version={version}&{fields}");
        self.fixture.start(as_program(form_request(path, Some(&self.cookie), &form)))
    }

    async fn judged(&mut self) -> Judged {
        let Rehearsal { action, reply } = self.held.recv().await.unwrap();
        let (ours, preview) = oneshot::channel();
        self.fixture.link.rehearsals.send(Rehearsal { action, reply: ours }).await.unwrap();
        Judged { reply, preview: preview.await.unwrap() }
    }

    /// The first step in front of a live display, which is live until the end.
    async fn token(&mut self) -> String {
        self.token_for("/vehicle/clearance").await
    }

    async fn token_for(&mut self, path: &str) -> String {
        let (displays, now) = (&self.fixture.app.displays, self.fixture.clock.now());
        let (place, seq) =
            (displays.enter(&self.fixture.session(&self.cookie)).unwrap(), self.version().await);
        place.sent(seq.into(), now);
        place.confirm(seq.into(), self.fixture.clock.now());
        let asked = self.tap(seq, path, "");
        self.judged().await.go_on();
        let answer = asked.await.unwrap();
        drop(place);
        assert_eq!(answer.status, StatusCode::OK, "{}", answer.body);
        let answer: serde_json::Value = serde_json::from_str(&answer.body).unwrap();
        format!("token={}", answer["token"].as_str().unwrap())
    }

    /// Everything that an action could have changed.
    fn standing_so(&self) -> (Stage, u64) {
        let snapshot = &self.fixture.link.snapshots.borrow().snapshot;
        (snapshot.stage, snapshot.localization.number)
    }

    /// Waits for the record of a refusal.
    async fn until_refused(&self, why: &str) {
        until(async || self.log(5).await.iter().any(|it| it.outcome == format!("refused: {why}"))).await;
    }

    /// The last records, the newest first.
    async fn log(&self, count: u32) -> Vec<Entry> {
        self.fixture.store.audit_entries(None, count).await.unwrap()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Meanwhile {
    TimePasses,
    TheDisplayGoes,
    TheSessionEnds,
    TheVehicleChanges,
}

#[tokio::test]
async fn a_tap_counts_no_more_when_what_it_was_made_for_changes_while_it_waits() {
    use Meanwhile::{TheDisplayGoes, TheSessionEnds, TheVehicleChanges, TimePasses};
    for (meanwhile, is_clearance, status, words) in [
        (TimePasses, false, StatusCode::CONFLICT, "waited too long"),
        (TimePasses, true, StatusCode::CONFLICT, "waited too long"),
        (TheDisplayGoes, true, StatusCode::CONFLICT, "The display is not up to date"),
        (TheSessionEnds, false, StatusCode::UNAUTHORIZED, "Log in first"),
        (TheSessionEnds, true, StatusCode::UNAUTHORIZED, "Log in first"),
        (TheVehicleChanges, true, StatusCode::CONFLICT, "Things have changed"),
    ] {
        let case = format!("{meanwhile:?}, clearance {is_clearance}");
        let mut scene = Scene::standing().await;
        let (path, fields, action) = match is_clearance {
            true => ("/vehicle/clearance/confirm", scene.token().await, "clearance"),
            false => ("/vehicle/localize", "stop=depot".to_owned(), "localize"),
        };
        let place = scene.fixture.app.displays.enter(&scene.fixture.session(&scene.cookie)).unwrap();
        let version = scene.version().await;
        place.sent(version.into(), scene.fixture.clock.now());
        place.confirm(version.into(), scene.fixture.clock.now());
        let (before, last) = (scene.standing_so(), scene.log(1).await[0].number);
        let tap = scene.tap(version, path, &fields);
        let judged = scene.judged().await;
        assert!(judged.preview.is_ok(), "{case}");
        match meanwhile {
            TimePasses => scene.hand.advance(Span::from_secs(5)),
            TheDisplayGoes => drop(place),
            TheSessionEnds => {
                let record = Record::of(Action::SessionEnded, TELLTALE);
                let until = scene.fixture.clock.now() + Span::from_secs(1);
                scene
                    .fixture
                    .store
                    .end_session(&scene.fixture.session(&scene.cookie), record, until)
                    .await
                    .unwrap();
            }
            TheVehicleChanges => {
                scene.fixture.status("tf", 1, "unsure").await;
                scene.fixture.until(|snapshot| snapshot.overall == State::Warning).await;
            }
        }
        judged.go_on();
        let answer = tap.await.unwrap();
        assert_eq!(answer.status, status, "{case}: {}", answer.body);
        assert!(answer.body.contains(words), "{case}: {}", answer.body);
        assert_eq!(scene.standing_so(), before, "{case}");
        let log = scene.log(10).await;
        let outcomes: Vec<_> = log.iter().take_while(|entry| entry.number > last).collect();
        let outcomes: Vec<_> =
            outcomes.iter().filter(|entry| entry.action == action).map(|entry| &*entry.outcome).collect();
        assert!(outcomes[0].starts_with("refused: "), "{case}: {outcomes:?}");
        assert!(status != StatusCode::CONFLICT || outcomes[0].contains(words), "{case}: {outcomes:?}");
        // What the engine alone refuses was written before it was asked.
        let expected: &[&str] = if meanwhile == TheDisplayGoes { &["done"] } else { &[] };
        assert_eq!(&outcomes[1..], expected, "{case}");
        let remembered = scene.fixture.store.recall().await.unwrap().unwrap();
        assert_eq!(remembered.pose.map(|pose| pose.0), Some(before.1), "{case}");
    }
}

#[tokio::test]
async fn an_action_is_taken_back_if_its_tap_counts_no_more_once_the_disk_has_answered() {
    let (disk, fixture, hand) = Disk::with_fixture("taken-back").await;
    let mut scene = Scene::standing_in(fixture, hand).await;
    let (before, version) = (scene.standing_so(), scene.version().await);
    let tap = scene.tap(version, "/vehicle/localize", "x=1&y=0&yaw_deg=0");
    let judged = scene.judged().await;
    disk.run("BEGIN IMMEDIATE");
    judged.go_on();
    // The disk has begun with it once it answers nobody else.
    let store = scene.fixture.store.clone();
    let soon = std::time::Duration::from_millis(50);
    until(async || tokio::time::timeout(soon, store.recall()).await.is_err()).await;
    store.end_at_once(&scene.fixture.session(&scene.cookie), Record::of(Action::SessionEnded, TELLTALE));
    disk.run("COMMIT");
    let answer = tap.await.unwrap();
    assert_eq!(answer.status, StatusCode::UNAUTHORIZED, "{}", answer.body);
    assert_eq!(scene.standing_so(), before);
    let log = scene.log(10).await;
    let outcomes: Vec<_> =
        log.iter().filter(|it| it.action == "localize").take(2).map(|it| &*it.outcome).collect();
    assert!(outcomes[0].starts_with("refused: ") && outcomes[1] == "done", "{log:#?}");
    let pose = store.recall().await.unwrap().unwrap().pose;
    assert_eq!(pose.map(|pose| pose.0), Some(before.1));
}

#[tokio::test]
async fn a_stop_while_a_release_is_being_written_wins() {
    let (disk, fixture, hand) = Disk::with_fixture("stop-wins").await;
    let mut scene = Scene::standing_in(fixture, hand).await;
    scene.fixture.drive(true).await;
    let stop = |scene: &Scene| scene.tap(0, "/vehicle/stop", "");
    assert_eq!(stop(&scene).await.unwrap().status, StatusCode::OK);
    let token = scene.token_for("/vehicle/release").await;
    scene.fixture.look(&scene.cookie);
    let version = scene.version().await;
    let release = scene.tap(version, "/vehicle/release/confirm", &token);
    let judged = scene.judged().await;
    assert!(judged.preview.is_ok(), "{:?}", judged.preview);
    disk.run("BEGIN IMMEDIATE");
    judged.go_on();
    // The disk has begun with it once it answers nobody else.
    let store = scene.fixture.store.clone();
    let soon = std::time::Duration::from_millis(50);
    until(async || tokio::time::timeout(soon, store.recall()).await.is_err()).await;
    let stopped = stop(&scene);
    scene.fixture.until(|snapshot| snapshot.last_stop == 2).await;
    disk.run("COMMIT");
    let answer = release.await.unwrap();
    assert_eq!(answer.status, StatusCode::CONFLICT, "{}", answer.body);
    assert!(answer.body.contains("STOP was tapped in the meantime"), "{}", answer.body);
    let status = stopped.await.unwrap().status;
    // A busy disk may not have recorded it in time.
    assert!(matches!(status, StatusCode::OK | StatusCode::SERVICE_UNAVAILABLE), "{status}");
    assert!(scene.fixture.link.snapshots.borrow().snapshot.stop_requested());
    until(async || {
        let remembered = store.recall().await.unwrap().unwrap();
        remembered.countermeasures.iter().any(|it| it.by_operator.is_some())
    })
    .await;
}

#[tokio::test]
async fn a_confirmation_that_waits_past_its_ten_seconds_clears_nothing() {
    let mut scene = Scene::standing().await;
    let token = scene.token().await;
    for _ in 0..15 {
        // Nobody falls silent meanwhile.
        scene.hand.advance(Span::from_millis(500));
        for status in ["lidar", "imu", "tf", "planner"] {
            scene.fixture.status(status, 0, "fine").await;
        }
        settled().await;
    }
    let place = scene.fixture.app.displays.enter(&scene.fixture.session(&scene.cookie)).unwrap();
    let version = scene.version().await;
    place.sent(version.into(), scene.fixture.clock.now());
    place.confirm(version.into(), scene.fixture.clock.now());
    let tap = scene.tap(version, "/vehicle/clearance/confirm", &token);
    let judged = scene.judged().await;
    assert!(judged.preview.is_ok(), "{:?}", judged.preview);
    scene.hand.advance(Span::from_secs(3));
    judged.go_on();
    let answer = tap.await.unwrap();
    assert_eq!(answer.status, StatusCode::CONFLICT, "{}", answer.body);
    assert!(answer.body.contains("later than 10 s"), "{}", answer.body);
    assert_eq!(scene.standing_so().0, Stage::Standby);
}

#[tokio::test]
async fn a_tap_that_waits_during_a_hand_over_does_nothing_in_the_new_operators_name() {
    let mut scene = Scene::standing().await;
    scene.fixture.store.add_user("bert", Role::Operator, "975310").await.unwrap();
    let before = scene.standing_so();
    let version = scene.version().await;
    let login = form_request("/login", None, "name=bert&secret=975310&take_over=1");
    let hand_over = scene.fixture.start(as_program(login));
    let judged = scene.judged().await;
    let tap = scene.tap(version, "/vehicle/localize", "stop=depot");
    settled().await;
    assert!(!tap.is_finished(), "it waits for the hand-over");
    judged.go_on();
    assert_eq!(hand_over.await.unwrap().status, StatusCode::OK);
    let answer = tap.await.unwrap();
    assert_eq!(answer.status, StatusCode::UNAUTHORIZED, "{}", answer.body);
    assert_eq!(scene.standing_so(), before);
    assert_eq!(scene.fixture.store.operator_in_charge().await.unwrap().as_deref(), Some("bert"));
    assert!(scene.held.try_recv().is_err(), "nobody judged it");
}

#[tokio::test]
async fn the_second_of_two_taps_on_the_same_state_is_refused() {
    let mut scene = Scene::standing().await;
    let (version, (_, number)) = (scene.version().await, scene.standing_so());
    let first = scene.tap(version, "/vehicle/localize", "stop=depot");
    let judged = scene.judged().await;
    let second = scene.tap(version, "/vehicle/localize", "x=1&y=0&yaw_deg=0");
    settled().await;
    assert!(!second.is_finished(), "it waits for the first");
    judged.go_on();
    assert_eq!(first.await.unwrap().status, StatusCode::OK);
    let answer = second.await.unwrap();
    assert_eq!(answer.status, StatusCode::CONFLICT, "{}", answer.body);
    assert!(
        answer.body.contains("Things have changed") && answer.body.contains("\"seq\""),
        "{}",
        answer.body
    );
    assert_eq!(scene.standing_so().1, number + 1);
    assert!(scene.log(1).await[0].outcome.contains("Things have changed"));
}

#[tokio::test]
async fn only_so_many_wait_and_none_longer_than_it_counts() {
    const TAPS: usize = 20;
    const PLACES: usize = 8;
    let mut scene = Scene::standing().await;
    let (version, (_, number)) = (scene.version().await, scene.standing_so());
    let first = scene.tap(version, "/vehicle/localize", "stop=depot");
    let judged = scene.judged().await;
    // It was under way for almost as long as it may be.
    let beat = scene.fixture.clock.wall() - std::time::Duration::from_millis(3_800);
    let beat = humantime::format_rfc3339_millis(beat);
    let old = scene.tap(version, "/vehicle/localize", &format!("stop=depot&beat={beat}")).await.unwrap();
    assert_ne!(old.status, StatusCode::OK, "answered while the first still waits: {}", old.body);
    let mut taps: Vec<_> = (1..TAPS).map(|_| scene.tap(version, "/vehicle/localize", "stop=depot")).collect();
    settled().await;
    let (busy, waiting): (Vec<_>, Vec<_>) = taps.drain(..).partition(JoinHandle::is_finished);
    assert_eq!((busy.len(), waiting.len()), (TAPS - PLACES, PLACES - 1));
    for tap in busy {
        let answer = tap.await.unwrap();
        assert_eq!(answer.status, StatusCode::SERVICE_UNAVAILABLE, "{}", answer.body);
        assert!(
            answer.body.contains("Others are waiting already, so nothing was changed"),
            "{}",
            answer.body
        );
    }
    judged.go_on();
    assert_eq!(first.await.unwrap().status, StatusCode::OK);
    for tap in waiting {
        assert_eq!(tap.await.unwrap().status, StatusCode::CONFLICT);
    }
    assert_eq!(scene.standing_so().1, number + 1);
    let again = scene.tap(scene.version().await, "/vehicle/localize", "stop=depot");
    scene.judged().await.go_on();
    assert_eq!(again.await.unwrap().status, StatusCode::OK, "the places are free again");
}

#[tokio::test]
async fn a_login_that_waits_too_long_or_for_nobody_changes_nothing() {
    for is_late in [true, false] {
        let mut scene = Scene::standing().await;
        scene.fixture.store.add_user("bert", Role::Operator, "975310").await.unwrap();
        let login = form_request("/login", None, "name=bert&secret=975310&take_over=1");
        let hand_over = scene.fixture.start(as_program(login));
        let judged = scene.judged().await;
        if is_late {
            scene.hand.advance(Span::from_secs(5));
            judged.go_on();
            let answer = hand_over.await.unwrap();
            assert_eq!((answer.status, answer.cookie()), (StatusCode::SERVICE_UNAVAILABLE, None));
            scene.until_refused("the disk did not answer in time").await;
        } else {
            // The browser goes away.
            hand_over.abort();
            assert!(hand_over.await.is_err_and(|why| why.is_cancelled()));
            judged.go_on();
            scene.until_refused("nobody waited for it any more").await;
        }
        assert_eq!(scene.fixture.store.operator_in_charge().await.unwrap().as_deref(), Some("operator"));
        assert!(!scene.fixture.store.sessions().iter().any(|session| &*session.user == "bert"));
        assert!(scene.fixture.session(&scene.cookie).is_open());
    }
}

#[tokio::test]
async fn a_logout_that_waits_too_long_changes_nothing() {
    let mut scene = Scene::standing().await;
    let logout = scene.fixture.start(as_program(form_request("/logout", Some(&scene.cookie), "")));
    let judged = scene.judged().await;
    scene.hand.advance(Span::from_secs(5));
    judged.go_on();
    let answer = logout.await.unwrap();
    assert_eq!(answer.status, StatusCode::SERVICE_UNAVAILABLE, "{}", answer.body);
    assert!(scene.fixture.session(&scene.cookie).is_open());
    assert_eq!(scene.fixture.store.operator_in_charge().await.unwrap().as_deref(), Some("operator"));
    scene.until_refused("the disk did not answer in time").await;
}

#[tokio::test]
async fn a_logout_that_the_disk_writes_after_its_time_is_undone() {
    let (disk, fixture, hand) = Disk::with_fixture("late-logout").await;
    let mut scene = Scene::standing_in(fixture, hand).await;
    // On a busy machine the disk may get to it too late to begin: then it is not written at all.
    for _ in 0..20 {
        let logout = scene.fixture.start(as_program(form_request("/logout", Some(&scene.cookie), "")));
        let judged = scene.judged().await;
        disk.run("BEGIN IMMEDIATE");
        scene.hand.advance(Span::from_millis(3800));
        judged.go_on();
        let answer = logout.await.unwrap();
        assert_eq!(answer.status, StatusCode::SERVICE_UNAVAILABLE, "{}", answer.body);
        disk.run("COMMIT");
        let mut log = Vec::new();
        until(async || {
            log = scene.log(2).await;
            log[0].action == "logout" && log[0].outcome.starts_with("refused")
        })
        .await;
        assert_eq!(log[0].outcome, "refused: the disk did not answer in time");
        assert!(scene.fixture.session(&scene.cookie).is_open());
        assert_eq!(scene.fixture.store.operator_in_charge().await.unwrap().as_deref(), Some("operator"));
        assert_eq!(scene.standing_so().0, Stage::Standby);
        if (&*log[1].action, &*log[1].outcome) == ("logout", "done") {
            return;
        }
    }
    panic!("no logout was written late");
}

#[tokio::test]
async fn a_login_in_the_operators_browser_waits_for_a_clearance_and_is_refused_then() {
    let mut scene = Scene::standing().await;
    let token = scene.token().await;
    let place = scene.fixture.app.displays.enter(&scene.fixture.session(&scene.cookie)).unwrap();
    let version = scene.version().await;
    place.sent(version.into(), scene.fixture.clock.now());
    place.confirm(version.into(), scene.fixture.clock.now());
    let tap = scene.tap(version, "/vehicle/clearance/confirm", &token);
    let judged = scene.judged().await;
    let form = "name=developer&secret=demo-developer";
    let mut login = scene.fixture.start(as_program(form_request("/login", Some(&scene.cookie), form)));
    let soon = std::time::Duration::from_millis(500);
    assert!(tokio::time::timeout(soon, &mut login).await.is_err(), "it waits for the clearance");
    judged.go_on();
    let cleared = tap.await.unwrap();
    assert_eq!(cleared.status, StatusCode::OK, "{}", cleared.body);
    let refused = login.await.unwrap();
    assert_eq!(refused.status, StatusCode::CONFLICT, "{}", refused.body);
    assert!(scene.fixture.session(&scene.cookie).is_open());
}

#[tokio::test]
async fn nobody_takes_over_unannounced_when_the_vehicle_drives_off_meanwhile() {
    // At one of its displays the take-over can be announced, with another login.
    for (source, status) in
        [("10.0.0.9", StatusCode::CONFLICT), ("127.0.0.1", StatusCode::SERVICE_UNAVAILABLE)]
    {
        let mut scene = Scene::standing().await;
        scene.fixture.store.add_user("bert", Role::Operator, "a long password").await.unwrap();
        let login = login_from(source, "name=bert&secret=a+long+password&take_over=1");
        let login = scene.fixture.start(login);
        let judged = scene.judged().await;
        assert!(judged.preview.is_ok());
        scene.fixture.drive(true).await;
        scene.fixture.until(|snapshot| snapshot.is_under_way()).await;
        judged.go_on();
        let answer = login.await.unwrap();
        assert_eq!((answer.status, answer.cookie()), (status, None), "{}", answer.body);
        scene.until_refused("the vehicle has begun to drive").await;
        assert!(scene.fixture.session(&scene.cookie).is_open());
        let snapshot = scene.fixture.until(|_| true).await;
        assert_eq!(snapshot.operator.as_deref(), Some("operator"));
        let after_a_restart = scene.fixture.store.operator_in_charge().await.unwrap();
        assert_eq!(after_a_restart.as_deref(), Some("operator"));
    }
}
