//! Compares what a rule showed during a trial with the truth.

use std::collections::BTreeSet;

use telltale_engine::model::countermeasure::Request;
use telltale_engine::model::{NodeId, Within};
use telltale_engine::snapshot::Snapshot;
use telltale_engine::state::State;

use super::figures::Figures;
use super::rules::Said;
use super::track::Track;
use super::truth::Present;

/// Of what a rule said, without what only an engine shows.
pub fn judge(present: &[Present], said: &[Said], grouped: Option<&Snapshot>) -> Figures {
    let mut figures = Figures { faults: present.len() as u64, ..Figures::default() };
    let names: Vec<BTreeSet<NodeId>> = present.iter().map(|fault| names(fault, grouped)).collect();
    let at = |ms: u64| &said[said.partition_point(|it| it.ms <= ms).max(1) - 1];
    if let (Some(first), Some(last)) = (said.first(), said.last()) {
        figures.alarms = last.alarms - first.alarms;
    }
    if let Some(end) = present.iter().map(|fault| fault.ends_ms).min() {
        let shown = &at(end.saturating_sub(10)).causes;
        let there: Vec<&BTreeSet<NodeId>> = present
            .iter()
            .zip(&names)
            .filter(|(fault, _)| fault.noticed_ms < end)
            .map(|(_, it)| it)
            .collect();
        let is_right = |node: &NodeId| there.iter().any(|names| names.contains(node));
        figures.there = there.len() as u64;
        figures.found =
            there.iter().filter(|names| shown.iter().any(|node| names.contains(node))).count() as u64;
        figures.causes = shown.len() as u64;
        figures.causes_right = shown.iter().filter(|node| is_right(node)).count() as u64;
        if !there.is_empty() && !shown.is_empty() {
            figures.named = 1;
            figures.first_right = u64::from(is_right(&shown[0]));
            if let Some(place) = shown.iter().position(is_right) {
                figures.ranked = 1;
                figures.ranks = place as u64 + 1;
            }
        }
    }
    for (index, fault) in present.iter().enumerate() {
        let names = &names[index];
        let named = said
            .iter()
            .find(|it| it.ms >= fault.begins_ms && it.causes.iter().any(|node| names.contains(node)));
        match named {
            Some(named) => figures.time_to_cause_ms.push(named.ms - fault.begins_ms),
            None => figures.never_named += 1,
        }
        let hides = |it: &Said| !it.causes.iter().chain(&it.faulty).any(|node| names.contains(node));
        let hidden_ms = lasting(fault, said.iter().map(|it| it.ms), |ms| hides(at(ms)));
        figures.hidden_ms += hidden_ms;
        figures.hidden += u64::from(hidden_ms > 0);
        let Within::Limit(within) = Within::default() else { continue };
        let is_near = |other: &Present| {
            let near = |ms: &u64| fault.beginnings_ms.iter().any(|it| it.abs_diff(*ms) <= within.as_millis());
            other.beginnings_ms.iter().any(near)
        };
        let is_explained = present.iter().enumerate().any(|(other, it)| other != index && is_near(it));
        figures.hidden_beyond_within += u64::from(hidden_ms > 0 && !is_explained);
    }
    figures
}

/// What an engine showed wrongly. `off` masks nothing.
pub fn judge_engine(present: &[Present], track: &Track, off: &Track, figures: &mut Figures) {
    let changes = || [track, off].into_iter().flat_map(|it| it.0.iter().map(|(ms, _)| *ms));
    let weaker = |ms: u64| strength(track.at(ms)) < strength(off.at(ms));
    figures.wrong_reactions = u64::from(changes().any(weaker));
    for fault in present {
        let green = |ms: u64| is_green(track.at(ms), fault);
        figures.wrong_greens += u64::from(lasting(fault, changes(), green) > 0);
        let soft = |ms: u64| {
            let snapshot = track.at(ms);
            let needs = fault.modules.iter().filter_map(|id| snapshot.asks(NodeId::Module(*id))).max();
            snapshot.drives() && snapshot.asked.map(|it| it.urgency) < needs
        };
        figures.wrong_instructions += u64::from(lasting(fault, changes(), soft) > 0);
    }
}

/// How long something holds while a fault is reported, in milliseconds. It may change at these times.
fn lasting(fault: &Present, changes: impl Iterator<Item = u64>, holds: impl Fn(u64) -> bool) -> u64 {
    let mut times: Vec<u64> =
        changes.chain(fault.distinct.iter().flat_map(|(from, to)| [*from, *to])).collect();
    times.sort_unstable();
    times.dedup();
    let spans = times.windows(2).filter(|span| fault.is_distinct(span[0]) && holds(span[0]));
    spans.map(|span| span[1] - span[0]).sum()
}

/// The nodes that name a fault: its modules, and for a rule of whole groups their top groups.
fn names(fault: &Present, grouped: Option<&Snapshot>) -> BTreeSet<NodeId> {
    let modules = fault.modules.iter().map(|id| NodeId::Module(*id));
    match grouped {
        Some(snapshot) => modules.map(|node| NodeId::Group(snapshot.layout.outermost(node))).collect(),
        None => modules.collect(),
    }
}

/// Whether the vehicle or the tile of the fault is OK on the display while one of its modules is not.
fn is_green(snapshot: &Snapshot, fault: &Present) -> bool {
    let bad = fault.modules.iter().filter(|id| super::truth::is_bad(snapshot.own(NodeId::Module(**id))));
    let mut tiles = bad.map(|id| snapshot.layout.outermost(NodeId::Module(*id)));
    tiles.any(|tile| snapshot.overall == State::Ok || snapshot.group(tile).1.state == State::Ok)
}

/// How strongly the vehicle is asked to slow down.
fn strength(snapshot: &Snapshot) -> (u8, u64) {
    let of = |request: Request| match request {
        Request::Notify => (0, 0),
        Request::ManeuverStop => (1, 0),
        Request::Decelerate { mps2 } => (2, (mps2 * 1000.0) as u64),
    };
    snapshot.countermeasures.iter().map(|it| of(it.request)).max().unwrap_or((0, 0))
}
