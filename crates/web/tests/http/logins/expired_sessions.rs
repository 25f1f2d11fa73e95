//! Expired sessions: they end with their sockets, whatever the disk does, and over restarts.

use std::time::Duration;

use axum::http::StatusCode;
use rusqlite::Connection;
use telltale_clock::{Clock, ClockHand};
use telltale_engine::input::Input;
use telltale_engine::model::Stage;
use telltale_engine::snapshot::Moving;
use telltale_engine::time::Span;
use telltale_store::audit::Entry;
use telltale_web::DEVELOPER_IDLE_MAX;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::protocol::frame::coding::CloseCode;

use crate::connections::sockets::{Server, Socket, closed, next_json};
use crate::fixture::Fixture;
use crate::folder::TestFolder;

const fn hours(count: u64) -> Span {
    Span::from_secs(count * 3600)
}

/// A data folder, and its database beside those who use it.
pub struct Disk {
    folder: TestFolder,
    database: Connection,
}

impl Disk {
    pub async fn with_fixture(name: &str) -> (Disk, Fixture, ClockHand) {
        let folder = TestFolder::new(&format!("overdue-{name}"));
        let (clock, hand) = Clock::with_hand();
        let fixture = Fixture::in_folder_by(&folder, clock).await;
        let database = Connection::open(folder.join("telltale.db")).unwrap();
        database.busy_timeout(Duration::from_secs(5)).unwrap();
        (Disk { folder, database }, fixture, hand)
    }

    pub fn run(&self, sql: &str) {
        self.database.execute_batch(sql).unwrap();
    }
}

async fn lives(socket: &mut Socket) {
    next_json(socket, |value| value.get("beat").is_some() || value.get("groups").is_some()).await;
}

async fn ends(socket: &mut Socket, whose: &str) {
    let ended = timeout(Duration::from_secs(1), closed(socket)).await;
    assert_eq!(ended.ok(), Some(CloseCode::Policy), "{whose}: within a second");
}

async fn stream(server: &Server, token: &str) -> Socket {
    let bearer = format!("Bearer {token}");
    server.try_connect("/api/v1/stream", &[("authorization", &bearer)]).await.unwrap()
}

#[tokio::test]
async fn what_is_over_ends_its_sockets_within_a_second_a_programs_token_too() {
    let (fixture, hand) = Fixture::with_hand().await;
    let store = fixture.store.clone();
    let server = Server::with(fixture, store).await;
    let fixture = &server.fixture;
    let token = fixture.store.add_token("authority", "", 1).await.unwrap();
    let operator = fixture.cookie_of("operator").await;
    let developer = fixture.cookie_of("developer").await;
    let mut program = stream(&server, token.as_str()).await;
    let mut operator = server.connect("/ws", &operator).await;
    let mut developer = server.connect("/ws", &developer).await;
    for socket in [&mut program, &mut operator, &mut developer] {
        lives(socket).await;
    }
    hand.advance(DEVELOPER_IDLE_MAX);
    ends(&mut developer, "developer").await;
    lives(&mut operator).await;
    hand.advance(hours(12));
    ends(&mut operator, "operator").await;
    fixture.until(|snapshot| snapshot.stage == Stage::Locked).await;
    fixture.status("lidar", 2, "it goes on").await;
    lives(&mut program).await;
    hand.advance(hours(12));
    ends(&mut program, "program").await;
    assert!(fixture.store.sessions().is_empty());
    // Also if something else changes meanwhile: the token is still in the list.
    fixture.store.add_user("anna", telltale_store::Role::Operator, "975310").await.unwrap();
    let other = fixture.store.add_token("developer", "", 1).await.unwrap();
    assert_eq!(fixture.store.sessions().len(), 1);
    assert!(fixture.store.session(&other).is_some() && fixture.store.session(&token).is_none());
}

#[tokio::test]
async fn what_is_over_ends_while_the_disk_takes_nothing_and_is_written_when_it_does() {
    let (disk, fixture, hand) = Disk::with_fixture("full").await;
    let store = fixture.store.clone();
    let server = Server::with(fixture, store).await;
    let fixture = &server.fixture;
    let token = fixture.store.add_token("developer", "", 1).await.unwrap();
    let mut sockets = vec![("program", stream(&server, token.as_str()).await)];
    for name in ["operator", "authority", "developer", "developer"] {
        let cookie = fixture.cookie_of(name).await;
        sockets.push((name, server.connect("/ws", &cookie).await));
    }
    disk.run("CREATE TRIGGER full BEFORE INSERT ON audit BEGIN SELECT RAISE(ABORT, 'no room'); END");
    hand.advance(hours(24));
    for (name, socket) in &mut sockets {
        ends(socket, name).await;
    }
    fixture.until(|snapshot| snapshot.stage == Stage::Locked && snapshot.operator.is_none()).await;
    // Another process changes something, so that all is read again.
    disk.run("DELETE FROM accepted");
    for _ in 0..2 {
        fixture.store.operator_in_charge().await.unwrap();
    }
    assert!(fixture.store.sessions().is_empty(), "what has ended stays so");
    let rows =
        || -> i64 { disk.database.query_row("SELECT count(*) FROM sessions", [], |row| row.get(0)).unwrap() };
    assert_eq!(rows(), 4);
    disk.run("DROP TRIGGER full");
    let mut records = Vec::new();
    let written = async {
        while rows() > 0 || !records.iter().any(|it: &Entry| it.action == "logout") {
            records = fixture.store.audit_entries(None, 12).await.unwrap();
            tokio::task::yield_now().await;
        }
    };
    timeout(Duration::from_secs(5), written).await.expect("the ends are written");
    // What the disk refused begins with its time.
    let target = |it: &Entry| it.target.rsplit("Z: ").next().unwrap_or_default().to_owned();
    let of = |action: &'static str| {
        let of_it = records.iter().filter(move |it| it.action == action);
        of_it.map(move |it| (&*it.who, target(it)))
    };
    let mut ended: Vec<_> = of("session ended").collect();
    ended.sort_unstable();
    let expected = [
        ("authority", "expired"),
        ("developer", "idle"),
        ("developer", "idle"),
        ("developer", "token expired"),
        ("operator", "expired"),
    ];
    assert_eq!(ended, expected.map(|(who, target)| (who, target.to_owned())));
    let locked: Vec<_> = of("logout").collect();
    assert_eq!(locked, [("operator", "no session any more".to_owned())]);
}

#[tokio::test]
async fn an_operator_who_drives_stays_in_charge_over_a_restart() {
    for drives in [true, false] {
        let (disk, fixture, _) = Disk::with_fixture(if drives { "drive" } else { "stand" }).await;
        let operator = fixture.cookie_of("operator").await;
        let authority = fixture.cookie_of("authority").await;
        fixture.drive(drives).await;
        fixture.store.remember(fixture.app.live().unwrap().memory()).await.unwrap();
        disk.run("UPDATE sessions SET created_ms = 1, expires_ms = 2");

        let resumed = Fixture::in_folder_by(&disk.folder, Clock::start()).await;
        let status = async |fixture: &Fixture, cookie: &str| {
            fixture.get("/api/v1/snapshot", Some(cookie)).await.status
        };
        assert_eq!(status(&resumed, &authority).await, StatusCode::UNAUTHORIZED);
        if !drives {
            assert_eq!(resumed.store.operator_in_charge().await.unwrap(), None);
            assert_eq!(status(&resumed, &operator).await, StatusCode::UNAUTHORIZED);
            continue;
        }
        assert_eq!(resumed.stage(), Stage::Active);
        assert_eq!(resumed.store.operator_in_charge().await.unwrap().as_deref(), Some("operator"));
        assert_eq!(status(&resumed, &operator).await, StatusCode::OK);
        // It ends with the drive.
        let store = resumed.store.clone();
        let server = Server::with(resumed, store).await;
        let mut page = server.connect("/ws", &operator).await;
        lives(&mut page).await;
        server.fixture.drive(false).await;
        ends(&mut page, "operator").await;
        server.fixture.until(|snapshot| snapshot.stage == Stage::Locked).await;
        assert_eq!(status(&server.fixture, &operator).await, StatusCode::UNAUTHORIZED);
    }
}

#[tokio::test]
async fn an_operators_session_outlasts_its_time_while_the_vehicle_moves_in_any_stage() {
    let (clock, hand) = Clock::with_hand();
    let (fixture, speed) = Fixture::with_speed(clock).await;
    let store = fixture.store.clone();
    let server = Server::with(fixture, store).await;
    let fixture = &server.fixture;
    let operator = fixture.cookie_of("operator").await;
    let mut page = server.connect("/ws", &operator).await;
    fixture.drive(true).await;
    fixture.input(speed(5.0)).await;
    hand.advance(hours(13));
    // Its mission component was started again between stops.
    fixture.input(Input::Signal { name: "active".into(), value: false }).await;
    fixture.until(|it| it.stage == Stage::Standby && it.motion.moving == Moving::Yes).await;
    lives(&mut page).await;
    assert_eq!(fixture.get("/api/v1/snapshot", Some(&operator)).await.status, StatusCode::OK);
    // Nor does it end while the speed is old: nothing says that it stands.
    hand.advance(hours(48));
    fixture.until(|it| it.motion.moving == Moving::Unknown).await;
    lives(&mut page).await;
    fixture.input(speed(5.0)).await;
    fixture.until(|it| it.motion.moving == Moving::Yes).await;
    // Nobody leaves it meanwhile.
    assert_eq!(fixture.post("/logout", Some(&operator), "").await.status, StatusCode::CONFLICT);
    fixture.input(speed(0.0)).await;
    hand.advance(Span::from_secs(1));
    fixture.input(speed(0.0)).await;
    ends(&mut page, "operator").await;
}

#[tokio::test]
async fn a_restart_gives_a_developer_no_more_time() {
    let (disk, fixture, hand) = Disk::with_fixture("idle").await;
    let cookie = fixture.cookie_of("developer").await;
    let status = async |fixture: &Fixture| fixture.get("/api/v1/snapshot", Some(&cookie)).await.status;
    // As long as somebody works, also beyond the time of an idle user.
    disk.run("UPDATE sessions SET created_ms = created_ms - 3600000");
    hand.advance(Span::from_secs(60));
    assert_eq!(status(&fixture).await, StatusCode::OK);
    fixture.store.note_used(fixture.store.sessions()).await.unwrap();
    // A minute has passed for those that start later, too.
    let later = || {
        let (clock, hand) = Clock::with_hand();
        hand.advance(Span::from_secs(60));
        clock
    };
    let resumed = Fixture::in_folder_by(&disk.folder, later()).await;
    assert_eq!(status(&resumed).await, StatusCode::OK);
    // The end could not be written, and the session's own time is not over.
    disk.run("UPDATE sessions SET used_ms = used_ms - 900000");
    let resumed = Fixture::in_folder_by(&disk.folder, later()).await;
    assert_eq!(status(&resumed).await, StatusCode::UNAUTHORIZED);
}
