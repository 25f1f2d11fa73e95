//! The numbers of a module over the last minutes or over days: as pictures, and as points for the page's script.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use crate::developer::incidents::plots::{Plot, drawn, drawn_within};
use crate::view::Trends;
use crate::view::trends::exactly;
use telltale_clock::wall_at;
use telltale_engine::model::NodeId;
use telltale_record::story::{Limit, Series};
use telltale_record::writer::unix_ms;
use telltale_runtime::Published;
use telltale_store::{Resolution, Trend, TrendPoint};

/// A longer span is drawn in minutes, and one beyond a day in hours.
const SAMPLES_UP_TO_MS: i64 = 600_000;
const MINUTES_UP_TO_MS: i64 = 24 * 3_600_000;

pub struct NumberPlot {
    pub plot: Plot,
    /// For the script: JSON of `[name, value]` of each limit, and of the numbers, `null` in a gap.
    pub limits: String,
    pub numbers: String,
    /// The least and the greatest numbers of minutes or hours; empty of instants.
    pub least: String,
    pub most: String,
}

#[derive(Default)]
pub struct Plots {
    /// JSON of the milliseconds of all points.
    pub times: String,
    pub plots: Vec<NumberPlot>,
}

/// The source of the numbers of a span of time; `None`: the samples of the last minutes.
pub fn resolution((from_ms, to_ms): (i64, i64), is_live: bool) -> Option<Resolution> {
    match to_ms - from_ms {
        span_ms if is_live && span_ms <= SAMPLES_UP_TO_MS => None,
        span_ms if span_ms <= MINUTES_UP_TO_MS => Some(Resolution::Minute),
        _ => Some(Resolution::Hour),
    }
}

/// The numbers of a module in a span of time, in milliseconds since 1970.
pub fn plots(published: &Published, node: NodeId, trends: &Trends, span: (i64, i64)) -> Plots {
    let NodeId::Module(id) = node else { return Plots::default() };
    let snapshot = &published.snapshot;
    let (info, _) = snapshot.module(id);
    let (times, values) = trends.numbers(id.0 as usize, &info.id);
    let times: Vec<i64> = times.iter().map(|&at| unix_ms(wall_at(published.at, snapshot.now, at))).collect();
    let first = times.partition_point(|&at| at < span.0);
    let times = times.get(first..).unwrap_or_default();
    let mut all: Vec<Series> = Vec::new();
    for (key, numbers) in values.iter().filter(|(key, _)| !Limit::is_name(key)) {
        let points = times.iter().copied().zip(numbers.iter().skip(first).copied()).collect();
        all.push(Series { node: info.id.to_string(), key: key.clone(), points, limits: Vec::new() });
    }
    add_limits(published, node, &mut all);
    all.retain(|series| series.points.iter().any(|(_, number)| number.is_some()));
    let plots = all.iter().map(|series| NumberPlot {
        plot: drawn(&series.key, series, span),
        limits: limits(series),
        numbers: json(series.points.iter().map(|(_, number)| *number)),
        least: String::new(),
        most: String::new(),
    });
    Plots { plots: plots.collect(), times: json(times.iter().map(|&at| Some(at as f64))) }
}

/// The same of minutes or hours.
pub fn plots_of(
    published: &Published,
    node: NodeId,
    trend: &Trend,
    resolution: Resolution,
    span: (i64, i64),
) -> Plots {
    // One axis for all. A gap is longer than its neighbours are apart, so a time without a number stands in it.
    let known = trend.values.iter().flat_map(|value| value.points.iter().map(|point| point.at_ms));
    let known: BTreeSet<i64> = known.collect();
    let after = known.iter().map(|at_ms| at_ms + resolution.span_ms());
    let times: BTreeSet<i64> = known.iter().copied().chain(after).filter(|&at_ms| at_ms <= span.1).collect();
    let mut all: Vec<(Series, Vec<Option<TrendPoint>>)> = Vec::new();
    for value in &trend.values {
        let at = |&at_ms: &i64| {
            let found = value.points.binary_search_by_key(&at_ms, |point| point.at_ms);
            found.ok().map(|index| value.points[index])
        };
        let found: Vec<Option<TrendPoint>> = times.iter().map(at).collect();
        let points =
            times.iter().zip(&found).map(|(&at_ms, point)| (at_ms, point.map(|it| exactly(it.mean))));
        let series = Series {
            node: String::new(),
            key: value.key.clone(),
            points: points.collect(),
            limits: Vec::new(),
        };
        all.push((series, found));
    }
    let (mut series, found): (Vec<Series>, Vec<_>) = all.into_iter().unzip();
    add_limits(published, node, &mut series);
    let plots = series.iter().zip(&found).map(|(series, found)| {
        let least = || found.iter().map(|point| point.map(|it| exactly(it.least)));
        let most = || found.iter().map(|point| point.map(|it| exactly(it.most)));
        let band: Vec<Option<(f64, f64)>> =
            least().zip(most()).map(|(least, most)| least.zip(most)).collect();
        NumberPlot {
            plot: drawn_within(&series.key, series, &band, span),
            limits: limits(series),
            numbers: json(series.points.iter().map(|(_, number)| *number)),
            least: json(least()),
            most: json(most()),
        }
    });
    Plots { plots: plots.collect(), times: json(times.iter().map(|&at| Some(at as f64))) }
}

/// The limits that the module reports now.
fn add_limits(published: &Published, node: NodeId, all: &mut [Series]) {
    let NodeId::Module(id) = node else { return };
    for (measured, limit) in Limit::reported(&published.snapshot.module(id).1.report.values) {
        if let Some(series) = all.iter_mut().find(|series| series.key == measured) {
            series.limits.push(limit);
        }
    }
}

fn limits(series: &Series) -> String {
    serde_json::to_string(&series.limits).unwrap_or_default()
}

fn json(numbers: impl Iterator<Item = Option<f64>>) -> String {
    let mut out = String::from("[");
    for number in numbers {
        if out.len() > 1 {
            out.push(',');
        }
        // Writing to a string cannot fail.
        let _ = match number {
            Some(number) => write!(out, "{number}"),
            None => write!(out, "null"),
        };
    }
    out + "]"
}
