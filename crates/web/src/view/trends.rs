//! Samples of every number in the statuses, and their curves.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::sync::{Arc, Mutex, PoisonError};

use telltale_engine::snapshot::{Layout, Report};
use telltale_engine::time::{Span, Timestamp};
use telltale_runtime::Published;

/// One sample of every value in this time.
pub const SAMPLE_EVERY: Span = Span::from_secs(2);
/// Samples of one value that are kept: five minutes.
const SAMPLES: usize = 150;
/// A past that is shorter is drawn as if it were this long: a minute.
const SAMPLES_DRAWN: usize = 30;
/// Values of one module that are followed.
const VALUES: usize = 16;
/// Values of all modules that are followed; those that come later have no past.
const SERIES: usize = 20_000;
/// A value with a longer key is not followed: 20,000 keys take 5 MB at most.
const KEY_BYTES: usize = 256;

/// Points of a line as wide as a word.
pub const POINTS_SMALL: usize = 36;

/// Drawn into this box.
const WIDTH: f32 = 100.0;
const HEIGHT: f32 = 20.0;

/// The recent past of all numbers. Bounded: 20,000 values with 150 samples each.
#[derive(Debug, Default)]
pub struct Trends(Mutex<Sampled>);

#[derive(Debug, Default)]
struct Sampled {
    rewinds: u64,
    /// When each sample was taken, oldest first; the newest sample of every value is of the last of them.
    times: VecDeque<Timestamp>,
    layout: Option<Arc<Layout>>,
    /// By `ModuleId` of `layout`.
    modules: Vec<ModuleTrends>,
    series: usize,
}

#[derive(Debug, Default)]
struct ModuleTrends {
    report: Option<Arc<Report>>,
    values: Vec<(Box<str>, VecDeque<f32>)>,
}

/// One value over time as a line, with its least and greatest value.
#[derive(Debug, Clone, PartialEq)]
pub struct Trend {
    pub key: String,
    /// `d` of a path in a box of 100 x 20.
    pub line: String,
    pub least: f32,
    pub most: f32,
}

impl Trends {
    /// Takes a sample, if the last one is old enough. After a step back in time the past begins anew.
    pub fn sample(&self, published: &Published) {
        let snapshot = &published.snapshot;
        let mut inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if inner.rewinds != published.rewinds {
            *inner = Sampled { rewinds: published.rewinds, ..Sampled::default() };
        }
        if inner.times.back().is_some_and(|&last| snapshot.now.since(last) < SAMPLE_EVERY) {
            return;
        }
        push(&mut inner.times, snapshot.now);
        inner.follow(&snapshot.layout);
        let Sampled { modules, series, .. } = &mut *inner;
        for (module, view) in modules.iter_mut().zip(snapshot.modules.iter()) {
            let same = module.report.as_ref().is_some_and(|report| Arc::ptr_eq(report, &view.report));
            if same || view.silent {
                module.go_on(view.silent);
            } else {
                module.take(&view.report, series);
            }
        }
    }

    /// The values of a module that are numbers and have a past, in lines of so many points.
    pub fn of(&self, module: usize, id: &str, points: usize) -> Vec<Trend> {
        let inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let values = inner.values(module, id).iter();
        values.filter_map(|(key, samples)| draw(key, samples, points)).collect()
    }

    /// When samples were taken, and the values of a module at these times: nothing where it had none.
    pub fn numbers(&self, module: usize, id: &str) -> (Vec<Timestamp>, Vec<(String, Numbers)>) {
        let inner = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let numbers = |samples: &VecDeque<f32>| {
            let before = std::iter::repeat_n(None, inner.times.len().saturating_sub(samples.len()));
            before.chain(samples.iter().map(|&it| (!it.is_nan()).then_some(exactly(it)))).collect()
        };
        let values = inner.values(module, id).iter();
        let values = values.map(|(key, samples)| (key.to_string(), numbers(samples))).collect();
        (inner.times.iter().copied().collect(), values)
    }
}

/// One value at the times of all samples.
pub type Numbers = Vec<Option<f64>>;

/// The decimal number that was reported, not the binary one that is nearest to it.
pub fn exactly(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

impl Sampled {
    /// The values of a module; none if it is another one than `id`.
    fn values(&self, module: usize, id: &str) -> &[(Box<str>, VecDeque<f32>)] {
        let named = |layout: &Arc<Layout>| layout.modules.get(module).is_some_and(|info| *info.id == *id);
        if self.layout.as_ref().is_some_and(named) { &self.modules[module].values } else { &[] }
    }

    /// With a new layout, each module keeps its samples by its name.
    fn follow(&mut self, layout: &Arc<Layout>) {
        let before = self.layout.replace(layout.clone());
        if before.as_ref().is_some_and(|before| Arc::ptr_eq(before, layout)) {
            return;
        }
        self.modules = layout.rearranged(before.as_deref(), std::mem::take(&mut self.modules));
        self.series = self.modules.iter().map(|module| module.values.len()).sum();
    }
}

impl ModuleTrends {
    fn take(&mut self, report: &Arc<Report>, series: &mut usize) {
        self.report = Some(report.clone());
        let numbers = report.numbers().filter(|(key, _)| key.len() <= KEY_BYTES);
        let numbers: Vec<(&str, f32)> = numbers.take(VALUES).collect();
        for (key, samples) in &mut self.values {
            let now = numbers.iter().find(|(name, _)| *name == &**key).map_or(f32::NAN, |&(_, value)| value);
            push(samples, now);
        }
        for (key, value) in numbers {
            let known = self.values.iter().any(|(name, _)| **name == *key);
            if !known && self.values.len() < VALUES && *series < SERIES {
                self.values.push((key.into(), VecDeque::from([value])));
                *series += 1;
            }
        }
    }

    /// Repeats the last values; a silent module gets a gap.
    fn go_on(&mut self, silent: bool) {
        for (_, samples) in &mut self.values {
            let last = samples.back().copied().unwrap_or(f32::NAN);
            push(samples, if silent { f32::NAN } else { last });
        }
        if silent {
            self.report = None;
        }
    }
}

fn push<T>(samples: &mut VecDeque<T>, value: T) {
    if samples.len() == SAMPLES {
        samples.pop_front();
    }
    samples.push_back(value);
}

/// Nothing, where there are not two samples to join.
fn draw(key: &str, samples: &VecDeque<f32>, points: usize) -> Option<Trend> {
    let known = || samples.iter().copied().filter(|value| !value.is_nan());
    if known().count() < 2 {
        return None;
    }
    let (least, most) = (known().fold(f32::INFINITY, f32::min), known().fold(f32::NEG_INFINITY, f32::max));
    let range = most - least;
    // The present is at the right end, however short the past is.
    let width = samples.len().max(SAMPLES_DRAWN);
    let first = width - samples.len();
    let (mut line, mut pen_down) = (String::new(), false);
    // The newest is always among those that are drawn.
    let step = samples.len().div_ceil(points.max(1)).max(1);
    let drawn =
        samples.iter().enumerate().filter(|(index, _)| (samples.len() - 1 - index).is_multiple_of(step));
    for (index, value) in drawn {
        if value.is_nan() {
            pen_down = false;
            continue;
        }
        let x = (first + index) as f32 * WIDTH / (width - 1) as f32;
        let share = if range > 0.0 && range.is_finite() { (value - least) / range } else { 0.5 };
        let y = HEIGHT - 1.0 - share * (HEIGHT - 2.0);
        let _ = write!(line, "{}{x:.1} {y:.1}", if pen_down { "L" } else { "M" });
        pen_down = true;
    }
    Some(Trend { key: key.to_owned(), line, least, most })
}

#[cfg(test)]
mod tests {
    use std::time::SystemTime;

    use super::*;
    use crate::view::tests::sample::Sample;

    fn recorded(sample: &mut Sample) -> Published {
        Published::recorded(sample.snapshot(), SystemTime::UNIX_EPOCH)
    }

    #[test]
    fn a_number_gets_a_past_and_silence_a_gap() {
        let trends = Trends::default();
        let mut sample = Sample::shuttle(true);
        let long = "k".repeat(KEY_BYTES + 1);
        for value in ["1.0", "3.0", "2.0"] {
            sample = sample
                .report("can/battery", 0, "fine", &[(&long, "1"), ("v", value), ("word", "high")])
                .pass(2);
            trends.sample(&recorded(&mut sample));
            trends.sample(&recorded(&mut sample));
        }
        let snapshot = sample.snapshot();
        let index = snapshot.layout.modules.iter().position(|info| &*info.id == "can/battery").unwrap();
        let of = trends.of(index, "can/battery", SAMPLES);
        let [trend] = &*of else { panic!("{of:?}") };
        assert_eq!((&*trend.key, trend.least, trend.most), ("v", 1.0, 3.0));
        assert_eq!(trend.line, "M93.1 19.0L96.6 1.0L100.0 10.0");
        assert!(trends.of(index, "another", SAMPLES).is_empty());
        let (times, values) = trends.numbers(index, "can/battery");
        assert_eq!(times.len(), 3);
        assert_eq!(values, [("v".to_owned(), vec![Some(1.0), Some(3.0), Some(2.0)])]);

        let mut sample = sample.silence("can/battery").pass(8);
        trends.sample(&recorded(&mut sample));
        let trend = trends.of(index, "can/battery", SAMPLES).remove(0);
        assert_eq!(trend.line, "M89.7 19.0L93.1 1.0L96.6 10.0", "the present is unknown");
        let (times, values) = trends.numbers(index, "can/battery");
        assert_eq!((times.len(), &*values[0].1), (4, &[Some(1.0), Some(3.0), Some(2.0), None][..]));

        // A value that comes later had nothing before.
        let mut sample = sample.report("can/battery", 0, "fine", &[("v", "4"), ("w", "0.1")]).pass(2);
        trends.sample(&recorded(&mut sample));
        let (_, values) = trends.numbers(index, "can/battery");
        assert_eq!(values[1], ("w".to_owned(), vec![None, None, None, None, Some(0.1)]));
    }
}
