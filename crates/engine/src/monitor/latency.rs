//! The latency of messages: receipt minus header stamp, the worst of the window.

use super::MonitorKind;
use super::window::Window;
use super::words::{Words, span};
use crate::files::KeyframeError;
use crate::model::monitors::Bands;
use crate::model::sample::Sample;
use crate::state::State;
use crate::text::Text;
use crate::text::say;
use crate::time::{Span, Timestamp};
use serde::{Deserialize, Serialize};

/// Clocks of one vehicle may differ by this much; a stamp further in the future is useless.
const FUTURE_MAX: Span = Span::from_millis(50);

/// A stamp this far away is from another clock: of a simulation, or of a machine with the wrong time.
const OTHER_CLOCK: Span = Span::from_secs(3600);

/// The reason why a stamp is useless.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum StampFault {
    Absent,
    /// There is no time on `/clock` to compare it with.
    NoClock,
    Zero,
    Future(Span),
    OtherClock(Span),
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Latency {
    window: Window,
    #[serde(skip)]
    bands: Bands,
    /// The last message with a useless stamp: while it is in the window, the window is not judged as OK.
    doubt: Option<(Timestamp, StampFault)>,
    /// Kept while the window is empty: then the module's timeout decides.
    last: Option<State>,
}

impl Latency {
    pub(super) fn new(window: Span, bands: Bands) -> Latency {
        Latency { window: Window::new(window), bands, doubt: None, last: None }
    }
}

impl MonitorKind for Latency {
    fn resume(&mut self, kept: Latency) -> Result<(), KeyframeError> {
        let Latency { window, bands: _, doubt, last } = kept;
        (self.doubt, self.last) = (doubt, last);
        self.window.resume(window)
    }

    fn begin_anew(&mut self, _now: Timestamp) -> bool {
        self.window.clear();
        (self.doubt, self.last) = (None, None);
        true
    }

    fn take_message(&mut self, _slot: usize, sample: &Sample, now: Timestamp) {
        match age(sample.stamp_ns, sample.received_wall_ns) {
            Ok(seconds) => self.window.push(seconds, now),
            Err(doubt) => self.doubt = Some((now, doubt)),
        }
    }

    fn judge(&mut self, now: Timestamp) -> Option<State> {
        self.window.advance(now);
        self.doubt = self.doubt.filter(|(at, _)| *at + self.window.span() > now);
        let measured =
            self.window.extremes().map(|(min, max)| self.bands.judge(min).max(self.bands.judge(max)));
        let doubted = self.doubted();
        self.last = measured.max(doubted).or(self.last);
        self.last
    }

    fn due(&self, _now: Timestamp) -> Option<Timestamp> {
        let doubt = self.doubt.map(|(at, _)| at + self.window.span());
        let leaving = self.window.leaving().next().map(|(at, _)| at);
        match self.last {
            None | Some(State::Ok) => None,
            Some(_) => [doubt, leaving].into_iter().flatten().min(),
        }
    }

    fn moves(&self, _now: Timestamp) -> bool {
        !self.window.is_empty()
    }

    fn words(&self, _now: Timestamp) -> Words {
        let worst = self
            .window
            .extremes()
            .map(|(min, max)| if self.bands.judge(min) > self.bands.judge(max) { min } else { max });
        let values = worst.map_or(Vec::new(), |worst| self.bands.values("latency_s", worst));
        let late = worst.map(|worst| self.bands.say_of(worst, "s".into(), say!("late", "Verspätung")));
        let is_doubt = self.doubted() >= worst.map(|worst| self.bands.judge(worst));
        let message = match (self.doubt, late) {
            (Some((_, doubt)), _) if is_doubt => doubt.say(),
            (_, Some(late)) => late,
            (_, None) if self.last.is_some() => {
                say!("no message for {time}", "keine Nachricht seit {time}", time = span(self.window.span()))
            }
            (_, None) => "".into(),
        };
        Words { message, values }
    }
}

impl Latency {
    /// The state of the last useless stamp.
    fn doubted(&self) -> Option<State> {
        self.doubt.map(|(_, doubt)| match doubt {
            StampFault::Future(_) => self.bands.unmeasurable(),
            _ => State::Unknown,
        })
    }
}

/// Seconds from stamp to receipt. A stamp slightly ahead of this machine's clock counts as now.
pub(super) fn age(stamp_ns: Option<i64>, received_wall_ns: i64) -> Result<f64, StampFault> {
    let stamp = stamp_ns.ok_or(StampFault::Absent)?;
    if stamp == 0 {
        return Err(StampFault::Zero);
    }
    if received_wall_ns == Sample::NO_CLOCK {
        return Err(StampFault::NoClock);
    }
    let age = i128::from(received_wall_ns) - i128::from(stamp);
    let away = Span::from_nanos(u64::try_from(age.unsigned_abs()).unwrap_or(u64::MAX));
    if away > OTHER_CLOCK {
        return Err(StampFault::OtherClock(away));
    }
    if age < 0 && away > FUTURE_MAX {
        return Err(StampFault::Future(away));
    }
    Ok(age.max(0) as f64 / 1e9)
}

impl StampFault {
    pub(super) fn say(self) -> Text {
        match self {
            StampFault::Absent => {
                say!("the message has no readable stamp", "Nachricht ohne lesbaren Zeitstempel")
            }
            StampFault::NoClock => {
                say!("nothing was heard of /clock yet", "von /clock kam noch nichts")
            }
            StampFault::Zero => say!("the stamp was not set", "Zeitstempel nicht gesetzt"),
            StampFault::Future(by) => say!(
                "the stamp lies {by} in the future: set the clocks",
                "Zeitstempel liegt {by} in der Zukunft: Uhren stellen",
                by = span(by)
            ),
            StampFault::OtherClock(by) => say!(
                "the stamp is from another clock, {by} away",
                "Zeitstempel von anderer Uhr, {by} entfernt",
                by = span(by)
            ),
        }
    }
}
