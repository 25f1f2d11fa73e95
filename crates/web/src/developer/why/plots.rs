//! The numbers of a module over the last minutes or over days, with those of a second one: as pictures, and as points for
//! the page's script.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use crate::developer::incidents::plots::{Plot, drawn_within};
use crate::developer::page_query::is_clean;
use crate::texts::{NAME, clean};
use crate::view::Trends;
use crate::view::trends::exactly;
use telltale_clock::unix_ms;
use telltale_clock::wall_at;
use telltale_engine::model::{ModuleId, NodeId};
use telltale_engine::snapshot::{Report, Snapshot};
use telltale_record::story::{Limit, Series};
use telltale_runtime::Published;
use telltale_store::{Resolution, Trend, TrendPoint};

/// A longer span is drawn in minutes, and one beyond a day in hours.
const SAMPLES_UP_TO_MS: i64 = 600_000;
const MINUTES_UP_TO_MS: i64 = 24 * 3_600_000;

/// Numbers that are offered to be drawn into the plots.
const OFFERED: usize = 500;

/// A number of another module, or another one of the same.
pub struct Second {
    pub node: ModuleId,
    pub key: Box<str>,
}

/// It as it is drawn.
pub struct SecondPlot {
    pub name: String,
    pub range: String,
    pub numbers: String,
    /// It is drawn in the scale of the first one: both have the same key and unit.
    pub same_scale: bool,
}

pub struct NumberPlot {
    pub plot: Plot,
    /// For the script: JSON of `[name, value]` of each limit, and of the numbers, `null` in a gap.
    pub limits: String,
    pub numbers: String,
    /// The least and the greatest numbers of minutes or hours; empty of instants.
    pub least: String,
    pub most: String,
    pub second: Option<SecondPlot>,
}

#[derive(Default)]
pub struct Plots {
    /// JSON of the milliseconds of all points.
    pub times: String,
    pub plots: Vec<NumberPlot>,
}

impl Second {
    /// The number of `group/module key`, or the first one of `group/module`.
    pub fn find(snapshot: &Snapshot, written: &str) -> Option<Second> {
        snapshot.module_ids().find_map(|node| {
            let (info, module) = snapshot.module(node);
            let key = written.strip_prefix(&*info.id)?;
            let mut keys = numbers_of(&module.report);
            let key =
                if key.is_empty() { keys.next() } else { keys.find(|it| key.strip_prefix(' ') == Some(it)) };
            Some(Second { node, key: key?.into() })
        })
    }

    /// The numbers that can be named, as far as there is room in a page.
    pub fn offered(snapshot: &Snapshot) -> Vec<String> {
        let modules = snapshot.module_ids().map(|node| snapshot.module(node));
        let names = modules
            .flat_map(|(info, module)| numbers_of(&module.report).map(|key| format!("{} {key}", info.id)));
        names.filter(|name| is_clean(name)).take(OFFERED).collect()
    }

    fn series(&self, snapshot: &Snapshot, points: Vec<(i64, Option<f64>)>) -> Series {
        let node = snapshot.module(self.node).0.id.to_string();
        Series { node, key: self.key.to_string(), points, limits: Vec::new() }
    }
}

/// The keys of the numbers that are no limits.
fn numbers_of(report: &Report) -> impl Iterator<Item = &str> {
    let is_number = |text: &str| text.trim().parse().is_ok_and(|number: f64| number.is_finite());
    let numbers = report.values.iter().filter(move |(key, text)| !Limit::is_name(key) && is_number(text));
    numbers.map(|(key, _)| &**key)
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
pub fn plots(
    published: &Published,
    node: NodeId,
    second: Option<&Second>,
    trends: &Trends,
    span: (i64, i64),
) -> Plots {
    let NodeId::Module(id) = node else { return Plots::default() };
    let snapshot = &published.snapshot;
    let (info, _) = snapshot.module(id);
    let (sampled, values) = trends.numbers(id.0 as usize, &info.id);
    let times: Vec<i64> =
        sampled.iter().map(|&at| unix_ms(wall_at(published.at, snapshot.now, at))).collect();
    let first = times.partition_point(|&at| at < span.0);
    let times = times.get(first..).unwrap_or_default();
    let mut all: Vec<Series> = Vec::new();
    for (key, numbers) in values.iter().filter(|(key, _)| !Limit::is_name(key)) {
        let points = times.iter().copied().zip(numbers.iter().skip(first).copied()).collect();
        all.push(Series { node: info.id.to_string(), key: key.clone(), points, limits: Vec::new() });
    }
    add_limits(published, node, &mut all);
    all.retain(|series| series.points.iter().any(|(_, number)| number.is_some()));
    let second = second.map(|second| {
        let (at, values) = trends.numbers(second.node.0 as usize, &snapshot.module(second.node).0.id);
        let numbers = values.into_iter().find(|(key, _)| **key == *second.key).map(|(_, numbers)| numbers);
        let number = |time| at.binary_search(time).ok().and_then(|index| *numbers.as_ref()?.get(index)?);
        let points = times.iter().zip(&sampled[first..]).map(|(&ms, time)| (ms, number(time)));
        (second.node, second.series(snapshot, points.collect()))
    });
    let plots = all.iter().map(|series| plot((published, node), series, &[], second.as_ref(), span));
    Plots { plots: plots.collect(), times: json(times.iter().map(|&at| Some(at as f64))) }
}

/// The same of minutes or hours.
pub fn plots_of(
    published: &Published,
    node: NodeId,
    second: Option<(&Second, &Trend)>,
    trend: &Trend,
    resolution: Resolution,
    span: (i64, i64),
) -> Plots {
    // One axis for all. A gap is longer than its neighbours are apart, so a time without a number stands in it.
    let also = second.and_then(|(it, trend)| trend.values.iter().find(|value| *value.key == *it.key));
    let values = trend.values.iter().chain(also);
    let known = values.flat_map(|value| value.points.iter().map(|point| point.at_ms));
    let known: BTreeSet<i64> = known.collect();
    let after = known.iter().map(|at_ms| at_ms + resolution.span_ms());
    let times: BTreeSet<i64> = known.iter().copied().chain(after).filter(|&at_ms| at_ms <= span.1).collect();
    let mut all: Vec<(Series, Vec<Option<TrendPoint>>)> = Vec::new();
    let at = |points: &[TrendPoint], at_ms: i64| {
        let found = points.binary_search_by_key(&at_ms, |point| point.at_ms);
        found.ok().map(|index| points[index])
    };
    for value in &trend.values {
        let found: Vec<Option<TrendPoint>> = times.iter().map(|&ms| at(&value.points, ms)).collect();
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
    let second = second.zip(also).map(|((it, _), value)| {
        let points = times.iter().map(|&ms| (ms, at(&value.points, ms).map(|point| exactly(point.mean))));
        (it.node, it.series(&published.snapshot, points.collect()))
    });
    let plots = series.iter().zip(&found).map(|(series, found)| {
        let least = || found.iter().map(|point| point.map(|it| exactly(it.least)));
        let most = || found.iter().map(|point| point.map(|it| exactly(it.most)));
        let band: Vec<Option<(f64, f64)>> =
            least().zip(most()).map(|(least, most)| least.zip(most)).collect();
        let plot = plot((published, node), series, &band, second.as_ref(), span);
        NumberPlot { least: json(least()), most: json(most()), ..plot }
    });
    Plots { plots: plots.collect(), times: json(times.iter().map(|&at| Some(at as f64))) }
}

/// A number within its band, and the second one in the same picture.
fn plot(
    (published, node): (&Published, NodeId),
    series: &Series,
    band: &[Option<(f64, f64)>],
    second: Option<&(ModuleId, Series)>,
    span: (i64, i64),
) -> NumberPlot {
    let second = second.filter(|(_, it)| it.points.iter().any(|(_, number)| number.is_some()));
    let quantity = |id: ModuleId| published.snapshot.module(id).0.quantity.as_ref();
    let is_same = |(id, it): &(ModuleId, Series)| match node {
        NodeId::Module(of) => it.key == series.key && quantity(*id) == quantity(of),
        NodeId::Group(_) => false,
    };
    let same_scale = second.is_some_and(is_same);
    let known =
        |series: &Series| series.points.iter().filter_map(|(_, number)| *number).collect::<Vec<f64>>();
    let mut own = known(series);
    own.extend(band.iter().flatten().flat_map(|&(least, most)| [least, most]));
    own.extend(series.limits.iter().map(|limit| limit.value));
    let others = second.filter(|_| same_scale).map(|(_, it)| known(it)).unwrap_or_default();
    let mut plot = drawn_within(&series.key, series, band, &others, span);
    let second = second.map(|(_, it)| {
        let name = format!("{} {}", it.node, it.key);
        let also = if same_scale { &*own } else { &[] };
        let drawn = drawn_within(&name, it, &[], also, span);
        // Writing to a string cannot fail.
        let _ = write!(plot.lines, "<g class=\"second\">{}</g>", drawn.lines);
        let numbers = json(it.points.iter().map(|(_, number)| *number));
        SecondPlot { name: clean(&name, 2 * NAME), range: drawn.range, numbers, same_scale }
    });
    NumberPlot {
        plot,
        limits: limits(series),
        numbers: json(series.points.iter().map(|(_, number)| *number)),
        least: String::new(),
        most: String::new(),
        second,
    }
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
