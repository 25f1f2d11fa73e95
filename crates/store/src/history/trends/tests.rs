//! Tests of the numbers over days: minutes, hours, bounds, restarts and wall clocks that step.

use std::sync::Arc;
use std::time::{Duration, UNIX_EPOCH};

use rusqlite::Connection;

use super::pack::{Point, Values};
use super::write::Bounds;
use super::*;
use crate::{HISTORY_FILE, History, repair_history};
use telltale_clock::Clock;
use telltale_engine::Engine;
use telltale_engine::input::{Input, StatusArray};
use telltale_engine::model::{Model, Parts, StageModel};
use telltale_engine::time::Timestamp;

/// A whole day since 1970, in milliseconds.
const DAY: i64 = 20_000 * DAY_MS;

struct Disk {
    connection: Connection,
    writer: TrendWriter,
}

impl Disk {
    fn new(bounds: Bounds) -> Disk {
        let connection = Connection::open_in_memory().unwrap();
        crate::history::prepare(&connection).unwrap();
        Disk { connection, writer: TrendWriter::bounded(bounds) }
    }

    /// A minute in which this module had one number, known for all of it.
    fn keep(&mut self, at_ms: i64, node: &str, [least, mean, most]: [f32; 3]) {
        let point = Point { place: 0, tenths: 600, least, mean, most };
        self.keep_all(at_ms, vec![(node.into(), vec![("v".into(), vec![point])])]);
    }

    fn keep_all(&mut self, from_ms: i64, nodes: Vec<(Arc<str>, Values)>) {
        self.writer.try_keep(&mut self.connection, &Minute { from_ms, nodes }).unwrap();
    }

    fn trend(&self, node: &str, from_ms: i64, to_ms: i64, resolution: Resolution) -> Trend {
        trend(&self.connection, &TrendQuery { node: node.to_owned(), from_ms, to_ms, resolution }).unwrap()
    }

    /// When each point begins, in minutes since `DAY`, and its numbers.
    fn points(&self, node: &str, span: (i64, i64), resolution: Resolution) -> Vec<(i64, [f32; 3])> {
        let trend = self.trend(node, DAY + span.0, DAY + span.1, resolution);
        let points = trend.values.first().map(|value| value.points.clone()).unwrap_or_default();
        points.iter().map(|it| ((it.at_ms - DAY) / MINUTE_MS, [it.least, it.mean, it.most])).collect()
    }

    fn rows(&self, level: Level) -> i64 {
        let sql = "SELECT count(*) FROM trends WHERE level = ?";
        self.connection.query_row(sql, [level as i64], |row| row.get(0)).unwrap()
    }
}

#[test]
fn minutes_are_read_before_and_after_their_hour_is_over() {
    let mut disk = Disk::new(Bounds::default());
    disk.keep(DAY, "a", [1.0, 2.0, 3.0]);
    disk.keep(DAY + 2 * MINUTE_MS, "b", [9.0; 3]);
    disk.keep(DAY + 59 * MINUTE_MS, "a", [4.0, 5.0, 6.0]);
    let expected = vec![(0, [1.0, 2.0, 3.0]), (59, [4.0, 5.0, 6.0])];
    let of = |disk: &Disk| disk.points("a", (0, HOUR_MS), Resolution::Minute);
    assert_eq!((disk.rows(Level::Minute), of(&disk)), (3, expected.clone()));
    assert_eq!(disk.points("a", (0, HOUR_MS), Resolution::Hour), [(0, [1.0, 3.5, 6.0])]);
    disk.keep(DAY + HOUR_MS, "a", [7.0; 3]);
    assert_eq!((disk.rows(Level::Minute), disk.rows(Level::Hour)), (1, 2), "a row for each module");
    assert_eq!(disk.points("a", (0, HOUR_MS - 1), Resolution::Minute), expected);
    assert_eq!(
        disk.points("a", (MINUTE_MS, HOUR_MS), Resolution::Minute),
        [(59, [4.0, 5.0, 6.0]), (60, [7.0; 3])]
    );
    assert_eq!(disk.points("a", (0, HOUR_MS), Resolution::Hour), [(0, [1.0, 3.5, 6.0]), (60, [7.0; 3])]);
    assert_eq!(disk.points("nobody", (0, HOUR_MS), Resolution::Minute), []);
}

#[test]
fn too_many_minutes_become_hours_and_nothing_else_is_lost() {
    let mut disk = Disk::new(Bounds { minutes_bytes: 4_000, ..Bounds::default() });
    for hour in 0..60 {
        disk.keep(DAY + hour * HOUR_MS, "a", [hour as f32, 500.0, 1000.0]);
        disk.keep(DAY + hour * HOUR_MS + MINUTE_MS, "a", [100.0, 400.0, 900.0]);
    }
    let trend = disk.trend("a", DAY, DAY + 9 * DAY_MS, Resolution::Minute);
    let first_ms = trend.minutes_from_ms.unwrap();
    assert!(first_ms > DAY + 10 * HOUR_MS && first_ms < DAY + 50 * HOUR_MS, "{first_ms}");
    assert_eq!(trend.values[0].points[0].at_ms, first_ms, "it is said from when on there are minutes");
    assert_eq!((trend.hours_from_ms, disk.rows(Level::Minute)), (Some(DAY), 2));
    let hours = disk.points("a", (0, 9 * DAY_MS), Resolution::Hour);
    assert_eq!(hours.len(), 60);
    for hour in [3, 59] {
        assert_eq!(hours[hour], (60 * hour as i64, [hour as f32, 450.0, 1000.0]));
    }
}

#[test]
fn beyond_its_bytes_minutes_become_hours_and_the_oldest_day_goes() {
    let bounds = Bounds { minutes_bytes: 4_000, hours_bytes: 1_000 };
    let mut disk = Disk::new(bounds);
    for hour in 0..30 * 24 {
        disk.keep(DAY + hour * HOUR_MS, "a", [1.0; 3]);
    }
    let [minutes, hours, days] = counted_bytes(&disk);
    assert!(minutes < 500 && hours <= 4_000 && days <= 1_000, "{minutes} {hours} {days}");
    let trend = disk.trend("a", 0, i64::MAX / 2, Resolution::Hour);
    let first_ms = trend.hours_from_ms.unwrap();
    assert!(first_ms > DAY && first_ms < DAY + 29 * DAY_MS, "{first_ms}");
    assert_eq!(trend.values[0].points[0].at_ms, first_ms, "it is said from when on there is something");
    // The next run of the program counts the same.
    disk.writer = TrendWriter::bounded(bounds);
    disk.keep(DAY + 30 * DAY_MS, "a", [1.0; 3]);
    assert_eq!(disk.rows(Level::Minute), 1);
    let again = counted_bytes(&disk);
    assert!(again[1] <= 4_000 && again[2] <= 1_000, "{again:?}");
}

fn counted_bytes(disk: &Disk) -> [i64; 3] {
    [0, 1, 2].map(|level| {
        let sql = "SELECT ifnull(sum(bytes), 0) FROM trends WHERE level = ?";
        disk.connection.query_row(sql, [level], |row| row.get(0)).unwrap()
    })
}

#[test]
fn a_clock_that_goes_back_and_a_restart_add_to_what_there_is() {
    let mut disk = Disk::new(Bounds::default());
    disk.keep(DAY + 90 * MINUTE_MS, "a", [4.0, 5.0, 6.0]);
    // An hour back: the later minute is no reason to wait.
    disk.keep(DAY + 30 * MINUTE_MS, "a", [1.0; 3]);
    disk.keep(DAY + 31 * MINUTE_MS, "a", [1.0; 3]);
    // Another run begins in the minute in which the one before ended, and the hour comes again.
    disk.writer = TrendWriter::default();
    disk.keep(DAY + 31 * MINUTE_MS, "a", [2.0, 3.0, 8.0]);
    disk.keep(DAY + 90 * MINUTE_MS, "a", [2.0, 3.0, 8.0]);
    disk.keep(DAY + 120 * MINUTE_MS, "a", [0.0; 3]);
    let expected = [(30, [1.0; 3]), (31, [1.0, 2.0, 8.0]), (90, [2.0, 4.0, 8.0]), (120, [0.0; 3])];
    assert_eq!(disk.points("a", (0, DAY_MS), Resolution::Minute), expected);
}

#[test]
fn what_a_clock_that_was_years_ahead_has_left_makes_room_first() {
    let mut disk = Disk::new(Bounds { minutes_bytes: 3_200, hours_bytes: 1_000 });
    let years = 3_650 * DAY_MS;
    for hour in 0..30 {
        disk.keep(DAY + years + hour * HOUR_MS, "a", [9.0; 3]);
    }
    for hour in 0..30 {
        disk.keep(DAY + hour * HOUR_MS, "a", [1.0; 3]);
    }
    assert_eq!(disk.points("a", (0, DAY_MS * 2), Resolution::Minute).len(), 30, "these stay");
    let ahead = disk.points("a", (years, years + 2 * DAY_MS), Resolution::Minute).len();
    assert!(ahead < 10, "{ahead}");
}

#[test]
fn damaged_rows_are_left_out() {
    let mut disk = Disk::new(Bounds::default());
    for minute in 0..2 {
        disk.keep(DAY + minute * MINUTE_MS, "a", [1.0; 3]);
    }
    disk.connection.execute("UPDATE trends SET data = x'00' WHERE from_ms = ?", [DAY]).unwrap();
    assert_eq!(disk.points("a", (0, HOUR_MS), Resolution::Minute), [(1, [1.0; 3])]);
    disk.keep(DAY + HOUR_MS, "a", [1.0; 3]);
    assert_eq!(disk.points("a", (0, HOUR_MS - 1), Resolution::Minute), [(1, [1.0; 3])]);
    let data = super::pack::pack(&vec![("v".into(), Vec::new())]).unwrap();
    assert!((0..data.len()).all(|end| super::pack::unpack(&data[..end]).is_none() || end == data.len()));
    let bomb = zstd::encode_all(&vec![0; 64 << 20][..], 1).unwrap();
    assert_eq!(super::pack::unpack(&bomb), None);
}

/// A vehicle with one module, `other/pump`, in the hands of the test.
struct Vehicle {
    engine: Engine,
    sums: MinuteSums,
    over: Vec<Minute>,
}

impl Vehicle {
    fn new() -> Vehicle {
        let parts = Parts::empty("v", StageModel::None);
        let engine = Engine::new(Arc::new(Model::new(parts).unwrap()), Timestamp::ZERO);
        Vehicle { engine, sums: MinuteSums::default(), over: Vec::new() }
    }

    /// The module says this; nobody looks yet.
    fn say(&mut self, at_ms: u64, values: &[(&str, &str)]) {
        let mut array = StatusArray::default();
        array.push_status(0, "pump", "", "");
        values.iter().for_each(|(key, value)| array.push_value(key, value));
        self.engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(at_ms));
    }

    /// Half a second after half a second goes by, each with a snapshot; the wall clock is ahead by this.
    fn pass(&mut self, from_ms: u64, to_ms: u64, ahead_ms: i64) {
        for at_ms in (from_ms..to_ms).step_by(500) {
            self.engine.handle(&Input::Tick, Timestamp::from_millis(at_ms));
            let wall = UNIX_EPOCH + Duration::from_millis((DAY + ahead_ms) as u64 + at_ms);
            self.over.extend(self.sums.take(&self.engine.snapshot(), wall));
        }
    }

    /// The minutes that are over since the last look, in minutes since `DAY`, each with its values.
    fn over(&mut self) -> Vec<(i64, Vec<(String, Point)>)> {
        let values = |minute: Minute| {
            let all = minute.nodes.into_iter().flat_map(|(_, values)| values);
            ((minute.from_ms - DAY) / MINUTE_MS, all.map(|(key, points)| (key.into(), points[0])).collect())
        };
        std::mem::take(&mut self.over).into_iter().map(values).collect()
    }
}

fn point(tenths: u32, [least, mean, most]: [f32; 3]) -> Point {
    Point { place: 0, tenths, least, mean, most }
}

#[test]
fn a_minute_has_the_least_the_mean_by_time_and_the_greatest() {
    let mut vehicle = Vehicle::new();
    for second in 0..60_u64 {
        // 10 for 45 s, then 30 for 15 s.
        let bar = if second < 45 { "10" } else { "30" };
        vehicle.say(second * 1000, &[("bar", bar), ("bar_warning_above", "50"), ("word", "high")]);
        vehicle.pass(second * 1000, second * 1000 + 1000, 0);
    }
    vehicle.say(60_000, &[("bar", "7")]);
    vehicle.pass(60_000, 60_500, 0);
    assert_eq!(vehicle.over(), [(0, vec![("bar".to_owned(), point(600, [10.0, 15.0, 30.0]))])]);
    let rest = vehicle.sums.end().expect("the minute began");
    assert_eq!((rest.from_ms, rest.nodes[0].1[0].1[0]), (DAY + MINUTE_MS, point(1, [7.0; 3])));
}

#[test]
fn silence_and_what_is_no_number_leave_a_gap() {
    let mut vehicle = Vehicle::new();
    vehicle.say(0, &[("bar", "10"), ("flow", "1")]);
    vehicle.pass(0, 1_500, 0);
    vehicle.say(1_500, &[("bar", "10"), ("flow", "1")]);
    vehicle.pass(1_500, 3_000, 0);
    vehicle.say(3_000, &[("bar", "10"), ("flow", "1")]);
    vehicle.pass(3_000, 4_000, 0);
    for (second, bar) in [(4, "NaN"), (5, "inf"), (6, "-inf"), (7, "1e39"), (8, "many")] {
        vehicle.say(second * 1000, &[("bar", bar), ("flow", "1")]);
        vehicle.pass(second * 1000, second * 1000 + 1000, 0);
    }
    // It is silent from 10 s on, and comes again after a minute without a word.
    vehicle.pass(9_000, 150_000, 0);
    vehicle.say(150_000, &[("bar", "20")]);
    vehicle.pass(150_000, 151_000, 0);
    vehicle.pass(180_000, 180_500, 0);
    let over = vehicle.over();
    assert_eq!(over.iter().map(|(minute, _)| *minute).collect::<Vec<_>>(), [0, 2]);
    let [bar, flow] = &*over[0].1 else { panic!("{over:?}") };
    assert_eq!(bar, &("bar".to_owned(), point(40, [10.0; 3])));
    assert_eq!((flow.1.least, flow.1.most), (1.0, 1.0));
    assert!((95..=105).contains(&flow.1.tenths), "{flow:?}");
    assert_eq!((over[1].1.len(), over[1].1[0].1.mean), (1, 20.0));
}

#[test]
fn a_step_of_the_wall_clock_ends_the_minute_and_counts_no_time_twice() {
    let mut vehicle = Vehicle::new();
    vehicle.say(0, &[("bar", "1")]);
    vehicle.pass(0, 1_500, 10 * MINUTE_MS);
    vehicle.say(1_500, &[("bar", "3")]);
    vehicle.pass(1_500, 3_000, 0);
    vehicle.over.extend(vehicle.sums.end());
    let over = vehicle.over();
    assert_eq!(over.iter().map(|(minute, _)| *minute).collect::<Vec<_>>(), [10, 0]);
    let tenths: u32 = over.iter().map(|(_, values)| values[0].1.tenths).sum();
    assert_eq!((over[0].1[0].1.mean, tenths), (1.0, 25));
}

#[tokio::test]
async fn the_last_minute_of_a_run_is_there_after_a_restart_and_in_what_is_repaired() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let minute = |from_ms| Minute {
        from_ms,
        nodes: vec![("a".into(), vec![("v".into(), vec![point(600, [1.0; 3])])])],
    };
    for from_ms in [DAY, DAY + 5 * MINUTE_MS] {
        let (history, queue) = History::open(folder, Clock::start()).unwrap();
        history.keep_minute(minute(from_ms)).await;
        drop(queue);
        history.written().await;
    }
    // Somebody removes a record, so the file is made anew.
    let beside = Connection::open(folder.join(HISTORY_FILE)).unwrap();
    beside.execute_batch("INSERT OR REPLACE INTO alive (one, at_ms, rows) VALUES (1, 0, 7)").unwrap();
    drop(beside);
    repair_history(folder, UNIX_EPOCH).unwrap().expect("it is not whole");
    let (history, _queue) = History::open(folder, Clock::start()).unwrap();
    let query =
        TrendQuery { node: "a".into(), from_ms: DAY, to_ms: DAY + HOUR_MS, resolution: Resolution::Minute };
    let trend = history.trend(query).await.unwrap();
    let at: Vec<i64> = trend.values[0].points.iter().map(|point| point.at_ms - DAY).collect();
    assert_eq!(at, [0, 5 * MINUTE_MS]);
}

#[tokio::test]
async fn a_trigger_of_somebody_else_never_acts_on_the_numbers() {
    let mut disk = Disk::new(Bounds::default());
    disk.keep(DAY, "a", [1.0; 3]);
    let trigger = "CREATE TRIGGER forget AFTER INSERT ON trends BEGIN DELETE FROM trends; END";
    disk.connection.execute_batch(trigger).unwrap();
    let minute = Minute { from_ms: DAY + MINUTE_MS, nodes: Vec::new() };
    let refused = disk.writer.try_keep(&mut disk.connection, &minute).unwrap_err();
    assert!(refused.to_string().contains("the trigger forget"), "{refused}");
    disk.writer.keep(&mut disk.connection, &minute);
    assert_eq!(disk.points("a", (0, HOUR_MS), Resolution::Minute), [(0, [1.0; 3])]);
}
