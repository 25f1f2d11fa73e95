//! The states of the nodes concerned over time, and the stage.

use std::collections::BTreeSet;

use schemars::JsonSchema;
use serde::Serialize;

use super::{is_fault, is_module};
use crate::summary::{Summary, kind};
use crate::transition::{Change, Transition};
use telltale_engine::module::system::OTHER_GROUP;
use telltale_engine::state::State;

const STRIPS_MAX: usize = 40;
const SIGNALS_MAX: usize = 12;
/// Periods of the strips of all nodes together.
const PERIODS_MAX: usize = 4000;
/// Of one strip, also of the stage or a signal; no display has more columns.
const PERIODS_OF_ONE_MAX: usize = 1000;

/// The states of a node over time, or the values of a signal.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct NodeStrip {
    pub node: String,
    pub periods: Vec<Period>,
}

/// A state from one instant to another; of a stage, its word; of a signal `true`, `false` or `unknown`.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Period {
    pub from_ms: i64,
    pub to_ms: i64,
    pub state: String,
    #[serde(skip_serializing_if = "String::is_empty")]
    pub own: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub masked_by: Option<String>,
    #[serde(skip_serializing_if = "String::is_empty")]
    pub message: String,
}

/// The group `other`, which is UNKNOWN or IGNORE while it has no members and is no tile, has nothing to tell.
fn is_empty_other(node: &str, state: &str) -> bool {
    node == OTHER_GROUP && [State::Unknown, State::Ignore].iter().any(|it| it.as_str() == state)
}

/// The root causes, then other modules that failed, then the tiles that changed.
/// Also the number of periods that are left out.
pub fn strips(
    changes: &[Transition<'_>],
    summary: &Summary,
    (from_ms, to_ms): (i64, i64),
) -> (Vec<NodeStrip>, u64) {
    let mut order: Vec<&str> = summary.causes();
    order.extend(
        summary
            .triggers
            .iter()
            .filter(|it| matches!(&*it.kind, kind::ROOT | kind::OWN_ERROR))
            .map(|it| &*it.what),
    );
    let in_span = || changes.iter().filter(|change| (from_ms..=to_ms).contains(&change.at_ms));
    let shown = |change: &'_ Transition<'_>, is_wanted: fn(&str, &str) -> bool| match &change.change {
        Change::Shown { node, shown, .. } if is_wanted(node, shown) => Some(node.to_string()),
        _ => None,
    };
    let failed = in_span().filter_map(|it| shown(it, |node, state| is_module(node) && is_fault(state)));
    let tiles =
        in_span().filter_map(|it| shown(it, |node, state| !is_module(node) && !is_empty_other(node, state)));
    let others: Vec<String> = failed.chain(tiles).collect();
    order.extend(others.iter().map(String::as_str));
    let mut seen = BTreeSet::new();
    order.retain(|node| seen.insert(*node));
    order.truncate(STRIPS_MAX);
    let (mut room, mut left_out) = (PERIODS_MAX, 0);
    let strip = |node: &str| {
        let states = changes.iter().filter_map(|change| match &change.change {
            Change::Shown { node: of, shown, own, masked_by, message, .. } if of == node => Some(Period {
                from_ms: change.at_ms,
                to_ms,
                state: shown.to_string(),
                own: own.to_string(),
                masked_by: masked_by.as_ref().map(ToString::to_string),
                message: message.as_deref().unwrap_or_default().to_owned(),
            }),
            _ => None,
        });
        let (periods, more) = joined(states, (from_ms, to_ms), room.min(PERIODS_OF_ONE_MAX));
        room -= periods.len();
        left_out += more;
        NodeStrip { node: node.to_owned(), periods }
    };
    let strips = order.into_iter().map(strip).collect();
    (strips, left_out)
}

pub fn stages(changes: &[Transition<'_>], span: (i64, i64)) -> Vec<Period> {
    level(changes, span, |change| match change {
        Change::Stage { stage } => Some(stage),
        _ => None,
    })
}

/// Those that changed, in the order of their names.
pub fn signals(changes: &[Transition<'_>], span: (i64, i64)) -> Vec<NodeStrip> {
    let names: BTreeSet<&str> = changes
        .iter()
        .filter_map(|change| match &change.change {
            Change::Signal { signal, .. } => Some(&**signal),
            _ => None,
        })
        .collect();
    let strip = |name: &str| {
        let periods = level(changes, span, |change| match change {
            Change::Signal { signal, value } if signal == name => Some(match value {
                Some(true) => "true",
                Some(false) => "false",
                None => "unknown",
            }),
            _ => None,
        });
        NodeStrip { node: name.to_owned(), periods }
    };
    names.into_iter().map(strip).filter(|strip| strip.periods.len() > 1).take(SIGNALS_MAX).collect()
}

/// A state that holds until it changes.
fn level<'a>(
    changes: &'a [Transition<'_>],
    (from_ms, to_ms): (i64, i64),
    state: impl Fn(&'a Change<'_>) -> Option<&'a str>,
) -> Vec<Period> {
    let periods = changes.iter().filter_map(|change| {
        Some(Period {
            from_ms: change.at_ms,
            to_ms,
            state: state(&change.change)?.to_owned(),
            own: String::new(),
            masked_by: None,
            message: String::new(),
        })
    });
    joined(periods, (from_ms, to_ms), PERIODS_OF_ONE_MAX).0
}

/// Each period ends where the next begins; only what lies in the span is left. Also the number of those past `most`,
/// in whose place nothing is.
fn joined(
    periods: impl Iterator<Item = Period>,
    (from_ms, to_ms): (i64, i64),
    most: usize,
) -> (Vec<Period>, u64) {
    let mut joined: Vec<Period> = Vec::new();
    let mut left_out = 0;
    for period in periods.filter(|period| period.from_ms <= to_ms) {
        if left_out == 0
            && let Some(last) = joined.last_mut()
        {
            last.to_ms = period.from_ms;
            if last.to_ms <= last.from_ms.max(from_ms) {
                joined.pop();
            }
        }
        if left_out == 0 && joined.len() < most {
            joined.push(period);
        } else {
            left_out += 1;
        }
    }
    for period in &mut joined {
        period.from_ms = period.from_ms.max(from_ms);
    }
    (joined, left_out)
}
