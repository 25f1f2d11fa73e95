//! The vehicle's side of what Telltale asks for (`docs/holding.md`; paper, Sec. IV-D). Silence ends nothing: once
//! asked to slow down or to stop, the vehicle brakes to a halt and stands until it is released.

/// The brakes give no more, whatever is requested.
const BRAKES_MPS2_MAX: f64 = 6.0;
/// A safe stop of the maneuver component, gentle enough that nobody who stands falls.
const COMFORT_MPS2: f64 = 0.8;
const COMFORT_MPS3: f64 = 0.8;

/// The reason that keeps the vehicle from driving on.
#[derive(Debug, Clone, Default)]
pub(crate) struct Obedience {
    /// The deceleration that was requested last, until the release.
    deceleration_mps2: Option<f64>,
    /// Whether a safe stop is requested.
    stop: bool,
    /// Something was requested, and nobody has released the vehicle since.
    held: bool,
    /// The present deceleration of the safe stop.
    comfort_mps2: f64,
}

impl Obedience {
    /// Takes a request. A value that is not a deceleration requests nothing.
    pub fn decelerate(&mut self, mps2: f64) {
        if mps2 > 0.0 {
            self.deceleration_mps2 = Some(mps2.min(BRAKES_MPS2_MAX));
            self.held = true;
        }
    }

    /// The end of a request releases nothing.
    pub fn maneuver_stop(&mut self, asked: bool) {
        self.stop = asked;
        self.held |= asked;
    }

    /// `false` is the release.
    pub fn hold(&mut self, held: bool) {
        self.held = held;
        if !held {
            self.deceleration_mps2 = None;
        }
    }

    /// It brakes, or stands, because of a request to slow down.
    pub fn decelerates(&self) -> bool {
        self.deceleration_mps2.is_some()
    }

    /// It makes a safe stop, or stands after one. A vehicle that only hears that it is held makes one too.
    pub fn stops(&self) -> bool {
        self.stop || self.held && !self.decelerates()
    }

    /// It must not set off.
    pub fn holds(&self) -> bool {
        self.held || self.stop
    }

    /// The least deceleration of this step; `None` if nothing keeps the vehicle from driving on.
    pub fn step(&mut self, step_ms: u64) -> Option<f64> {
        let step_s = step_ms as f64 / 1000.0;
        let comfort_mps2 = (self.comfort_mps2 + COMFORT_MPS3 * step_s).min(COMFORT_MPS2);
        self.comfort_mps2 = if self.stops() { comfort_mps2 } else { 0.0 };
        self.holds().then(|| self.deceleration_mps2.unwrap_or(0.0).max(self.comfort_mps2))
    }
}
