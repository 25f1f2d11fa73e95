//! Tests of the history: what it keeps, its bound, and damage.

mod statistics_of;

use std::time::{SystemTime, UNIX_EPOCH};

use super::write::Writer;
use super::*;
use telltale_engine::event::Said;
use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::time::{Span, Timestamp};
use telltale_engine::view::record::Recorded;

/// The wall clock at the start of the tests' time.
const START_MS: i64 = 1_000_000;

struct Disk {
    connection: Connection,
    writer: Writer,
}

impl Disk {
    fn new(rows_max: usize) -> Disk {
        let connection = Connection::open_in_memory().unwrap();
        prepare(&connection).unwrap();
        let writer = Writer::new(&connection, rows_max).unwrap();
        Disk { connection, writer }
    }

    /// The program ends abruptly and starts again.
    fn restart(&mut self) {
        self.writer = Writer::new(&self.connection, ROWS_MAX).unwrap();
    }

    fn write(&mut self, at_ms: u64, records: &[Recorded]) {
        let at = Timestamp::from_millis(at_ms);
        let wall = UNIX_EPOCH + Duration::from_millis(START_MS as u64 + at_ms);
        let batch: Vec<Record> = records.iter().map(|what| Record { at, what: what.clone() }).collect();
        self.writer.write(&mut self.connection, &batch, (wall, at)).unwrap();
    }

    fn past(&self, nodes: &[&str], from_ms: i64, to_ms: i64) -> Past {
        let nodes = nodes.iter().map(|&name| name.to_owned()).collect();
        let query = HistoryQuery {
            nodes,
            signals: vec!["active".to_owned()],
            from_ms: START_MS + from_ms,
            to_ms: START_MS + to_ms,
        };
        read::past(&self.connection, &query).unwrap()
    }

    /// From, to and state of each stretch of a node.
    fn stretches(&self, node: &str, from_ms: i64, to_ms: i64) -> Vec<(i64, i64, State)> {
        let past = self.past(&[node], from_ms, to_ms);
        let stretch = |it: &Stretch| (it.from_ms - START_MS, it.to_ms - START_MS, it.state);
        past.nodes[0].stretches.iter().map(stretch).collect()
    }

    fn rows(&self) -> i64 {
        self.connection.query_row("SELECT count(*) FROM records", [], |row| row.get(0)).unwrap()
    }
}

fn shown(node: &str, state: State, cause: Option<&str>) -> Recorded {
    let cause = cause.map(Into::into);
    Recorded::Shown { node: node.into(), state, own: State::Error, cause, said: None, began: None }
}

/// A node that is shown without a cause, with this message.
fn said(node: &str, state: State, message: &str, silent_s: Option<u64>) -> Recorded {
    let said = Said::of(message, silent_s.map(Span::from_secs));
    Recorded::Shown { node: node.into(), state, own: state, cause: None, said, began: None }
}

#[test]
fn what_a_node_reported_is_known_behind_a_mask_and_while_it_was_relevant() {
    let mut disk = Disk::new(ROWS_MAX);
    let signal = |value| Recorded::Signal { name: "active".into(), value };
    disk.write(0, &[Recorded::Started { anew: false }, said("a", State::Ok, "", None), signal(Some(true))]);
    disk.write(100, &[shown("a", State::Ignore, Some("b"))]);
    disk.write(200, &[shown("a", State::Ignore, None), signal(None), Recorded::Stage(Stage::Active)]);
    disk.write(300, &[shown("a", State::Error, None)]);
    // The program was alive, and is not known to be since.
    disk.write(400, &[]);
    let nodes = ["a", "b"].map(str::to_owned);
    let signals = ["active".to_owned()];
    let read = |go_on| read::reported(&disk.connection, (&nodes, &signals), &|| go_on).unwrap();
    let Reported { nodes: reported, signals, stages } = read(true).unwrap();
    assert_eq!(read(false), None);
    let since = |from: i64, to: i64| (from + START_MS, to + START_MS);
    let [signal] = &signals[0][..] else { panic!("{signals:?}") };
    assert_eq!(
        ((signal.from_ms, signal.to_ms), signal.value),
        (since(0, 200), true),
        "it is not known later"
    );
    let [stage] = &stages[..] else { panic!("{stages:?}") };
    assert_eq!(((stage.from_ms, stage.to_ms), stage.value), (since(200, 400), Stage::Active));
    let period = |it: &Period<State>| (it.from_ms - START_MS, it.to_ms - START_MS, it.value);
    let expected =
        [(0, 100, State::Ok), (100, 200, State::Error), (200, 300, State::Ignore), (300, 400, State::Error)];
    assert_eq!(reported[0].iter().map(period).collect::<Vec<_>>(), expected);
    assert_eq!(reported[1], []);
}

#[test]
fn after_the_clock_was_set_back_the_present_is_shown_and_not_what_was_recorded_of_it_before() {
    let mut disk = Disk::new(ROWS_MAX);
    let start = [Recorded::Started { anew: false }, shown("a", State::Ok, None), shown("b", State::Ok, None)];
    disk.write(0, &start);
    disk.write(5000, &[shown("a", State::Warning, None), Recorded::Stage(Stage::Standby)]);
    disk.write(
        6000,
        &[shown("a", State::Ok, None), shown("b", State::Error, None), Recorded::Stage(Stage::Active)],
    );
    // Set back by four seconds. Nothing changes at first, and `a` fails then.
    disk.write(2000, &[]);
    disk.write(4000, &[shown("a", State::Error, None)]);
    let (ok, error) = (State::Ok, State::Error);
    assert_eq!(disk.stretches("a", 0, 5500), [(0, 2000, ok), (2000, 4000, ok), (4000, 5500, error)]);
    assert_eq!(disk.stretches("a", 5200, 7000), [(5200, 7000, error)]);
    assert_eq!(disk.stretches("b", 1000, 3000), [(1000, 2000, ok), (2000, 3000, error)]);
    let stage = disk.past(&[], 3000, 7000).stage;
    assert_eq!(stage.iter().map(|it| it.value).collect::<Vec<_>>(), [Stage::Active]);
}

#[test]
fn what_a_node_showed_is_known_for_any_span() {
    let mut disk = Disk::new(ROWS_MAX);
    disk.write(
        0,
        &[Recorded::Started { anew: false }, shown("a", State::Ok, None), shown("b", State::Ok, None)],
    );
    disk.write(1000, &[shown("a", State::Ignore, Some("b"))]);
    disk.write(3000, &[shown("a", State::Ok, None)]);
    let (ok, ignore) = (State::Ok, State::Ignore);
    for (from, to, expect) in [
        (0, 4000, vec![(0, 1000, ok), (1000, 3000, ignore), (3000, 4000, ok)]),
        (1500, 2000, vec![(1500, 2000, ignore)]),
        (500, 1500, vec![(500, 1000, ok), (1000, 1500, ignore)]),
        (-500, -100, vec![]),
        (3000, 5000, vec![(3000, 5000, ok)]),
    ] {
        assert_eq!(disk.stretches("a", from, to), expect, "{from} to {to}");
    }
    assert_eq!(disk.past(&["a"], 1500, 2000).nodes[0].stretches[0].cause.as_deref(), Some("b"));
    assert!(disk.stretches("nobody", 0, 4000).is_empty());
}

#[test]
fn nothing_is_claimed_for_the_time_between_two_runs_nor_of_what_is_gone() {
    let mut disk = Disk::new(ROWS_MAX);
    disk.write(
        0,
        &[Recorded::Started { anew: false }, shown("a", State::Error, None), shown("b", State::Ok, None)],
    );
    disk.write(2000, &[]);
    disk.restart();
    disk.write(9000, &[Recorded::Started { anew: false }, shown("a", State::Ok, None)]);
    assert_eq!(disk.stretches("a", 0, 10_000), [(0, 2000, State::Error), (9000, 10_000, State::Ok)]);
    assert_eq!(disk.stretches("b", 0, 10_000), [(0, 2000, State::Ok)]);
    assert_eq!(disk.stretches("b", 9500, 10_000), []);
    assert_eq!(disk.stretches("a", 3000, 8000), []);
    disk.write(11_000, &[Recorded::Started { anew: true }, shown("c", State::Ok, None)]);
    assert_eq!(disk.stretches("a", 9500, 12_000), [(9500, 11_000, State::Ok)]);
}

#[test]
fn all_else_that_happened_is_told_in_order() {
    let mut disk = Disk::new(ROWS_MAX);
    let all = [
        (Recorded::Started { anew: false }, PastEvent::Started { anew: false }),
        (Recorded::Stage(Stage::Active), PastEvent::Stage(Stage::Active)),
        (
            Recorded::Signal { name: "active".into(), value: None },
            PastEvent::Signal { name: "active".into(), value: None },
        ),
        (
            Recorded::AlarmRaised { id: 3, node: "a".into() },
            PastEvent::AlarmRaised { id: 3, node: "a".into() },
        ),
        (
            Recorded::AlarmMoved { id: 3, symptom: "a".into(), cause: "b".into() },
            PastEvent::AlarmMoved { id: 3, symptom: "a".into(), cause: "b".into() },
        ),
        (
            Recorded::AlarmCleared { id: 3, node: "b".into() },
            PastEvent::AlarmCleared { id: 3, node: "b".into() },
        ),
        (
            Recorded::AlarmAcknowledged { id: 3, node: "b".into() },
            PastEvent::AlarmAcknowledged { id: 3, node: "b".into() },
        ),
        (Recorded::Left { node: "a".into() }, PastEvent::Left { node: "a".into() }),
        (Recorded::Lost(7), PastEvent::Lost(7)),
    ];
    let records: Vec<Recorded> = all.iter().map(|(record, _)| record.clone()).collect();
    disk.write(5, &records);
    let past = disk.past(&[], 0, 10);
    let told: Vec<PastEvent> = past.events.into_iter().map(|(_, what)| what).collect();
    assert_eq!(told, all.map(|(_, happened)| happened));
    assert!(disk.past(&[], 6, 10).events.is_empty());
}

#[test]
fn the_last_alarms_tell_what_became_of_them() {
    let mut disk = Disk::new(ROWS_MAX);
    let raised = |id, node: &str| Recorded::AlarmRaised { id, node: node.into() };
    disk.write(1, &[shown("a", State::Error, None), raised(1, "a")]);
    disk.write(2, &[Recorded::AlarmAcknowledged { id: 1, node: "a".into() }]);
    disk.write(3, &[shown("a", State::Ok, None), Recorded::AlarmCleared { id: 1, node: "a".into() }]);
    disk.write(4, &[shown("a", State::Error, None), raised(2, "a")]);
    let moved = Recorded::AlarmMoved { id: 2, symptom: "a".into(), cause: "b".into() };
    disk.write(5, &[shown("a", State::Ignore, Some("b")), shown("b", State::Unknown, None), moved]);
    let alarm = |id, node: &str, state, raised_ms: i64| PastAlarm {
        id,
        node: node.to_owned(),
        state,
        raised_ms: START_MS + raised_ms,
        acknowledged_ms: None,
        cleared_ms: None,
    };
    let first = PastAlarm {
        acknowledged_ms: Some(START_MS + 2),
        cleared_ms: Some(START_MS + 3),
        ..alarm(1, "a", State::Error, 1)
    };
    let second = alarm(2, "b", State::Unknown, 4);
    let last = |count| alarms::last_alarms(&disk.connection, count).unwrap();
    assert_eq!(last(1), std::slice::from_ref(&second));
    assert_eq!(last(10), [second.clone(), first]);
}

#[test]
fn the_oldest_go_and_the_present_stays_known() {
    let mut disk = Disk::new(200);
    disk.write(0, &[Recorded::Started { anew: false }, shown("still", State::Warning, None)]);
    for step in 1..=2000_u64 {
        let state = if step % 2 == 0 { State::Ok } else { State::Error };
        disk.write(step * 10, &[shown("busy", state, Some(&format!("cause {step}")))]);
    }
    assert!((100..=200).contains(&disk.rows()), "{}", disk.rows());
    assert_eq!(disk.stretches("still", 19_000, 20_000), [(19_000, 20_000, State::Warning)]);
    assert!(disk.stretches("busy", 19_500, 20_000).len() > 40);
    let names: i64 = disk.connection.query_row("SELECT count(*) FROM nodes", [], |row| row.get(0)).unwrap();
    assert!(names <= 300, "{names} names of causes that nobody remembers");
}

#[tokio::test]
async fn a_database_that_fails_is_survived_and_what_was_lost_is_told() {
    let mut disk = Disk::new(ROWS_MAX);
    disk.connection.execute_batch("PRAGMA query_only = ON").unwrap();
    let batch = [Record { at: Timestamp::ZERO, what: shown("a", State::Ok, None) }];
    let now = (SystemTime::UNIX_EPOCH, Timestamp::ZERO);
    assert!(disk.writer.write(&mut disk.connection, &batch, now).is_err());
    disk.connection.execute_batch("PRAGMA query_only = OFF").unwrap();
    disk.write(10, &[shown("a", State::Error, None)]);
    assert_eq!(disk.past(&[], 0, 20).events, [(START_MS + 10, PastEvent::Lost(1))]);
    assert_eq!(disk.stretches("a", 0, 20), [(10, 20, State::Error)]);
    // A trigger that comes meanwhile never acts.
    let trigger = "CREATE TRIGGER empty AFTER INSERT ON records BEGIN DELETE FROM records; END";
    disk.connection.execute_batch(trigger).unwrap();
    let refused = disk.writer.write(&mut disk.connection, &batch, now).unwrap_err();
    assert!(refused.to_string().contains("the trigger empty"), "{refused}");
    assert_eq!(disk.stretches("a", 0, 20), [(10, 20, State::Error)]);

    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    std::fs::write(folder.join(HISTORY_FILE), [b'x'; 4096]).unwrap();
    assert!(history_damage(folder).is_some());
    let (history, queue) = History::open(folder, Clock::start()).unwrap();
    drop(queue);
    history.written().await;
    assert_eq!(history_damage(folder), None, "another one begins beside it");
    let kept: Vec<_> = std::fs::read_dir(folder).unwrap().map(|it| it.unwrap().path()).collect();
    let kept = kept.iter().find(|it| it.is_dir()).expect("the old one is kept").join(HISTORY_FILE);
    assert_eq!(std::fs::read(kept).unwrap(), [b'x'; 4096]);
}

#[test]
fn the_stage_and_the_signals_are_known_for_any_span() {
    let signal = |value| Recorded::Signal { name: "active".into(), value };
    let mut disk = Disk::new(ROWS_MAX);
    disk.write(0, &[Recorded::Started { anew: false }, Recorded::Stage(Stage::Locked), signal(None)]);
    disk.write(1000, &[Recorded::Stage(Stage::Standby), shown("active", State::Error, None)]);
    disk.write(2000, &[signal(Some(true))]);
    disk.write(2500, &[signal(Some(false))]);
    // It was still alive.
    disk.write(2700, &[]);
    disk.restart();
    disk.write(9000, &[Recorded::Started { anew: false }, Recorded::Stage(Stage::Locked)]);
    let stage = |from, to| {
        let held = disk.past(&[], from, to).stage;
        held.iter().map(|it| (it.from_ms - START_MS, it.to_ms - START_MS, it.value)).collect::<Vec<_>>()
    };
    assert_eq!(stage(500, 1500), [(500, 1000, Stage::Locked), (1000, 1500, Stage::Standby)]);
    assert_eq!(stage(8000, 9500), [(9000, 9500, Stage::Locked)], "it ended before");
    let past = disk.past(&[], 1500, 2600);
    let (name, held) = &past.signals[0];
    let held: Vec<_> = held.iter().map(|it| (it.from_ms - START_MS, it.value)).collect();
    assert_eq!((&**name, held), ("active", vec![(1500, None), (2000, Some(true)), (2500, Some(false))]));
}

fn words(past: &Past) -> Vec<Option<String>> {
    let words = |it: &Stretch| it.said.as_ref().map(|said| said.words().into_owned());
    past.nodes[0].stretches.iter().map(words).collect()
}

#[test]
fn a_silence_and_a_reported_error_are_told_apart() {
    let mut disk = Disk::new(ROWS_MAX);
    let error = State::Error;
    disk.write(0, &[Recorded::Started { anew: false }, said("a", State::Ok, "Images arrive", None)]);
    disk.write(1000, &[said("a", error, "Images arrive", Some(2))]);
    disk.write(2000, &[said("a", State::Ok, "", None)]);
    disk.write(3000, &[said("a", error, "no picture", None)]);
    let told = words(&disk.past(&["a"], 0, 4000));
    let told: Vec<_> = told.iter().map(|it| it.as_deref()).collect();
    let silent = "silent for 2 s; last: Images arrive";
    assert_eq!(told, [Some("Images arrive"), Some(silent), None, Some("no picture")]);
}

#[test]
fn a_long_message_is_cut_between_letters() {
    let cut = Said::of(&format!("a{}", "\u{e4}".repeat(150)), None).unwrap();
    assert_eq!((cut.message.len(), cut.message.chars().count()), (199, 100));
}

#[tokio::test]
async fn a_long_look_into_the_past_keeps_nothing_from_being_recorded() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let clock = Clock::start();
    let (history, queue) = History::open(folder, clock).unwrap();
    let (began, begins) = std::sync::mpsc::channel();
    let (end, ends) = std::sync::mpsc::channel::<()>();
    let reader = history.reader.clone();
    let long = tokio::spawn(async move {
        let wait = move |connection: &Connection| {
            let seen = connection.unchecked_transaction()?;
            let rows: i64 = seen.query_row("SELECT count(*) FROM records", [], |row| row.get(0))?;
            began.send(()).unwrap();
            ends.recv().unwrap();
            Ok(rows)
        };
        reader.read(Duration::from_secs(60), wait).await
    });
    tokio::task::spawn_blocking(move || begins.recv().unwrap()).await.unwrap();
    let what = Recorded::Started { anew: false };
    queue.send(vec![Record { at: clock.now(), what }]).unwrap();
    // Another program sees it on the disk while that query goes on.
    let other = Connection::open(folder.join(HISTORY_FILE)).unwrap();
    let recorded =
        || other.query_row("SELECT count(*) FROM records", [], |row| row.get::<_, i64>(0)).unwrap();
    let start = clock.now();
    while recorded() == 0 {
        assert!(clock.now().since(start) < Span::from_secs(20), "nothing is recorded");
        tokio::task::yield_now().await;
    }
    end.send(()).unwrap();
    assert_eq!(long.await.unwrap().unwrap(), 0);
}

#[tokio::test]
async fn all_that_came_through_the_queue_is_written_before_the_end() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    std::fs::create_dir_all(folder).unwrap();
    let (history, queue) = History::open(folder, Clock::start()).unwrap();
    let record = |ms| Record { at: Timestamp::from_millis(ms), what: Recorded::Stage(Stage::Standby) };
    for ms in 1..=3 {
        queue.send(vec![record(ms)]).unwrap();
    }
    drop(queue);
    history.written().await;
    history.written().await;
    let connection = Connection::open(folder.join(HISTORY_FILE)).unwrap();
    let rows: i64 = connection.query_row("SELECT count(*) FROM records", [], |row| row.get(0)).unwrap();
    assert_eq!(rows, 3);
}

/// A history with this many records, in a file.
async fn with_records(count: u64) -> tempfile::TempDir {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let (history, queue) = History::open(folder, Clock::start()).unwrap();
    let record = |number| Record {
        at: Timestamp::from_millis(number),
        what: shown("pump", if number % 2 == 0 { State::Ok } else { State::Error }, None),
    };
    queue.send((0..count).map(record).collect()).unwrap();
    drop(queue);
    history.written().await;
    temporary
}

#[tokio::test]
async fn records_that_somebody_removed_are_missed() {
    let temporary = with_records(1000).await;
    let folder = temporary.path();
    assert_eq!(history_damage(folder), None);
    let beside = Connection::open(folder.join(HISTORY_FILE)).unwrap();
    beside.execute("DELETE FROM records WHERE id % 2 = 0", []).unwrap();
    drop(beside);
    assert_eq!(history_damage(folder).as_deref(), Some("500 of its records were removed"));
    let saved = repair_history(folder, SystemTime::UNIX_EPOCH).unwrap().expect("it is not whole");
    assert_eq!((saved.records, history_damage(folder)), (500, None));
    assert_eq!(repair_history(folder, SystemTime::UNIX_EPOCH).unwrap(), None);
}

#[tokio::test]
async fn a_history_with_zeroed_pages_is_repaired_or_begun_anew_while_it_is_written() {
    let temporary = with_records(5000).await;
    let folder = temporary.path();
    let path = folder.join(HISTORY_FILE);
    let beside = Connection::open(&path).unwrap();
    beside.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(())).unwrap();
    drop(beside);
    for suffix in ["-wal", "-shm"] {
        let _ = std::fs::remove_file(folder.join(format!("{HISTORY_FILE}{suffix}")));
    }
    let mut bytes = std::fs::read(&path).unwrap();
    let pages = bytes.len() / 4096;
    bytes[4096 * pages / 2..].fill(0);
    std::fs::write(&path, &bytes).unwrap();
    assert!(history_damage(folder).is_some());
    // A history that fails while it is written is followed by another one, which is then whole.
    let (history, queue) = History::open(folder, Clock::start()).unwrap();
    for _ in 0..3 {
        queue.send(vec![Record { at: Timestamp::ZERO, what: shown("fan", State::Error, None) }]).unwrap();
    }
    drop(queue);
    history.written().await;
    drop(history);
    if let Some(damage) = history_damage(folder) {
        assert!(!damage.is_empty());
        repair_history(folder, SystemTime::UNIX_EPOCH).unwrap().expect("it is damaged");
        assert_eq!(history_damage(folder), None);
    }
}

#[tokio::test]
async fn a_history_with_a_foreign_trigger_is_told_put_aside_and_repaired() {
    for is_repaired in [false, true] {
        let temporary = with_records(10).await;
        let folder = temporary.path();
        let forget = "CREATE TRIGGER forget AFTER INSERT ON records BEGIN DELETE FROM records; END";
        Connection::open(folder.join(HISTORY_FILE)).unwrap().execute_batch(forget).unwrap();
        let damage = history_damage(folder).expect("it is told");
        assert_eq!(damage, "the trigger forget of records is not Telltale's");
        if is_repaired {
            let saved = repair_history(folder, SystemTime::UNIX_EPOCH).unwrap().expect("it is damaged");
            assert_eq!((saved.records, saved.damage), (10, damage));
        }
        let (history, queue) = History::open(folder, Clock::start()).unwrap();
        drop(queue);
        history.written().await;
        assert_eq!(history_damage(folder), None);
        let kept = Connection::open(folder.join(HISTORY_FILE)).unwrap();
        let records: i64 = kept.query_row("SELECT count(*) FROM records", [], |row| row.get(0)).unwrap();
        assert_eq!(records, if is_repaired { 10 } else { 0 });
    }
}
