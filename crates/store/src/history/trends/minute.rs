//! Sums up the numbers of all modules until a minute of the wall clock is over.

use std::sync::Arc;
use std::time::SystemTime;

use super::MINUTE_MS;
use super::pack::{Point, Values};
use telltale_clock::unix_ms;
use telltale_engine::snapshot::{Layout, Moving, Report, Snapshot};
use telltale_engine::time::{Span, Timestamp};
use telltale_record::story::Limit;

/// A snapshot that follows another one sooner is not looked at.
const EVERY: Span = Span::from_millis(200);
/// A number counts for this long without another snapshot. The engine makes four a second.
const HOLDS_MAX: Span = Span::from_secs(1);
/// Values of one module that are kept.
const VALUES_MAX: usize = 16;
/// Values of all modules that are kept; those that come later have no past.
pub const SERIES_MAX: usize = 20_000;
/// A value with a longer key, and a module with a longer name, is not kept.
const NAME_BYTES_MAX: usize = 512;

/// The name under which the vehicle's speed is kept: no module has it.
pub(super) const VEHICLE: &str = "";
const SPEED: &str = "speed_mps";

/// The numbers of all modules in a minute.
#[derive(Debug, Clone, PartialEq)]
pub struct Minute {
    /// Its beginning, in milliseconds since 1970.
    pub from_ms: i64,
    pub(super) nodes: Vec<(Arc<str>, Values)>,
}

#[cfg(test)]
impl Minute {
    /// A minute in which the vehicle drove at this speed.
    pub fn of_speed(from_ms: i64, mps: f32) -> Minute {
        let point = Point { place: 0, tenths: 600, least: mps, mean: mps, most: mps };
        Minute {
            from_ms: from_ms - from_ms.rem_euclid(MINUTE_MS),
            nodes: vec![(VEHICLE.into(), vec![(SPEED.into(), vec![point])])],
        }
    }
}

/// The sums of the minute that is not over.
#[derive(Debug, Default)]
pub struct MinuteSums {
    from_ms: i64,
    seen: Option<Timestamp>,
    layout: Option<Arc<Layout>>,
    /// By `ModuleId` of `layout`.
    modules: Vec<ModuleSums>,
    series: usize,
    /// The speed of the vehicle in m/s, from the way that it has driven.
    speed: Option<ValueSums>,
    driven_m: f64,
}

#[derive(Debug, Default)]
struct ModuleSums {
    report: Option<Arc<Report>>,
    values: Vec<ValueSums>,
}

#[derive(Debug)]
struct ValueSums {
    key: Box<str>,
    /// NaN: there is no number.
    present: f32,
    /// NaN: there was no number in this minute.
    least: f32,
    most: f32,
    /// The number times the milliseconds for which it held, and these.
    sum: f64,
    held_ms: u64,
}

impl MinuteSums {
    /// Takes the numbers that a snapshot shows. Returns a minute that is over.
    pub fn take(&mut self, snapshot: &Snapshot, wall: SystemTime) -> Option<Minute> {
        let held = self.seen.map_or(Span::from_millis(0), |seen| snapshot.now.since(seen));
        if self.seen.is_some() && held < EVERY {
            return None;
        }
        self.seen = Some(snapshot.now);
        let held_ms = held.min(HOLDS_MAX).as_millis();
        for value in self.modules.iter_mut().flat_map(|module| &mut module.values) {
            value.hold(held_ms);
        }
        self.drive(snapshot, held);
        let wall_ms = unix_ms(wall);
        let from_ms = wall_ms - wall_ms.rem_euclid(MINUTE_MS);
        let over = if from_ms == self.from_ms { None } else { self.end() };
        self.from_ms = from_ms;
        self.follow(&snapshot.layout);
        for (index, (module, view)) in self.modules.iter_mut().zip(snapshot.modules.iter()).enumerate() {
            if view.silent {
                module.fall_silent();
            } else if !module.report.as_ref().is_some_and(|known| Arc::ptr_eq(known, &view.report))
                && snapshot.layout.modules[index].id.len() <= NAME_BYTES_MAX
            {
                module.take(&view.report, &mut self.series);
            }
            module.values.iter_mut().for_each(ValueSums::touch);
        }
        over
    }

    /// The speed since the last snapshot, unless nothing was known of it.
    fn drive(&mut self, snapshot: &Snapshot, held: Span) {
        let metres = snapshot.driven_m - std::mem::replace(&mut self.driven_m, snapshot.driven_m);
        let is_known = metres > 0.0 || metres == 0.0 && snapshot.motion.moving != Moving::Unknown;
        if !is_known || held.is_zero() {
            return;
        }
        let speed = self.speed.get_or_insert_with(|| ValueSums::of(SPEED, f32::NAN));
        speed.present = (metres * 1e9 / held.as_nanos() as f64) as f32;
        speed.hold(held.as_millis());
        speed.touch();
    }

    /// The numbers of the present minute; `None` if there are none.
    pub fn end(&mut self) -> Option<Minute> {
        let layout = self.layout.as_ref()?;
        let mut nodes = Vec::new();
        for (module, info) in self.modules.iter_mut().zip(&layout.modules) {
            let points = module.values.iter().filter_map(|it| Some((it.key.clone(), vec![it.point()?])));
            let values: Values = points.collect();
            if !values.is_empty() {
                nodes.push((info.id.clone(), values));
            }
            // A key that does not come again makes room for others.
            module.values.retain(|value| !value.present.is_nan());
            module.values.iter_mut().for_each(ValueSums::begin);
        }
        if let Some(point) = self.speed.take().and_then(|speed| speed.point()) {
            nodes.push((VEHICLE.into(), vec![(SPEED.into(), vec![point])]));
        }
        self.series = self.modules.iter().map(|module| module.values.len()).sum();
        (!nodes.is_empty()).then_some(Minute { from_ms: self.from_ms, nodes })
    }

    /// With a new layout, each module keeps its sums by its name.
    fn follow(&mut self, layout: &Arc<Layout>) {
        let before = self.layout.replace(layout.clone());
        if before.as_ref().is_some_and(|before| Arc::ptr_eq(before, layout)) {
            return;
        }
        self.modules = layout.rearranged(before.as_deref(), std::mem::take(&mut self.modules));
        self.series = self.modules.iter().map(|module| module.values.len()).sum();
    }
}

impl ModuleSums {
    fn take(&mut self, report: &Arc<Report>, series: &mut usize) {
        self.report = Some(report.clone());
        for value in &mut self.values {
            value.present = f32::NAN;
        }
        let numbers = report.numbers().filter(|(key, _)| key.len() <= NAME_BYTES_MAX && !Limit::is_name(key));
        for (key, number) in numbers.take(VALUES_MAX) {
            if let Some(value) = self.values.iter_mut().find(|value| *value.key == *key) {
                value.present = number;
            } else if self.values.len() < VALUES_MAX && *series < SERIES_MAX {
                self.values.push(ValueSums::of(key, number));
                *series += 1;
            }
        }
    }

    fn fall_silent(&mut self) {
        self.report = None;
        for value in &mut self.values {
            value.present = f32::NAN;
        }
    }
}

impl ValueSums {
    fn of(key: &str, present: f32) -> ValueSums {
        ValueSums { key: key.into(), present, least: f32::NAN, most: f32::NAN, sum: 0.0, held_ms: 0 }
    }

    fn hold(&mut self, held_ms: u64) {
        if !self.present.is_nan() {
            self.sum += f64::from(self.present) * held_ms as f64;
            self.held_ms += held_ms;
        }
    }

    /// The present number counts for this minute. The least and the most of NaN and a number are the number.
    fn touch(&mut self) {
        (self.least, self.most) = (self.least.min(self.present), self.most.max(self.present));
    }

    fn begin(&mut self) {
        (self.least, self.most, self.sum, self.held_ms) = (f32::NAN, f32::NAN, 0.0, 0);
    }

    fn point(&self) -> Option<Point> {
        if self.least.is_nan() {
            return None;
        }
        // It came with the last snapshot, or for a moment between two.
        let mean = if self.held_ms == 0 {
            f64::midpoint(self.least.into(), self.most.into())
        } else {
            self.sum / self.held_ms as f64
        };
        let tenths = u32::try_from((self.held_ms + 50) / 100).unwrap_or(u32::MAX).max(1);
        Some(Point { place: 0, tenths, least: self.least, mean: mean as f32, most: self.most })
    }
}
