//! What the vehicle does about a countermeasure that is asked of it (paper, Sec. IV-D).

/// A request to decelerate is repeated twenty times a second; this long after the last one it is
/// over. A few lost messages do not end it.
const REQUEST_LASTS_MS: u64 = 300;
/// After the last request the shuttle keeps its speed for a while before it goes on: a moment
/// without requests must not make it push.
const HOLD_MS: u64 = 1000;
/// Whatever is asked for, the brakes give no more.
const BRAKES_MPS2_MAX: f64 = 6.0;
/// A safe stop of the maneuver component: so that nobody who stands falls.
const COMFORT_MPS2: f64 = 0.8;
const COMFORT_MPS3: f64 = 0.8;

/// The countermeasures in force.
#[derive(Debug, Clone, Default)]
pub(super) struct Obedience {
    /// How much, and for how long without being asked again.
    deceleration: Option<(f64, u64)>,
    stop: bool,
    /// How hard the safe stop brakes by now.
    comfort_mps2: f64,
    hold_ms: u64,
}

impl Obedience {
    /// Takes a request. What is no deceleration asks for nothing.
    pub fn decelerate(&mut self, mps2: f64) {
        if mps2 > 0.0 {
            self.deceleration = Some((mps2.min(BRAKES_MPS2_MAX), REQUEST_LASTS_MS));
        }
    }

    pub fn maneuver_stop(&mut self, asked: bool) {
        self.stop = asked;
    }

    /// It brakes, or stands, because it was asked to.
    pub fn decelerates(&self) -> bool {
        self.deceleration.is_some()
    }

    pub fn stops(&self) -> bool {
        self.stop
    }

    /// The deceleration of this step at least; none where nothing keeps the shuttle from driving on.
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
