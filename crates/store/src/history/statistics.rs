//! Statistics of an operation over hours or weeks: how many alarms, which ones, for how long, and in which stages. The
//! figures are those of ISA-18.2 for alarm systems.

use std::collections::{HashMap, VecDeque};

use rusqlite::{Connection, OptionalExtension as _, Transaction, params};
use serde::{Deserialize, Serialize};

use super::read::{self, HistoryQuery};
use super::trends::drives;
use super::write::{ACKNOWLEDGED, CLEARED, LOST, MOVED, RAISED};
use telltale_engine::model::Stage;
use telltale_engine::time::{Span, how_long};

const MINUTE_MS: i64 = 60_000;
const HOUR_MS: i64 = 60 * MINUTE_MS;
const DAY_MS: i64 = 24 * HOUR_MS;
/// An alarm that comes so often within a minute chatters.
const CHATTERS: usize = 3;
/// Times to the acknowledgement that are kept of a day whose records are gone.
const WAITS_MAX: usize = 1_000;
/// Nodes of a version that are kept of such a day: the most frequent.
const NODES_MAX: usize = 1_000;
/// Versions of such a day.
const VERSIONS_MAX: usize = 20;
/// Days that are kept so: ten years. Then the oldest goes.
pub const DAYS_MAX: i64 = 3_660;

pub(super) const SCHEMA: &str =
    "CREATE TABLE IF NOT EXISTS days (from_ms INTEGER PRIMARY KEY, data TEXT NOT NULL) STRICT;";

/// The figures between two instants. Times are milliseconds, instants since 1970.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Statistics {
    pub from_ms: i64,
    pub to_ms: i64,
    /// How long Telltale ran in that time: only this is known of.
    pub recorded_ms: i64,
    /// The way in metres; `None` if no speed was known.
    pub driven_m: Option<f64>,
    pub alarms: u64,
    /// The most alarms within ten minutes; ISA-18.2 calls more than ten a flood.
    pub most_in_10_min: u64,
    pub acknowledged: u64,
    /// Half of the acknowledged alarms were acknowledged sooner.
    pub to_acknowledge_ms: Option<i64>,
    /// The share of time in each stage, as time.
    pub stages: Vec<(Stage, i64)>,
    /// Those with an alarm, the most frequent first.
    pub nodes: Vec<NodeStatistics>,
    /// By version of Telltale, in the order in which they ran.
    pub versions: Vec<VersionStatistics>,
    /// Records that are missing.
    pub lost: u64,
    /// How long each acknowledged alarm waited.
    pub waits_ms: Vec<i64>,
}

/// The figures of one version.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct VersionStatistics {
    /// Empty: one that did not say, of an earlier file.
    pub version: String,
    pub recorded_ms: i64,
    pub driven_m: Option<f64>,
    pub alarms: u64,
    /// The most frequent first.
    pub nodes: Vec<NodeStatistics>,
}

/// The alarms of one node: of causes, to which those of their symptoms moved.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct NodeStatistics {
    pub node: String,
    pub alarms: u64,
    /// How long one of them was there, in all.
    pub alarmed_ms: i64,
    pub longest_ms: i64,
    /// It came three times within a minute.
    pub chatters: bool,
}

/// The mean time between failures: the recorded time without the alarms, for each alarm.
pub fn between_failures_ms(recorded_ms: i64, node: &NodeStatistics) -> Option<i64> {
    let alarms = i64::try_from(node.alarms).ok().filter(|&alarms| alarms > 0)?;
    Some((recorded_ms - node.alarmed_ms).max(0) / alarms)
}

/// Alarms on 100 km; `None` if the way is not known or shorter than one.
pub fn per_100_km(alarms: u64, driven_m: Option<f64>) -> Option<f64> {
    driven_m.filter(|&driven_m| driven_m >= 1000.0).map(|driven_m| alarms as f64 * 100_000.0 / driven_m)
}

impl VersionStatistics {
    /// The mean recorded time for each alarm.
    pub fn between_alarms_ms(&self) -> Option<i64> {
        i64::try_from(self.alarms).ok().filter(|&alarms| alarms > 0).map(|alarms| self.recorded_ms / alarms)
    }
}

impl Statistics {
    /// Alarms in an hour of the recorded time.
    pub fn per_hour(&self, alarms: u64) -> Option<f64> {
        (self.recorded_ms > 0).then(|| alarms as f64 * HOUR_MS as f64 / self.recorded_ms as f64)
    }

    /// The mean recorded time between two alarms of a node.
    pub fn between_alarms_ms(&self, node: &NodeStatistics) -> Option<i64> {
        i64::try_from(node.alarms).ok().filter(|&alarms| alarms > 0).map(|alarms| self.recorded_ms / alarms)
    }

    /// Takes in what happened at another time.
    fn add(&mut self, other: Statistics) {
        self.recorded_ms += other.recorded_ms;
        add_way(&mut self.driven_m, other.driven_m);
        self.alarms += other.alarms;
        self.most_in_10_min = self.most_in_10_min.max(other.most_in_10_min);
        self.acknowledged += other.acknowledged;
        self.waits_ms.extend(other.waits_ms);
        self.lost += other.lost;
        for (stage, ms) in other.stages {
            add_stage(&mut self.stages, stage, ms);
        }
        for version in other.versions {
            let known = version_named(&mut self.versions, &version.version);
            known.recorded_ms += version.recorded_ms;
            known.alarms += version.alarms;
            add_way(&mut known.driven_m, version.driven_m);
            known.nodes.extend(version.nodes);
            by_node(&mut known.nodes);
        }
    }

    /// The figures that follow from the others.
    fn sum_up(&mut self) {
        self.stages.sort_by_key(|(stage, _)| *stage as i64);
        self.waits_ms.sort_unstable();
        self.to_acknowledge_ms = self.waits_ms.get(self.waits_ms.len() / 2).copied();
        self.nodes = self.versions.iter().flat_map(|version| version.nodes.iter().cloned()).collect();
        by_node(&mut self.nodes);
        by_frequency(&mut self.nodes);
        for version in &mut self.versions {
            by_frequency(&mut version.nodes);
        }
    }

    /// Within the bounds of a day's sums.
    fn bounded(mut self) -> Statistics {
        self.nodes = Vec::new();
        self.waits_ms.truncate(WAITS_MAX);
        self.versions.truncate(VERSIONS_MAX);
        for version in &mut self.versions {
            by_frequency(&mut version.nodes);
            version.nodes.truncate(NODES_MAX);
        }
        self
    }

    /// Alarms in an hour, as people read it; empty where less than an hour is recorded, which tells nothing of it.
    pub fn rate(&self, alarms: u64) -> String {
        let known = self.per_hour(alarms).filter(|_| self.recorded_ms >= HOUR_MS);
        known.map_or_else(String::new, |rate| format!("{rate:.2}"))
    }

    /// The stages, each with its time and its share of the recorded time.
    pub fn shares(&self) -> impl Iterator<Item = (Stage, i64, String)> {
        let share = |ms: i64| format!("{:.0} %", 100.0 * ms as f64 / self.recorded_ms as f64);
        self.stages.iter().map(move |&(stage, ms)| (stage, ms, share(ms)))
    }

    pub fn figures(&self, node: &NodeStatistics) -> NodeFigures {
        NodeFigures {
            an_hour: self.rate(node.alarms),
            on_100_km: per_100_km(node.alarms, self.driven_m)
                .map_or_else(String::new, |rate| format!("{rate:.2}")),
            between: between_failures_ms(self.recorded_ms, node).map_or_else(String::new, how_long_ms),
            alarmed: how_long_ms(node.alarmed_ms),
            longest: how_long_ms(node.longest_ms),
        }
    }
}

/// The figures of a node, as people read them.
#[derive(Debug, Clone)]
pub struct NodeFigures {
    pub an_hour: String,
    /// Empty if the way is not known.
    pub on_100_km: String,
    /// The mean time between failures; empty without an alarm.
    pub between: String,
    pub alarmed: String,
    pub longest: String,
}

/// Milliseconds, as people read them.
pub fn how_long_ms(ms: i64) -> String {
    how_long(Span::from_millis(u64::try_from(ms).unwrap_or(0)))
}

/// Kilometres, as people read them.
pub fn way(metres: f64) -> String {
    format!("{:.1} km", metres / 1000.0)
}

impl NodeStatistics {
    fn add(&mut self, other: &NodeStatistics) {
        self.alarms += other.alarms;
        self.alarmed_ms += other.alarmed_ms;
        self.longest_ms = self.longest_ms.max(other.longest_ms);
        self.chatters |= other.chatters;
    }
}

fn by_frequency(nodes: &mut [NodeStatistics]) {
    nodes.sort_by(|a, b| (b.alarms, b.alarmed_ms, &a.node).cmp(&(a.alarms, a.alarmed_ms, &b.node)));
}

fn add_way(known: &mut Option<f64>, metres: Option<f64>) {
    if let Some(metres) = metres {
        *known = Some(known.unwrap_or(0.0) + metres);
    }
}

fn add_stage(stages: &mut Vec<(Stage, i64)>, stage: Stage, ms: i64) {
    match stages.iter_mut().find(|(known, _)| *known == stage) {
        Some((_, sum_ms)) => *sum_ms += ms,
        None => stages.push((stage, ms)),
    }
}

/// One of each node.
fn by_node(nodes: &mut Vec<NodeStatistics>) {
    nodes.sort_by(|a, b| a.node.cmp(&b.node));
    nodes.dedup_by(|next, known| {
        let is_same = next.node == known.node;
        if is_same {
            known.add(next);
        }
        is_same
    });
}

fn version_named<'a>(versions: &'a mut Vec<VersionStatistics>, version: &str) -> &'a mut VersionStatistics {
    let index = versions.iter().position(|known| known.version == version).unwrap_or_else(|| {
        versions.push(VersionStatistics { version: version.to_owned(), ..VersionStatistics::default() });
        versions.len() - 1
    });
    &mut versions[index]
}

/// An alarm that is not over.
struct Open {
    node: String,
    raised_ms: i64,
    is_acknowledged: bool,
}

#[derive(Default)]
struct Counted {
    statistics: NodeStatistics,
    /// When the last ones were raised.
    last: VecDeque<i64>,
}

/// Of a span of time, with the days whose records are gone: those that the span touches, as a whole.
pub fn statistics(connection: &Connection, from_ms: i64, to_ms: i64) -> rusqlite::Result<Statistics> {
    let mut found = Statistics { from_ms, to_ms, ..Statistics::default() };
    let mut days = connection
        .prepare_cached("SELECT data FROM days WHERE from_ms > ? AND from_ms <= ? ORDER BY from_ms")?;
    let mut days = days.query([from_ms.saturating_sub(DAY_MS), to_ms])?;
    while let Some(row) = days.next()? {
        // A damaged row is left out.
        if let Ok(day) = serde_json::from_str(row.get_ref(0)?.as_str()?) {
            found.add(day);
        }
    }
    found.add(recorded(connection, (from_ms, to_ms), to_ms)?);
    found.sum_up();
    Ok(found)
}

/// Of the records that there are, up to the last instant of those that count. Reads the alarms one by one: their number
/// is bounded by that of all records.
fn recorded(
    connection: &Connection,
    (from_ms, to_ms): (i64, i64),
    last_ms: i64,
) -> rusqlite::Result<Statistics> {
    let mut found = Statistics { from_ms, to_ms, ..Statistics::default() };
    // The record ends where the program was last alive.
    let ended_ms = read::alive_ms(connection)?.map_or(to_ms, |alive_ms| alive_ms.min(to_ms)).max(from_ms);
    let query = HistoryQuery { nodes: Vec::new(), signals: Vec::new(), from_ms, to_ms: ended_ms };
    let runs = read::runs(connection, &query)?;
    for run in &runs {
        let long_ms = run.to_ms - run.from_ms;
        found.recorded_ms += long_ms;
        version_named(&mut found.versions, &run.version).recorded_ms += long_ms;
    }
    for period in read::stages(connection, &query)? {
        add_stage(&mut found.stages, period.value, period.to_ms - period.from_ms);
    }
    let version_at = |at_ms: i64| {
        let run = runs.iter().rev().find(|run| run.from_ms <= at_ms);
        run.or(runs.first()).map_or("", |run| &*run.version)
    };
    for (at_ms, metres) in drives(connection, from_ms, ended_ms.min(last_ms))? {
        add_way(&mut found.driven_m, Some(metres));
        add_way(&mut version_named(&mut found.versions, version_at(at_ms)).driven_m, Some(metres));
    }

    let mut statement = connection.prepare_cached(
        "SELECT kind, at_ms, number, node.name, other.name FROM records
            LEFT JOIN nodes AS node ON node.id = node LEFT JOIN nodes AS other ON other.id = other
            WHERE kind <> 1 AND kind IN (?, ?, ?, ?, ?) AND at_ms >= ? AND at_ms <= ? ORDER BY at_ms, records.id",
    )?;
    let mut rows = statement.query(params![RAISED, MOVED, ACKNOWLEDGED, CLEARED, LOST, from_ms, last_ms])?;
    let mut open: HashMap<i64, Open> = HashMap::new();
    // By version and node.
    let mut nodes: HashMap<(&str, String), Counted> = HashMap::new();
    let mut recent: VecDeque<i64> = VecDeque::new();
    let mut over = |alarm: Open, ended_ms: i64| {
        count(nodes.entry((version_at(alarm.raised_ms), alarm.node)).or_default(), alarm.raised_ms, ended_ms);
    };
    while let Some(row) = rows.next()? {
        let (kind, at_ms): (i64, i64) = (row.get(0)?, row.get(1)?);
        let number = row.get::<_, Option<i64>>(2)?.unwrap_or_default();
        let name = |column| row.get::<_, Option<String>>(column).map(Option::unwrap_or_default);
        match kind {
            RAISED => {
                found.alarms += 1;
                recent.push_back(at_ms);
                recent.retain(|&then| then > at_ms - 10 * MINUTE_MS);
                found.most_in_10_min = found.most_in_10_min.max(recent.len() as u64);
                open.insert(number, Open { node: name(3)?, raised_ms: at_ms, is_acknowledged: false });
            }
            MOVED => {
                if let Some(alarm) = open.get_mut(&number) {
                    alarm.node = name(4)?;
                }
            }
            ACKNOWLEDGED => {
                if let Some(alarm) = open.get_mut(&number).filter(|alarm| !alarm.is_acknowledged) {
                    alarm.is_acknowledged = true;
                    found.waits_ms.push(at_ms - alarm.raised_ms);
                }
            }
            CLEARED => {
                if let Some(alarm) = open.remove(&number) {
                    over(alarm, at_ms);
                }
            }
            LOST => found.lost += u64::try_from(number).unwrap_or(0),
            // An alarm that a restart does not restore ends with its run; a restored one keeps its number.
            _ => {}
        }
    }
    for alarm in open.into_values() {
        let ended_ms = ended_ms.max(alarm.raised_ms);
        over(alarm, ended_ms);
    }
    found.acknowledged = found.waits_ms.len() as u64;
    for ((version, node), counted) in nodes {
        let known = version_named(&mut found.versions, version);
        known.alarms += counted.statistics.alarms;
        known.nodes.push(NodeStatistics { node, ..counted.statistics });
    }
    Ok(found)
}

fn count(node: &mut Counted, raised_ms: i64, ended_ms: i64) {
    let long_ms = ended_ms - raised_ms;
    node.statistics.alarms += 1;
    node.statistics.alarmed_ms += long_ms;
    node.statistics.longest_ms = node.statistics.longest_ms.max(long_ms);
    // They end nearly in the order in which they began.
    node.last.push_back(raised_ms);
    if node.last.len() > CHATTERS {
        node.last.pop_front();
    }
    if let (Some(first), Some(last)) = (node.last.iter().min(), node.last.iter().max()) {
        node.statistics.chatters |= node.last.len() == CHATTERS && last - first <= MINUTE_MS;
    }
}

/// Keeps the statistics of the records from one instant of a day to before another one, which are to be removed. An alarm
/// that is not over counts until then.
pub(super) fn keep_day(transaction: &Transaction<'_>, from_ms: i64, to_ms: i64) -> rusqlite::Result<()> {
    let day_ms = from_ms - from_ms.rem_euclid(DAY_MS);
    let mut day = Statistics { from_ms: day_ms, to_ms, ..Statistics::default() };
    let known = "SELECT data FROM days WHERE from_ms = ?";
    let known: Option<String> = transaction.query_row(known, [day_ms], |row| row.get(0)).optional()?;
    if let Some(known) = known.and_then(|known| serde_json::from_str(&known).ok()) {
        day.add(known);
    }
    day.add(recorded(transaction, (from_ms, to_ms), to_ms - 1)?);
    let data = serde_json::to_string(&day.bounded())
        .map_err(|error| rusqlite::Error::ToSqlConversionFailure(Box::new(error)))?;
    transaction
        .execute("INSERT OR REPLACE INTO days (from_ms, data) VALUES (?, ?)", params![day_ms, data])?;
    let too_many =
        "DELETE FROM days WHERE from_ms <= (SELECT from_ms FROM days ORDER BY from_ms DESC LIMIT 1 OFFSET ?)";
    transaction.execute(too_many, [DAYS_MAX])?;
    Ok(())
}
