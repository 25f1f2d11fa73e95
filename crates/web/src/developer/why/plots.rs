//! The numbers of a module over the last minutes: as pictures, and as points for the page's script.

use std::fmt::Write as _;

use crate::developer::incidents::plots::{Plot, drawn};
use crate::view::Trends;
use telltale_clock::wall_at;
use telltale_engine::model::NodeId;
use telltale_record::story::{Limit, Series};
use telltale_record::writer::unix_ms;
use telltale_runtime::Published;

pub struct NumberPlot {
    pub plot: Plot,
    /// For the script: JSON of `[name, value]` of each limit, and of the numbers, `null` in a gap.
    pub limits: String,
    pub numbers: String,
}

#[derive(Default)]
pub struct Plots {
    /// JSON of the milliseconds of all points.
    pub times: String,
    pub plots: Vec<NumberPlot>,
}

/// The numbers of a module in a span of time, in milliseconds since 1970.
pub fn plots(published: &Published, node: NodeId, trends: &Trends, span: (i64, i64)) -> Plots {
    let NodeId::Module(id) = node else { return Plots::default() };
    let snapshot = &published.snapshot;
    let (info, view) = snapshot.module(id);
    let (times, values) = trends.numbers(id.0 as usize, &info.id);
    let times: Vec<i64> = times.iter().map(|&at| unix_ms(wall_at(published.at, snapshot.now, at))).collect();
    let first = times.partition_point(|&at| at < span.0);
    let times = times.get(first..).unwrap_or_default();
    let mut all: Vec<Series> = Vec::new();
    for (key, numbers) in values.iter().filter(|(key, _)| !Limit::is_name(key)) {
        let points = times.iter().copied().zip(numbers.iter().skip(first).copied()).collect();
        all.push(Series { node: info.id.to_string(), key: key.clone(), points, limits: Vec::new() });
    }
    for (measured, limit) in Limit::reported(&view.report.values) {
        if let Some(series) = all.iter_mut().find(|series| series.key == measured) {
            series.limits.push(limit);
        }
    }
    all.retain(|series| series.points.iter().any(|(_, number)| number.is_some()));
    let plots = all.iter().map(|series| NumberPlot {
        plot: drawn(&series.key, series, span),
        limits: serde_json::to_string(&series.limits).unwrap_or_default(),
        numbers: json(series.points.iter().map(|(_, number)| *number)),
    });
    Plots { plots: plots.collect(), times: json(times.iter().map(|&at| Some(at as f64))) }
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
