//! An operator's action is on the disk before it happens: if the disk takes nothing, nothing changes.

use std::fs::File;
use std::path::PathBuf;
use std::time::Instant;

use axum::http::StatusCode;
use rusqlite::Connection;
use telltale_clock::{Clock, ClockHand};
use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::time::Span;
use telltale_runtime::Rereading;
use telltale_store::Role;
use telltale_store::audit::{Action, Entry, Record, TELLTALE};
use telltale_web::serve;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

use crate::fixture::{Answer, Fixture, as_program, form_request};
use crate::folder::TestFolder;

/// A vehicle whose database can be made read-only.
struct Vehicle {
    fixture: Fixture,
    folder: TestFolder,
    disk: Connection,
    cookie: String,
}

impl Vehicle {
    /// In standby, with an error that nobody acknowledged.
    async fn standing(name: &str) -> Vehicle {
        Vehicle::standing_by(name, Clock::start()).await
    }

    async fn standing_by(name: &str, clock: Clock) -> Vehicle {
        let folder = TestFolder::new(&format!("durable-{name}"));
        let fixture = Fixture::in_folder_by(&folder, clock).await;
        let cookie = fixture.cookie_of("operator").await;
        let disk = Connection::open(folder.join("telltale.db")).unwrap();
        let vehicle = Vehicle { fixture, folder, disk, cookie };
        for status in ["lidar", "imu", "tf", "planner"] {
            vehicle.fixture.status(status, 0, "fine").await;
        }
        vehicle.fixture.until(|snapshot| snapshot.overall == State::Ok).await;
        assert_eq!(vehicle.post("/vehicle/localize", "stop=depot").await.status, StatusCode::OK);
        vehicle.fixture.until(|snapshot| snapshot.stage == Stage::Standby).await;
        vehicle
    }

    async fn post(&self, path: &str, fields: &str) -> Answer {
        let seq = self.fixture.get_json("/api/v1/snapshot", &self.cookie).await["seq"].as_u64().unwrap();
        let form = format!("version={seq}&{fields}");
        self.fixture.send(as_program(form_request(path, Some(&self.cookie), &form))).await
    }

    /// Nothing more can be written into a table, in the middle of a transaction.
    fn fill(&self, table: &str) {
        for what in ["INSERT", "UPDATE", "DELETE"] {
            let trigger = format!(
                "CREATE TRIGGER full_{what} BEFORE {what} ON {table} BEGIN SELECT RAISE(ABORT, 'no room'); END"
            );
            self.disk.execute_batch(&trigger).unwrap();
        }
    }

    fn mend(&self) {
        self.disk
            .execute_batch("DROP TRIGGER full_INSERT; DROP TRIGGER full_UPDATE; DROP TRIGGER full_DELETE;")
            .unwrap();
    }

    /// The disk hangs in the middle of each write, until it is let go or for two seconds.
    fn hold(&self) {
        self.disk.execute_batch("BEGIN IMMEDIATE").unwrap();
    }

    fn let_go(&self) {
        self.disk.execute_batch("COMMIT").unwrap();
    }

    /// The disk no longer answers: the head of the log is written into a pipe that nobody reads.
    async fn stall(&self) -> PathBuf {
        let pipe = self.folder.join(format!("audit.head.{}", std::process::id()));
        let store = &self.fixture.store;
        // The head may be written right now, by this name.
        let deadline = self.fixture.clock.now() + Span::from_secs(60);
        let within = || assert!(self.fixture.clock.now() < deadline, "the disk does not stall");
        while !std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success() {
            within();
            store.recall().await.unwrap();
        }
        // What was written before may make it hang already.
        let soon = std::time::Duration::from_millis(100);
        let _ = tokio::time::timeout(soon, store.record(Record::of(Action::Start, TELLTALE), None)).await;
        while tokio::time::timeout(soon, store.recall()).await.map(|_| within()).is_ok() {}
        pipe
    }

    /// It answers again, as long as what is returned is held.
    fn answer(pipe: PathBuf) -> File {
        let reader = File::options().read(true).write(true).open(&pipe).unwrap();
        std::fs::remove_file(pipe).unwrap();
        reader
    }

    /// Time passes and nobody falls silent, until the storage reports something else.
    async fn until_fault(&self, hand: ClockHand, is_there: bool) {
        let mut fault = self.fixture.store.fault();
        for _ in 0..40 {
            hand.advance(Span::from_millis(500));
            for status in ["lidar", "imu", "tf", "planner"] {
                self.fixture.status(status, 0, "fine").await;
            }
            let said = fault.wait_for(|fault| fault.is_some() == is_there);
            if tokio::time::timeout(std::time::Duration::from_millis(100), said).await.is_ok() {
                return;
            }
        }
        panic!("{:?}", *fault.borrow());
    }

    /// A tap made by a heartbeat that is almost too old.
    async fn post_old(&self, path: &str, fields: &str) -> Answer {
        let beat = self.fixture.clock.wall() - std::time::Duration::from_millis(3_500);
        self.post(path, &format!("{fields}&beat={}", humantime::format_rfc3339_millis(beat))).await
    }

    /// Serves, and with that keeps what changes, until it is told to end.
    async fn serve(&self) -> (oneshot::Sender<()>, JoinHandle<std::io::Result<Instant>>) {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let (end, ends) = oneshot::channel::<()>();
        let (app, clock) = (self.fixture.app.clone(), self.fixture.clock);
        let serving = serve(listener, None, app, async move {
            let _ = ends.await;
            clock.instant(clock.now())
        });
        (end, tokio::spawn(serving))
    }

    /// The newest records, as soon as they are as they should be.
    async fn log(&self, count: u32, is_there: impl Fn(&[Entry]) -> bool) -> Vec<Entry> {
        let deadline = self.fixture.clock.now() + Span::from_secs(10);
        loop {
            let entries = self.fixture.store.audit_entries(None, count).await.unwrap();
            if is_there(&entries) {
                return entries;
            }
            assert!(self.fixture.clock.now() < deadline, "{entries:#?}");
            tokio::time::sleep(std::time::Duration::from_millis(20)).await;
        }
    }

    /// A tap is refused and nothing changes.
    async fn cannot(&self, table: &str, path: &str, fields: &str) {
        let before = self.everything().await;
        self.fill(table);
        let answer = self.post(path, fields).await;
        self.mend();
        assert_eq!(
            (answer.status, answer.cookie()),
            (StatusCode::SERVICE_UNAVAILABLE, None),
            "{path} without {table}"
        );
        assert!(answer.body.contains("The disk is full or broken"), "{path}: {}", answer.body);
        assert_eq!(self.everything().await, before, "{path} without {table}");
    }

    /// Everything that an action could have changed.
    async fn everything(&self) -> String {
        let snapshot = self.fixture.until(|_| true).await;
        let operator = self.fixture.store.operator_in_charge().await.unwrap();
        let written = self.fixture.store.recall().await.unwrap().map(|it| (it.stage, it.pose, it.accepted));
        let records = self.fixture.store.audit_entries(None, 10).await.unwrap();
        let done = records.iter().find(|entry| !entry.was_refused());
        let latched = snapshot.modules.iter().map(|module| module.steps.latched).collect::<Vec<_>>();
        format!(
            "{:?} {:?} {:?} {:?} {:?} {latched:?} {operator:?} {written:?} {done:?}",
            snapshot.stage,
            snapshot.localization,
            snapshot.alarms,
            snapshot.countermeasures,
            snapshot.operator
        )
    }

    async fn end(self) {
        assert_eq!(self.fixture.store.verify_audit().await.unwrap().breach, None);
    }
}

#[tokio::test]
async fn an_action_that_cannot_be_written_is_not_done() {
    let vehicle = Vehicle::standing("actions").await;
    vehicle.fixture.look(&vehicle.cookie);
    for table in ["audit", "vehicle"] {
        let token = vehicle.post("/vehicle/clearance", "").await;
        let token: serde_json::Value = serde_json::from_str(&token.body).unwrap();
        let confirm = format!("token={}", token["token"].as_str().unwrap());
        vehicle.cannot(table, "/vehicle/clearance/confirm", &confirm).await;
        vehicle.cannot(table, "/vehicle/clearance", "").await;
        vehicle.cannot(table, "/vehicle/localize", "stop=depot").await;
    }
    vehicle.fixture.status("lidar", 2, "broken").await;
    vehicle.fixture.until(|snapshot| !snapshot.alarms.is_empty()).await;
    for table in ["audit", "vehicle", "alarms"] {
        vehicle.cannot(table, "/alarms/1/acknowledge", "").await;
        vehicle.cannot(table, "/alarms/sensors/lidar/acknowledge", "").await;
    }
    let answer = vehicle.post("/alarms/1/acknowledge", "").await;
    assert_eq!(answer.status, StatusCode::OK, "{}", answer.body);
    let remembered = vehicle.fixture.store.recall().await.unwrap().unwrap();
    assert!(remembered.alarms[0].acknowledged, "it is on the disk when it is answered");
    vehicle.end().await;
}

#[tokio::test]
async fn what_was_written_as_done_and_is_not_done_is_taken_back() {
    let mut vehicle = Vehicle::standing("deaf").await;
    vehicle.fixture.look(&vehicle.cookie);
    vehicle.fixture = vehicle.fixture.deafened();
    let pose = vehicle.fixture.store.recall().await.unwrap().unwrap().pose;
    let answer = vehicle.post("/vehicle/localize", "stop=depot").await;
    assert_eq!(answer.status, StatusCode::SERVICE_UNAVAILABLE, "{}", answer.body);
    let records = vehicle.fixture.store.audit_entries(None, 2).await.unwrap();
    let outcomes: Vec<_> = records.iter().map(|it| (&*it.action, &*it.outcome)).collect();
    assert_eq!(outcomes[1], ("localize", "done"), "newest first");
    assert!(outcomes[0].0 == "localize" && outcomes[0].1.starts_with("refused: "), "{outcomes:?}");
    let remembered = vehicle.fixture.store.recall().await.unwrap().unwrap();
    assert_eq!((remembered.stage, remembered.pose), (Stage::Standby, pose), "as the vehicle is");
    vehicle.end().await;
}

#[tokio::test]
async fn a_stop_waits_for_no_disk_and_says_what_is_not_recorded() {
    let vehicle = Vehicle::standing("stop").await;
    vehicle.fixture.drive(true).await;
    vehicle.fill("audit");
    let answer = vehicle.post("/vehicle/stop", "").await;
    assert_eq!(answer.status, StatusCode::SERVICE_UNAVAILABLE);
    assert!(answer.body.contains("The vehicle is asked to stop"), "{}", answer.body);
    vehicle.fixture.until(|snapshot| snapshot.stop_requested()).await;
    vehicle.mend();
    vehicle.end().await;
}

#[tokio::test]
async fn a_hand_over_that_cannot_be_written_changes_nothing() {
    let vehicle = Vehicle::standing("hand-over").await;
    let fixture = &vehicle.fixture;
    fixture.store.add_user("bert", Role::Operator, "135791").await.unwrap();
    let take_over =
        || fixture.send(as_program(form_request("/login", None, "name=bert&secret=135791&take_over=1")));
    for table in ["audit", "sessions", "seat", "vehicle"] {
        let before = vehicle.everything().await;
        vehicle.fill(table);
        let answer = take_over().await;
        vehicle.mend();
        assert_eq!((answer.status, answer.cookie()), (StatusCode::SERVICE_UNAVAILABLE, None), "{table}");
        assert_eq!(vehicle.everything().await, before, "{table}");
        assert!(vehicle.fixture.session(&vehicle.cookie).is_open(), "{table}");
    }
    let ended = vehicle.fixture.session(&vehicle.cookie);
    assert_eq!(take_over().await.status, StatusCode::OK);
    assert!(!ended.is_open());
    assert_eq!(fixture.store.operator_in_charge().await.unwrap().as_deref(), Some("bert"));
    let records = fixture.store.audit_entries(None, 2).await.unwrap();
    assert_eq!(records.iter().map(|it| &*it.action).collect::<Vec<_>>(), ["login", "hand-over"]);
    vehicle.end().await;
}

#[tokio::test]
async fn an_action_waits_for_a_disk_that_hangs_no_longer_than_it_counts() {
    // It had begun to be written, or not.
    for has_begun in [true, false] {
        let vehicle = Vehicle::standing(if has_begun { "hangs" } else { "stalls" }).await;
        let store = &vehicle.fixture.store;
        let before = store.recall().await.unwrap().unwrap();
        let pipe = if has_begun { None } else { Some(vehicle.stall().await) };
        if has_begun {
            vehicle.hold();
        }
        let answer = vehicle.post_old("/vehicle/localize", "x=1&y=0&yaw_deg=0").await;
        assert_eq!(answer.status, StatusCode::SERVICE_UNAVAILABLE, "{}", answer.body);
        assert!(answer.body.contains("nothing was changed"), "{}", answer.body);
        if has_begun {
            vehicle.let_go();
        }
        let _answers = pipe.map(Vehicle::answer);
        let (end, served) = vehicle.serve().await;
        let log =
            vehicle.log(20, |log| log.iter().any(|it| it.outcome.contains("did not answer in time"))).await;
        let of_it: Vec<_> = log.iter().filter(|it| it.action == "localize").collect();
        assert!(of_it[0].target.starts_with("at 20") && of_it[0].was_refused(), "{log:#?}");
        // What was begun may have been written; it is taken back.
        assert!(has_begun || of_it.len() == 2, "{log:#?}");
        let snapshot = vehicle.fixture.until(|_| true).await;
        assert_eq!(store.recall().await.unwrap().unwrap().pose, before.pose);
        assert_eq!(
            Some(snapshot.localization.number),
            before.pose.map(|pose| pose.0),
            "not done later either"
        );
        end.send(()).unwrap();
        served.await.unwrap().unwrap();
        vehicle.end().await;
    }
}

#[tokio::test]
async fn a_stop_is_asked_for_while_the_disk_hangs_and_recorded_when_it_answers() {
    let vehicle = Vehicle::standing("hanging-stop").await;
    vehicle.fixture.drive(true).await;
    let pipe = vehicle.stall().await;
    let asked = vehicle.fixture.clock.now();
    let answer = vehicle.post("/vehicle/stop", "").await;
    assert!(vehicle.fixture.clock.now().since(asked) < Span::from_secs(2), "a page waits that long");
    assert_eq!(answer.status, StatusCode::SERVICE_UNAVAILABLE);
    assert!(answer.body.contains("is not recorded yet"), "{}", answer.body);
    assert!(vehicle.fixture.until(|_| true).await.stop_requested());
    let _answers = Vehicle::answer(pipe);
    vehicle.log(5, |log| log.iter().any(|it| it.action == "stop" && !it.was_refused())).await;
    vehicle.end().await;
}

#[tokio::test]
async fn a_logout_waits_for_a_disk_that_hangs_no_longer_than_a_login_and_is_not_done_later() {
    let vehicle = Vehicle::standing("logout").await;
    let pipe = vehicle.stall().await;
    let answer = vehicle.post("/logout", "").await;
    assert_eq!(answer.status, StatusCode::SERVICE_UNAVAILABLE, "{}", answer.body);
    let _answers = Vehicle::answer(pipe);
    let (end, served) = vehicle.serve().await;
    let refused = |it: &Entry| it.action == "logout" && it.outcome.contains("did not answer in time");
    vehicle.log(20, |log| log.iter().any(refused)).await;
    assert_eq!(vehicle.fixture.store.operator_in_charge().await.unwrap().as_deref(), Some("operator"));
    assert!(vehicle.fixture.session(&vehicle.cookie).is_open() && vehicle.fixture.stage() == Stage::Standby);
    end.send(()).unwrap();
    served.await.unwrap().unwrap();
    vehicle.end().await;
}

#[tokio::test]
async fn a_stop_that_a_full_disk_did_not_take_is_recorded_later() {
    let vehicle = Vehicle::standing("late-stop").await;
    vehicle.fixture.drive(true).await;
    vehicle.fill("audit");
    assert_eq!(vehicle.post("/vehicle/stop", "").await.status, StatusCode::SERVICE_UNAVAILABLE);
    vehicle.mend();
    let (end, served) = vehicle.serve().await;
    // What the disk refused says when it was; what only waited for a busy disk needs not.
    let is_there = |it: &Entry| {
        it.action == "stop"
            && it.outcome == "done"
            && (it.target.is_empty() || it.target.starts_with("at 20"))
    };
    vehicle.log(10, |log| log.iter().any(is_there)).await;
    end.send(()).unwrap();
    served.await.unwrap().unwrap();
    vehicle.end().await;
}

#[tokio::test]
async fn no_clearance_is_given_while_the_disk_hangs() {
    let (clock, hand) = Clock::with_hand();
    let vehicle = Vehicle::standing_by("stalled", clock).await;
    let pipe = vehicle.stall().await;
    vehicle.until_fault(hand, true).await;
    let ready = vehicle.fixture.get("/readyz", None).await.status;
    assert_eq!(ready, StatusCode::SERVICE_UNAVAILABLE, "an answer, which pages wait for");
    vehicle.fixture.look(&vehicle.cookie);
    let answer = vehicle.post("/vehicle/clearance", "").await;
    assert_eq!(answer.status, StatusCode::CONFLICT, "{}", answer.body);
    assert!(answer.body.contains("Nothing can be recorded"), "{}", answer.body);
    let _answers = Vehicle::answer(pipe);
    vehicle.until_fault(hand, false).await;
    vehicle.fixture.look(&vehicle.cookie);
    let answer = vehicle.post("/vehicle/clearance", "").await;
    assert_eq!(answer.status, StatusCode::OK, "{}", answer.body);
    vehicle.end().await;
}

#[tokio::test]
async fn what_changed_last_is_kept_at_an_orderly_end() {
    let vehicle = Vehicle::standing("end").await;
    let (end, served) = vehicle.serve().await;
    vehicle.log(20, |log| log.iter().any(|it| it.action == "stage" && it.target == "standby")).await;
    // Within the second after which it would look again.
    vehicle.fixture.drive(true).await;
    end.send(()).unwrap();
    served.await.unwrap().unwrap();
    assert_eq!(vehicle.fixture.store.recall().await.unwrap().unwrap().stage, Stage::Active);
    let newest = &vehicle.fixture.store.audit_entries(None, 1).await.unwrap()[0];
    assert_eq!((&*newest.action, &*newest.target), ("stage", "active"));
    vehicle.end().await;
}

#[tokio::test]
async fn a_configuration_is_not_taken_without_a_record_of_it() {
    let mut vehicle = Vehicle::standing("reload").await;
    let developer = vehicle.fixture.cookie_of("developer").await;
    let mut rereads = std::mem::replace(&mut vehicle.fixture.rereads, tokio::sync::mpsc::channel(1).1);
    let answering = tokio::spawn(async move {
        let mut taken = 0;
        while let Some(reread) = rereads.recv().await {
            taken += u32::from(reread.take);
            let read = Rereading {
                taken: reread.take,
                differences: vec!["group `new` is new".to_owned()],
                problems: None,
                warnings: None,
                judged: true,
                running: [].into(),
                digest: "0123".to_owned(),
            };
            reread.reply.send(read).unwrap();
            if taken > 0 {
                break;
            }
        }
        taken
    });
    let reload = form_request("/developer/configuration/reload", Some(&developer), "shown=0123");
    vehicle.fill("audit");
    let answer = vehicle.fixture.send(as_program(reload)).await;
    vehicle.mend();
    assert_eq!(answer.status, StatusCode::SERVICE_UNAVAILABLE, "{}", answer.body);
    assert!(answer.body.contains("nothing was changed"), "{}", answer.body);
    assert!(!answering.is_finished(), "nobody had it taken");
    let reload = form_request("/developer/configuration/reload", Some(&developer), "shown=0123");
    assert_eq!(vehicle.fixture.send(as_program(reload)).await.status, StatusCode::OK);
    assert_eq!(answering.await.unwrap(), 1);
    vehicle.end().await;
}
