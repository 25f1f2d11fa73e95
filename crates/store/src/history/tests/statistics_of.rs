//! Tests of the statistics: of one span, of versions, of the way, and of days whose records are gone.

use super::*;

#[test]
fn an_operation_is_summed_up_by_its_alarms_and_stages() {
    const HOUR_MS: u64 = 3_600_000;
    let mut disk = Disk::new(ROWS_MAX);
    let raised = |id, node: &str| Recorded::AlarmRaised { id, node: node.into() };
    let cleared = |id, node: &str| Recorded::AlarmCleared { id, node: node.into() };
    disk.write(0, &[Recorded::Started { anew: true }, Recorded::Stage(Stage::Standby)]);
    // Alarms of a node that chatters, the second one acknowledged, and an alarm that moves to its cause and lasts.
    for (id, at_ms) in [(1, 10_000), (2, 25_000), (3, 40_000)] {
        disk.write(at_ms, &[raised(id, "a")]);
        if id == 2 {
            disk.write(at_ms + 3_000, &[Recorded::AlarmAcknowledged { id, node: "a".into() }]);
        }
        disk.write(at_ms + 5_000, &[cleared(id, "a")]);
    }
    disk.write(HOUR_MS, &[Recorded::Stage(Stage::Active), raised(4, "b")]);
    disk.write(HOUR_MS + 1_000, &[Recorded::AlarmMoved { id: 4, symptom: "b".into(), cause: "c".into() }]);
    disk.write(2 * HOUR_MS, &[Recorded::Lost(7)]);
    let of = |from_ms: u64, to_ms: u64| {
        let [from_ms, to_ms] = [from_ms, to_ms].map(|ms| START_MS + ms as i64);
        statistics::statistics(&disk.connection, from_ms, to_ms).unwrap()
    };
    let found = of(0, 2 * HOUR_MS);
    assert_eq!((found.alarms, found.acknowledged, found.to_acknowledge_ms), (4, 1, Some(3_000)));
    assert_eq!((found.most_in_10_min, found.lost), (3, 7));
    let hour_ms = HOUR_MS as i64;
    assert_eq!(found.stages, [(Stage::Standby, hour_ms), (Stage::Active, hour_ms)]);
    assert_eq!((found.recorded_ms, found.per_hour(found.alarms)), (2 * hour_ms, Some(2.0)));
    let node = |node: &str, alarms, alarmed_ms, longest_ms, chatters| NodeStatistics {
        node: node.to_owned(),
        alarms,
        alarmed_ms,
        longest_ms,
        chatters,
    };
    assert_eq!(found.nodes, [node("a", 3, 15_000, 5_000, true), node("c", 1, hour_ms, hour_ms, false)]);
    assert_eq!(found.between_alarms_ms(&found.nodes[1]), Some(2 * hour_ms));
    let later = of(HOUR_MS + 5_000, 2 * HOUR_MS);
    assert_eq!((later.alarms, later.nodes.len(), later.stages.len()), (0, 0, 1));
    // Half an hour tells no rate.
    assert_eq!((found.rate(found.alarms).as_str(), of(0, HOUR_MS / 2).rate(3).as_str()), ("2.00", ""));
}

const DAY: u64 = 24 * 3_600_000;

impl Disk {
    fn statistics(&self, from_ms: u64, to_ms: u64) -> Statistics {
        statistics::statistics(&self.connection, START_MS + from_ms as i64, START_MS + to_ms as i64).unwrap()
    }

    /// Another run of this version.
    fn restart_as(&mut self, version: &str, rows_max: usize) {
        self.writer = Writer::new(&self.connection, rows_max).unwrap().of_version(version);
    }

    /// An alarm of a minute.
    fn alarm(&mut self, at_ms: u64, id: u64, node: &str) {
        self.write(at_ms, &[Recorded::AlarmRaised { id, node: node.into() }]);
        self.write(at_ms + 60_000, &[Recorded::AlarmCleared { id, node: node.into() }]);
    }
}

#[test]
fn each_version_has_its_own_time_and_alarms() {
    let mut disk = Disk::new(ROWS_MAX);
    // A machine without stages.
    disk.restart_as("1", ROWS_MAX);
    disk.write(0, &[Recorded::Started { anew: false }]);
    disk.alarm(1000, 1, "a");
    disk.write(DAY, &[]);
    disk.restart_as("2", ROWS_MAX);
    disk.write(2 * DAY, &[Recorded::Started { anew: false }]);
    disk.alarm(2 * DAY + 1000, 2, "a");
    disk.write(2 * DAY + DAY / 2, &[Recorded::Started { anew: true }]);
    disk.alarm(2 * DAY + DAY / 2 + 1000, 3, "b");
    disk.write(4 * DAY, &[]);
    let found = disk.statistics(0, 10 * DAY);
    assert_eq!((found.recorded_ms, found.alarms, found.stages.len()), (3 * DAY as i64, 3, 0));
    let versions: Vec<(&str, i64, u64)> =
        found.versions.iter().map(|it| (&*it.version, it.recorded_ms, it.alarms)).collect();
    assert_eq!(versions, [("1", DAY as i64, 1), ("2", 2 * DAY as i64, 2)]);
    let a = &found.nodes[0];
    assert_eq!((&*a.node, a.alarms, found.nodes.len()), ("a", 2, 2));
    let up_ms = 3 * DAY as i64 - 120_000;
    assert_eq!(between_failures_ms(found.recorded_ms, a), Some(up_ms / 2));
    assert_eq!(found.driven_m, None, "the way is not known");
    let later = disk.statistics(2 * DAY + 500, 10 * DAY);
    assert_eq!(later.versions.len(), 1);
}

#[test]
fn the_way_gives_alarms_on_100_km() {
    let mut disk = Disk::new(ROWS_MAX);
    disk.restart_as("1", ROWS_MAX);
    disk.write(0, &[Recorded::Started { anew: false }]);
    disk.alarm(1000, 1, "a");
    let mut trends = TrendWriter::default();
    for minute in 0..120 {
        let minute = Minute::of_speed(START_MS + 1000 + minute * 60_000, 5.0);
        trends.keep(&mut disk.connection, &minute);
    }
    disk.write(DAY, &[]);
    let found = disk.statistics(0, DAY);
    let driven_m = found.driven_m.unwrap();
    assert!(
        (driven_m - 36_000.0).abs() < 301.0 && found.versions[0].driven_m == Some(driven_m),
        "{driven_m}"
    );
    assert!((per_100_km(1, found.driven_m).unwrap() - 100_000.0 / driven_m).abs() < 1e-9);
    assert_eq!([per_100_km(1, Some(999.0)), per_100_km(1, None)], [None, None]);
    let half = disk.statistics(3_600_000, DAY).driven_m.unwrap();
    assert!((half - 18_000.0).abs() < 301.0, "{half}");
}

#[test]
fn records_that_go_leave_the_statistics_of_their_days() {
    let [mut whole, mut small] = [ROWS_MAX, 400].map(Disk::new);
    for (disk, rows_max) in [(&mut whole, ROWS_MAX), (&mut small, 400)] {
        disk.restart_as("1", rows_max);
        disk.write(0, &[Recorded::Started { anew: false }, Recorded::Stage(Stage::Standby)]);
        let signal = Recorded::Signal { name: "active".into(), value: Some(true) };
        disk.write(10, &[signal]);
        for day in 0..60_u64 {
            // A week without a word.
            if (30..37).contains(&day) {
                continue;
            }
            for number in 0..10 {
                let at_ms = day * DAY + 3_600_000 * (number + 1);
                disk.alarm(at_ms, day * 10 + number, if number == 0 { "rare" } else { "often" });
                disk.write(
                    at_ms + 30_000,
                    &[shown("often", State::Error, None), shown("often", State::Ok, None)],
                );
            }
            let stage = if day % 2 == 0 { Stage::Active } else { Stage::Standby };
            disk.write(day * DAY + DAY / 2, &[Recorded::Stage(stage)]);
            if day == 20 {
                disk.write(day * DAY + DAY / 2 + 1000, &[Recorded::Lost(3)]);
                disk.restart_as("2", rows_max);
                disk.write(day * DAY + DAY / 2 + 3_600_000, &[Recorded::Started { anew: false }]);
            }
        }
        disk.write(60 * DAY, &[]);
    }
    assert!(small.rows() <= 400, "{}", small.rows());
    let days: i64 = small.connection.query_row("SELECT count(*) FROM days", [], |row| row.get(0)).unwrap();
    assert!(days > 30, "{days}");
    let [expected, found] = [&whole, &small].map(|disk| disk.statistics(0, 61 * DAY));
    assert_eq!(found.nodes, expected.nodes);
    assert_eq!(found.versions, expected.versions);
    assert_eq!((found.recorded_ms, &found.stages), (expected.recorded_ms, &expected.stages));
    assert_eq!(
        (found.alarms, found.lost, found.most_in_10_min),
        (expected.alarms, 3, expected.most_in_10_min)
    );
    // A state that held when its records went holds on.
    let [expected, past] = [&whole, &small].map(|disk| disk.past(&[], 59 * DAY as i64, 60 * DAY as i64));
    assert_eq!((past.stage, past.signals), (expected.stage, expected.signals));
    // The next run of the program goes on with it.
    small.restart_as("2", 400);
    small.write(61 * DAY, &[Recorded::Started { anew: false }]);
    assert_eq!(small.statistics(0, 61 * DAY).nodes, found.nodes);
}
