//! What an operation was like over hours or weeks: how many alarms, which ones, for how long, and in which stages. The
//! figures are those of ISA-18.2 for alarm systems.

use std::collections::{HashMap, VecDeque};

use rusqlite::{Connection, params};

use super::read::{self, HistoryQuery};
use super::write::{ACKNOWLEDGED, CLEARED, LOST, MOVED, RAISED, STARTED};
use telltale_engine::model::Stage;
use telltale_engine::time::{Span, how_long};

const MINUTE_MS: i64 = 60_000;
/// An alarm that comes so often within a minute chatters.
const CHATTERS: usize = 3;

/// What happened between two instants. Times are milliseconds, instants since 1970.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Statistics {
    pub from_ms: i64,
    pub to_ms: i64,
    /// How long Telltale ran in that time: only this is known of.
    pub recorded_ms: i64,
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
    /// Records that are missing.
    pub lost: u64,
}

/// The alarms of one node: of causes, to which those of their symptoms moved.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct NodeStatistics {
    pub node: String,
    pub alarms: u64,
    /// How long one of them was there, in all.
    pub alarmed_ms: i64,
    pub longest_ms: i64,
    /// It came three times within a minute.
    pub chatters: bool,
}

impl Statistics {
    /// Alarms in an hour of the recorded time.
    pub fn per_hour(&self, alarms: u64) -> Option<f64> {
        (self.recorded_ms > 0).then(|| alarms as f64 * 3_600_000.0 / self.recorded_ms as f64)
    }

    /// The mean recorded time between two alarms of a node.
    pub fn between_alarms_ms(&self, node: &NodeStatistics) -> Option<i64> {
        i64::try_from(node.alarms).ok().filter(|&alarms| alarms > 0).map(|alarms| self.recorded_ms / alarms)
    }

    /// Alarms in an hour, as people read it.
    pub fn rate(&self, alarms: u64) -> String {
        self.per_hour(alarms).map_or_else(String::new, |rate| format!("{rate:.2}"))
    }

    /// The stages, each with its time and its share of the recorded time.
    pub fn shares(&self) -> impl Iterator<Item = (Stage, i64, String)> {
        let share = |ms: i64| format!("{:.0} %", 100.0 * ms as f64 / self.recorded_ms as f64);
        self.stages.iter().map(move |&(stage, ms)| (stage, ms, share(ms)))
    }

    pub fn figures(&self, node: &NodeStatistics) -> NodeFigures {
        NodeFigures {
            an_hour: self.rate(node.alarms),
            between: self.between_alarms_ms(node).map_or_else(String::new, how_long_ms),
            alarmed: how_long_ms(node.alarmed_ms),
            longest: how_long_ms(node.longest_ms),
        }
    }
}

/// The figures of a node, as people read them.
#[derive(Debug, Clone)]
pub struct NodeFigures {
    pub an_hour: String,
    /// Empty without an alarm.
    pub between: String,
    pub alarmed: String,
    pub longest: String,
}

/// Milliseconds, as people read them.
pub fn how_long_ms(ms: i64) -> String {
    how_long(Span::from_millis(u64::try_from(ms).unwrap_or(0)))
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

/// Reads the alarms one by one: their number is bounded by that of all records.
pub fn statistics(connection: &Connection, from_ms: i64, to_ms: i64) -> rusqlite::Result<Statistics> {
    let mut found = Statistics { from_ms, to_ms, ..Statistics::default() };
    // What is recorded ends where the program was last alive.
    let ended_ms = read::alive_ms(connection)?.map_or(to_ms, |alive_ms| alive_ms.min(to_ms)).max(from_ms);
    let query = HistoryQuery { nodes: Vec::new(), signals: Vec::new(), from_ms, to_ms: ended_ms };
    for period in read::stages(connection, &query)? {
        let long_ms = period.to_ms - period.from_ms;
        found.recorded_ms += long_ms;
        match found.stages.iter_mut().find(|(stage, _)| *stage == period.value) {
            Some((_, sum_ms)) => *sum_ms += long_ms,
            None => found.stages.push((period.value, long_ms)),
        }
    }
    found.stages.sort_by_key(|(stage, _)| *stage as i64);

    let mut statement = connection.prepare_cached(
        "SELECT kind, at_ms, number, node.name, other.name FROM records
            LEFT JOIN nodes AS node ON node.id = node LEFT JOIN nodes AS other ON other.id = other
            WHERE kind <> 1 AND kind IN (?, ?, ?, ?, ?, ?) AND at_ms >= ? AND at_ms <= ? ORDER BY at_ms, records.id",
    )?;
    let kinds = (RAISED, MOVED, ACKNOWLEDGED, CLEARED, LOST, STARTED);
    let mut rows =
        statement.query(params![kinds.0, kinds.1, kinds.2, kinds.3, kinds.4, kinds.5, from_ms, to_ms])?;
    let mut open: HashMap<i64, Open> = HashMap::new();
    let mut nodes: HashMap<String, Counted> = HashMap::new();
    let mut recent: VecDeque<i64> = VecDeque::new();
    let mut waits_ms: Vec<i64> = Vec::new();
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
                    waits_ms.push(at_ms - alarm.raised_ms);
                }
            }
            CLEARED => {
                if let Some(alarm) = open.remove(&number) {
                    count(&mut nodes, alarm, at_ms);
                }
            }
            LOST => found.lost += u64::try_from(number).unwrap_or(0),
            // What a restart does not restore ends with its run; what it restores keeps its number.
            _ => {}
        }
    }
    for alarm in open.into_values() {
        let ended_ms = ended_ms.max(alarm.raised_ms);
        count(&mut nodes, alarm, ended_ms);
    }
    waits_ms.sort_unstable();
    found.acknowledged = waits_ms.len() as u64;
    found.to_acknowledge_ms = waits_ms.get(waits_ms.len() / 2).copied();
    let named = nodes.into_iter().map(|(node, counted)| NodeStatistics { node, ..counted.statistics });
    found.nodes = named.collect();
    found.nodes.sort_by(|a, b| (b.alarms, b.alarmed_ms, &a.node).cmp(&(a.alarms, a.alarmed_ms, &b.node)));
    Ok(found)
}

fn count(nodes: &mut HashMap<String, Counted>, alarm: Open, ended_ms: i64) {
    let node = nodes.entry(alarm.node).or_default();
    let long_ms = ended_ms - alarm.raised_ms;
    node.statistics.alarms += 1;
    node.statistics.alarmed_ms += long_ms;
    node.statistics.longest_ms = node.statistics.longest_ms.max(long_ms);
    // They end nearly in the order in which they began.
    node.last.push_back(alarm.raised_ms);
    if node.last.len() > CHATTERS {
        node.last.pop_front();
    }
    if let (Some(first), Some(last)) = (node.last.iter().min(), node.last.iter().max()) {
        node.statistics.chatters |= node.last.len() == CHATTERS && last - first <= MINUTE_MS;
    }
}
