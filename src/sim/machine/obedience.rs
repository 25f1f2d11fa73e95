//! The vehicle's reaction to a requested countermeasure (paper, Sec. IV-D).

/// A request to decelerate is repeated twenty times a second and ends this long after the last one. A few
/// lost messages do not end it.
const REQUEST_LASTS_MS: u64 = 300;
/// After the last request the vehicle keeps its speed for a while before it goes on, so that a moment
/// without requests causes no jerk.
const HOLD_MS: u64 = 1000;
/// The brakes give no more, whatever is requested.
const BRAKES_MPS2_MAX: f64 = 6.0;
/// A safe stop of the maneuver component, gentle enough that nobody who stands falls.
const COMFORT_MPS2: f64 = 0.8;
const COMFORT_MPS3: f64 = 0.8;

/// The countermeasures in force.
#[derive(Debug, Clone, Default)]
pub(in crate::sim) struct Obedience {
    /// The deceleration, and for how long it holds without another request.
    deceleration: Option<(f64, u64)>,
    stop: bool,
    /// The present deceleration of the safe stop.
    comfort_mps2: f64,
    hold_ms: u64,
}

impl Obedience {
    /// Takes a request. A value that is not a deceleration requests nothing.
    pub fn decelerate(&mut self, mps2: f64) {
        if mps2 > 0.0 {
            self.deceleration = Some((mps2.min(BRAKES_MPS2_MAX), REQUEST_LASTS_MS));
        }
    }

    pub fn maneuver_stop(&mut self, asked: bool) {
        self.stop = asked;
    }

    /// It brakes, or stands, because of a request.
    pub fn decelerates(&self) -> bool {
        self.deceleration.is_some()
    }

    pub fn stops(&self) -> bool {
        self.stop
    }

    /// The least deceleration of this step; `None` if nothing keeps the vehicle from driving on.
    pub fn step(&mut self, step_ms: u64) -> Option<f64> {
        let step_s = step_ms as f64 / 1000.0;
        self.comfort_mps2 =
            if self.stop { (self.comfort_mps2 + COMFORT_MPS3 * step_s).min(COMFORT_MPS2) } else { 0.0 };
        let asked = self.deceleration.map(|(mps2, _)| mps2);
        self.deceleration = self
            .deceleration
            .and_then(|(mps2, left_ms)| Some((mps2, left_ms.checked_sub(step_ms).filter(|&ms| ms > 0)?)));
        if asked.is_some() || self.stop {
            self.hold_ms = HOLD_MS;
            return Some(asked.unwrap_or(0.0).max(self.comfort_mps2));
        }
        self.hold_ms = self.hold_ms.saturating_sub(step_ms);
        (self.hold_ms > 0).then_some(0.0)
    }
}
