//! Numbers over time: the speed of the vehicle, and what the nodes of an incident reported, with their limits.

use super::{Playback, ReplayError};
use telltale_clock::unix_ms;
use telltale_engine::model::NodeId;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::time::Timestamp;
use telltale_record::story::{Limit, Series};

/// Instants, evenly from the first to the last one that is shown.
const POINTS: u64 = 400;
/// Numbers that are followed, and those of them that are told.
const FOLLOWED_MAX: usize = 64;
const TOLD_MAX: usize = 12;

/// The key of the vehicle's speed.
pub const SPEED: &str = "speed_kmh";

/// The speed of the vehicle and the numbers of these nodes over time. A number without a limit that never changes
/// says nothing and is left out.
///
/// # Errors
/// The vehicle took a configuration that this version cannot read.
pub fn series(playback: &mut Playback, nodes: &[&str]) -> Result<Vec<Series>, ReplayError> {
    let (from, to) = (playback.facts().from.as_nanos(), playback.to().as_nanos());
    let mut all: Vec<Series> = Vec::new();
    for point in 0..=POINTS {
        let span = u128::from(to.saturating_sub(from)) * u128::from(point) / u128::from(POINTS);
        let at = Timestamp::from_nanos(from + u64::try_from(span).unwrap_or(0));
        playback.go_to(at)?;
        let Some(snapshot) = playback.snapshot() else { continue };
        let at_ms = unix_ms(playback.facts().wall(at));
        follow(&mut all, ("", SPEED), (at_ms, snapshot.motion.speed_kmh.map(f64::from)));
        for node in nodes {
            follow_node(&mut all, node, &snapshot, at_ms);
        }
    }
    all.retain(says_something);
    // The vehicle first, then what has limits.
    all.sort_by_key(|series| (!series.node.is_empty(), series.limits.is_empty()));
    all.truncate(TOLD_MAX);
    Ok(all)
}

fn follow_node(all: &mut Vec<Series>, node: &str, snapshot: &Snapshot, at_ms: i64) {
    let Some(NodeId::Module(id)) = snapshot.node(node) else { return };
    let (_, view) = snapshot.module(id);
    if view.silent {
        return;
    }
    for (key, value) in view.report.values.iter().filter(|(key, _)| !Limit::is_name(key)) {
        let Some(value) = value.parse().ok().filter(|value: &f64| value.is_finite()) else { continue };
        follow(all, (node, key), (at_ms, Some(value)));
    }
    for (measured, limit) in Limit::reported(&view.report.values) {
        if let Some(series) = all.iter_mut().find(|it| it.node == *node && it.key == measured) {
            series.limits.retain(|known| known.name != limit.name);
            series.limits.push(limit);
        }
    }
}

fn follow(all: &mut Vec<Series>, (node, key): (&str, &str), point: (i64, Option<f64>)) {
    if let Some(series) = all.iter_mut().find(|series| series.node == node && series.key == key) {
        series.points.push(point);
    } else if all.len() < FOLLOWED_MAX {
        let (node, key) = (node.to_owned(), key.to_owned());
        all.push(Series { node, key, points: vec![point], limits: Vec::new() });
    }
}

fn says_something(series: &Series) -> bool {
    let mut numbers = series.points.iter().filter_map(|(_, value)| *value);
    let first = numbers.next();
    first.is_some() && (!series.limits.is_empty() || numbers.any(|number| Some(number) != first))
}
