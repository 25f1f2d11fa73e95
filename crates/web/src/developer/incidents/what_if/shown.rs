//! The result of a what-if, for its page: a row for each incident, and the strips of the nodes that differ, both sides
//! below one another.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::developer::incidents::sentences::stage_word;
use crate::developer::timeline::strips::Painter;
use crate::developer::timeline::{Tick, ticks};
use crate::developer::why_address;
use crate::incidents::{Compared, Trouble};
use crate::texts::{DevWords, IncidentWords, Lang, MESSAGE, NAME, clean};
use telltale_clock::unix_ms;
use telltale_engine::time::Timestamp;
use telltale_engine::view::record::Stretch;
use telltale_picture::bars::patterns;
use telltale_picture::strips::{Axis, recorded, stamp};
use telltale_replay::compare::{Comparison, NodeDifference, Parting, PartingOf};
use telltale_replay::line::seconds;
use telltale_replay::{Shown, Totals};

/// Nodes with strips.
const NODES: usize = 30;
/// Names and notes that are listed.
const NAMED: usize = 12;

/// One incident of the table.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    pub id: u64,
    /// The address of the page with its strips; `None` for the chosen one.
    pub address: Option<String>,
    pub differs: bool,
    pub trouble: Option<String>,
    /// The first difference, and its time.
    pub first: Option<First>,
    pub cells: Vec<Cell>,
    pub alarms_gone: String,
    pub alarms_new: String,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct First {
    /// Its wall time, in milliseconds since 1970.
    pub at_ms: i64,
    pub after: String,
    pub clock: String,
    pub what: String,
    pub was: String,
    pub is: String,
}

/// A number of both sides.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Cell {
    pub was: String,
    pub is: String,
}

impl Cell {
    pub fn differs(&self) -> bool {
        self.was != self.is
    }
}

impl Row {
    pub fn of(lang: Lang, compared: &Compared, chosen: u64, page: u64) -> Row {
        let it = IncidentWords::of(lang);
        let id = compared.incident;
        let address = (id != chosen).then(|| format!("/incidents/{page}/what-if?of={id}"));
        match &compared.result {
            Err(trouble) => Row {
                id,
                address: None,
                differs: false,
                trouble: Some(clean(trouble_words(it, trouble), 4 * MESSAGE)),
                first: None,
                cells: Vec::new(),
                alarms_gone: String::new(),
                alarms_new: String::new(),
            },
            Ok(comparison) => Row {
                id,
                address,
                differs: comparison.differs(),
                trouble: None,
                first: comparison.first.as_ref().map(|first| first_of(lang, comparison, first)),
                cells: cells(&comparison.recorded, &comparison.new),
                alarms_gone: names(lang, &comparison.alarms_gone),
                alarms_new: names(lang, &comparison.alarms_new),
            },
        }
    }
}

fn trouble_words<'a>(it: &'static IncidentWords, trouble: &'a Trouble) -> &'a str {
    match trouble {
        Trouble::Missing => it.missing,
        Trouble::TooLarge => it.too_large,
        Trouble::Late => it.over_time,
        Trouble::Bad(why) => why,
    }
}

fn cells(recorded: &Totals, new: &Totals) -> Vec<Cell> {
    let count = |of: fn(&Totals) -> u64| Cell { was: of(recorded).to_string(), is: of(new).to_string() };
    let time = |side: &Totals| side.to_root_s.map_or("\u{2013}".to_owned(), |s| format!("{s:.2} s"));
    vec![
        count(|it| it.alarms),
        count(|it| it.masked),
        count(|it| it.countermeasures),
        count(|it| it.transitions),
        Cell { was: time(recorded), is: time(new) },
    ]
}

/// Each name once, with how often it is there.
fn names(lang: Lang, all: &[Arc<str>]) -> String {
    let mut counts = BTreeMap::new();
    for (place, name) in all.iter().enumerate() {
        counts.entry(name).or_insert((place, 0_usize)).1 += 1;
    }
    let mut counts: Vec<_> = counts.into_iter().map(|(name, (place, count))| (place, name, count)).collect();
    counts.sort_unstable();
    let named = counts.iter().take(NAMED).map(|(_, name, count)| match count {
        1 => clean(name, 2 * NAME),
        _ => format!("{count} × {}", clean(name, 2 * NAME)),
    });
    let more = (counts.len() > NAMED).then(|| lang.and_more(counts.len() - NAMED));
    named.chain(more).collect::<Vec<_>>().join(", ")
}

fn first_of(lang: Lang, comparison: &Comparison, Parting { at, of }: &Parting) -> First {
    let it = IncidentWords::of(lang);
    let ms = ms(comparison, *at);
    let listed =
        |all: &[String]| if all.is_empty() { it.nothing.to_owned() } else { clean(&all.join(", "), MESSAGE) };
    let alarms = |all: &[Arc<str>]| if all.is_empty() { it.nothing.to_owned() } else { names(lang, all) };
    let (what, was, is) = match of {
        PartingOf::Node { node, recorded, new } => {
            (clean(node, 2 * NAME), shown(lang, recorded.as_ref()), shown(lang, new.as_ref()))
        }
        PartingOf::Stage { recorded, new } => {
            (it.stage.to_owned(), stage_word(lang, recorded).to_owned(), stage_word(lang, new).to_owned())
        }
        PartingOf::Requests { recorded, new } => (it.requests.to_owned(), listed(recorded), listed(new)),
        PartingOf::Instruction { recorded, new } => {
            let word = |urgency: &Option<&'static str>| urgency.unwrap_or(it.nothing).to_owned();
            (it.instruction.to_owned(), word(recorded), word(new))
        }
        PartingOf::Alarms { recorded, new } => (it.alarms.to_owned(), alarms(recorded), alarms(new)),
    };
    let wall = crate::incidents::wall_time(ms);
    First {
        at_ms: ms,
        after: lang.decimals(&format!("{:.3} s", seconds(comparison.facts.from, *at))),
        clock: wall.get(11..23).unwrap_or_default().to_owned(),
        what,
        was,
        is,
    }
}

/// The state of a node, in words.
fn shown(lang: Lang, shown: Option<&Shown>) -> String {
    let it = IncidentWords::of(lang);
    let Some(Shown { state, own, cause }) = shown else { return it.not_there.to_owned() };
    let word = lang.state(*state);
    match cause {
        Some(cause) => format!("{word} {} {}", it.because_of, clean(cause, 2 * NAME)),
        None if own != state => format!("{word} ({} {})", it.own, lang.state(*own)),
        None => word.to_owned(),
    }
}

/// The wall time of an instant.
fn ms(comparison: &Comparison, at: Timestamp) -> i64 {
    unix_ms(comparison.facts.wall(at))
}

/// A node with both its strips.
pub struct Pair {
    pub name: String,
    pub why: String,
    pub was: String,
    pub is: String,
}

/// The strips of one incident.
pub struct Strips {
    pub id: u64,
    pub patterns: String,
    pub pairs: Vec<Pair>,
    /// Nodes whose strips would look the same.
    pub alike: String,
    pub more: usize,
    /// A line where both part.
    pub parting: String,
    pub ticks: Vec<Tick>,
    pub only_recorded: String,
    pub only_new: String,
    pub notes: Vec<String>,
}

impl Strips {
    /// `None` where there is nothing to show.
    pub fn of(lang: Lang, words: &'static DevWords, compared: &Compared) -> Option<Strips> {
        let comparison = compared.result.as_ref().ok()?;
        let from = stamp(ms(comparison, comparison.facts.from));
        let axis = Axis { from, to: stamp(ms(comparison, comparison.to)), left: 0.0, width: 100.0 };
        let painter = Painter { lang, words, axis };
        let pair = |it: &NodeDifference| Pair {
            name: clean(&it.node, 2 * NAME),
            why: why_address(&it.node),
            was: bars(&painter, comparison, &it.recorded),
            is: bars(&painter, comparison, &it.new),
        };
        let parting = comparison.first.as_ref().map(|first| axis.x(stamp(ms(comparison, first.at))));
        let line =
            |x: f64| format!("<line class=\"moment\" x1=\"{x:.2}%\" x2=\"{x:.2}%\" y1=\"0\" y2=\"24\"/>");
        let (seen, alike): (Vec<_>, Vec<_>) = comparison.nodes.iter().partition(|it| it.is_seen);
        let pairs: Vec<Pair> = seen.iter().take(NODES).map(|it| pair(it)).collect();
        let alike: Vec<Arc<str>> = alike.iter().map(|it| it.node.clone()).collect();
        Some(Strips {
            id: compared.incident,
            patterns: patterns("p-", |paint| format!("class=\"p-{paint}\"")),
            more: seen.len() - pairs.len() + comparison.more_nodes,
            alike: names(lang, &alike),
            parting: parting.map(line).unwrap_or_default(),
            ticks: if pairs.is_empty() { Vec::new() } else { ticks(axis) },
            only_recorded: names(lang, &comparison.only_recorded),
            only_new: names(lang, &comparison.only_new),
            notes: comparison.notes.iter().take(NAMED).map(|note| clean(note, 4 * MESSAGE)).collect(),
            pairs,
        })
    }
}

fn bars(painter: &Painter, comparison: &Comparison, changes: &[(Timestamp, Option<Shown>)]) -> String {
    let ends = changes.iter().skip(1).map(|(at, _)| *at).chain([comparison.to]);
    let stretch = |((from, shown), to): (&(Timestamp, Option<Shown>), Timestamp)| {
        let Shown { state, own, cause } = shown.as_ref()?;
        Some(Stretch {
            from_ms: ms(comparison, *from),
            to_ms: ms(comparison, to),
            state: *state,
            own: *own,
            cause: cause.clone(),
            said: None,
        })
    };
    let stretches: Vec<Stretch> = changes.iter().zip(ends).filter_map(stretch).collect();
    recorded(&stretches).iter().map(|segment| painter.segment(segment)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_name_is_said_once_with_how_often_it_is_there() {
        let all = ["b", "a", "b", "b"].map(Arc::from);
        assert_eq!(names(Lang::En, &all), "3 × b, a");
    }
}
