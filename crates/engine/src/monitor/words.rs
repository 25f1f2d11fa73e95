//! The messages of monitors: numbers in readable form, and limits.

use crate::model::monitors::Bands;
use crate::model::quantity::{Quantity, number, rounded};
use crate::state::State;
use crate::text::Text;
use crate::text::say;
use crate::time::Span;

/// Bytes of a quoted text.
const QUOTED_MAX: usize = 80;

/// Bytes of a reason that are shown: enough for a path or the name of a type, and what to do.
const WHY_MAX: usize = 200;

/// The message of a monitor beside its state.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Words {
    pub(crate) message: Text,
    /// Measured values, for programs and small diagrams.
    pub(crate) values: Vec<(&'static str, String)>,
}

impl Words {
    pub(super) fn plain(message: Text) -> Words {
        Words { message, values: Vec::new() }
    }
}

impl Bands {
    /// A value below or above a limit counts, an equal one does not; ERROR before WARNING. A value that is not
    /// finite is UNKNOWN.
    pub(super) fn judge(&self, value: f64) -> State {
        self.judge_within(value, 0.0)
    }

    /// The same for a value with the uncertainty `slack`: within it a limit counts as equal.
    pub(super) fn judge_within(&self, value: f64, slack: f64) -> State {
        if !value.is_finite() {
            return State::Unknown;
        }
        let below = |limit: Option<f64>| limit.is_some_and(|limit| value < limit - slack);
        let above = |limit: Option<f64>| limit.is_some_and(|limit| value > limit + slack);
        if below(self.error_below) || above(self.error_above) {
            State::Error
        } else if below(self.warning_below) || above(self.warning_above) {
            State::Warning
        } else {
            State::Ok
        }
    }

    /// The same limits in another unit; `factor` of it are one of this.
    pub(super) fn scaled(&self, factor: f64) -> Bands {
        let scale = |limit: Option<f64>| limit.map(|limit| limit * factor);
        Bands {
            warning_below: scale(self.warning_below),
            error_below: scale(self.error_below),
            warning_above: scale(self.warning_above),
            error_above: scale(self.error_above),
            unmeasurable: self.unmeasurable,
        }
    }

    /// The state of what these limits cannot be compared with.
    pub(super) fn unmeasurable(&self) -> State {
        self.unmeasurable.unwrap_or(State::Unknown)
    }

    /// A value with its unit as people read it: 0.17 of a battery is `17 %, at least 20 % wanted`.
    pub(super) fn say_in(&self, value: f64, quantity: Option<&Quantity>) -> Text {
        match quantity {
            Some(Quantity { unit, factor }) => self.scaled(*factor).say(value * factor, Text::plain(unit)),
            None => self.say(value, Text::default()),
        }
    }

    /// `4.2 Hz, at least 9 Hz wanted`.
    pub(super) fn say(&self, value: f64, unit: Text) -> Text {
        self.say_of(value, unit, Text::default())
    }

    /// `0.7 s late, at most 0.5 s wanted`: with words that follow the value and its unit.
    pub(super) fn say_of(&self, value: f64, unit: Text, words: Text) -> Text {
        let lower = self.warning_below.or(self.error_below);
        let upper = self.warning_above.or(self.error_above);
        let limits = [self.warning_below, self.error_below, self.warning_above, self.error_above];
        let value = beside(beside(numeral(measured(value, &limits)), &unit), &words);
        let with_unit = |limit: f64| beside(numeral(number(limit)), &unit);
        match (lower, upper) {
            (Some(lower), Some(upper)) => say!(
                "{value}, {lower} to {upper} wanted",
                "{value}, erwartet {lower} bis {upper}",
                value,
                lower = numeral(number(lower)),
                upper = with_unit(upper)
            ),
            (Some(lower), None) => {
                let lower = with_unit(lower);
                say!("{value}, at least {lower} wanted", "{value}, erwartet mindestens {lower}", value, lower)
            }
            (None, Some(upper)) => {
                let upper = with_unit(upper);
                say!("{value}, at most {upper} wanted", "{value}, erwartet höchstens {upper}", value, upper)
            }
            (None, None) => value,
        }
    }

    /// The value and the limits by their names.
    pub(super) fn values(&self, name: &'static str, value: f64) -> Vec<(&'static str, String)> {
        let limits = self.limits(["warning_below", "error_below", "warning_above", "error_above"]);
        std::iter::once((name, number(value))).chain(limits).collect()
    }

    /// The limits by these names.
    pub(super) fn limits(&self, names: [&'static str; 4]) -> impl Iterator<Item = (&'static str, String)> {
        let limits = [self.warning_below, self.error_below, self.warning_above, self.error_above];
        names.into_iter().zip(limits).filter_map(|(name, limit)| Some((name, number(limit?))))
    }
}

/// A measured value with as few digits as distinguish it from the limits: three, and fewer of a value that is much
/// smaller than every limit (`0.07`, at most 1.15).
fn measured(value: f64, limits: &[Option<f64>]) -> String {
    let magnitude = |number: f64| number.abs().log10().floor();
    let smallest = limits.iter().flatten().filter(|limit| **limit != 0.0).map(|limit| magnitude(*limit));
    let apart = smallest.fold(f64::INFINITY, f64::min) - magnitude(value);
    // Without a limit, or for zero, it is infinite.
    let least = if apart.is_finite() { 3 - (apart as i32).clamp(0, 2) } else { 3 };
    let like_a_limit = |text: &str| {
        limits
            .iter()
            .flatten()
            .any(|&limit| (limit - value).abs() > 1e-9 * limit.abs() && number(limit) == text)
    };
    let texts = (least..=9).map(|digits| rounded(value, digits));
    texts.into_iter().find(|text| !like_a_limit(text)).unwrap_or_else(|| rounded(value, 17))
}

/// A text and the words after it, if there are any.
fn beside(text: Text, words: &Text) -> Text {
    if words.en.is_empty() {
        text
    } else {
        say!("{text} {words}", "{text} {words}", text, words = words.clone())
    }
}

/// A number with the decimal separator of each language.
pub(super) fn numeral(number: String) -> Text {
    match &*number {
        "not a number" => say!("not a number", "keine Zahl"),
        "infinite" => say!("infinite", "unendlich"),
        _ => Text { de: number.replace('.', ",").into(), en: number.into() },
    }
}

/// `17 %` for 0.17 of a battery.
pub(super) fn numeral_in(value: f64, quantity: Option<&Quantity>) -> Text {
    Bands::default().say_in(value, quantity)
}

/// `350 ms`, `2 s`, `1.5 h`.
pub(super) fn span(span: Span) -> Text {
    let seconds = span.as_secs_f64();
    let (count, unit) = match seconds {
        ..1e-3 => (seconds * 1e6, Text::plain("us")),
        ..1.0 => (seconds * 1e3, Text::plain("ms")),
        ..300.0 => (seconds, Text::plain("s")),
        ..7200.0 => (seconds / 60.0, Text::plain("min")),
        ..172_800.0 => (seconds / 3600.0, Text::plain("h")),
        _ => (seconds / 86_400.0, say!("days", "Tage")),
    };
    say!("{count} {unit}", "{count} {unit}", count = numeral(number(count)), unit)
}

/// A quoted text, cut if it is too long.
pub(super) fn quoted(text: &str) -> String {
    let cut = cut(text);
    if cut.len() < text.len() { format!("\"{cut}…\"") } else { format!("\"{cut}\"") }
}

pub(crate) fn cut(text: &str) -> &str {
    &text[..text.floor_char_boundary(QUOTED_MAX)]
}

/// The reason that a reader or a probe gives, cut if it is too long.
pub(super) fn reason(why: &str) -> &str {
    &why[..why.floor_char_boundary(WHY_MAX)]
}

/// Nothing is measured while the module is not relevant.
pub(super) fn not_measured() -> Words {
    Words::plain(say!("not measured while it does not matter", "zählt zurzeit nicht, nicht gemessen"))
}

/// The first window is not full.
pub(super) fn measuring(window: Span) -> Words {
    Words::plain(say!("measuring for {time}", "wird gemessen seit {time}", time = span(window)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_to_a_limit_does_not_count_and_error_comes_first() {
        let bands = Bands {
            warning_below: Some(9.0),
            error_below: Some(5.0),
            warning_above: Some(11.0),
            error_above: Some(20.0),
            unmeasurable: None,
        };
        for (value, state) in [
            (4.9, State::Error),
            (5.0, State::Warning),
            (8.99, State::Warning),
            (9.0, State::Ok),
            (11.0, State::Ok),
            (11.1, State::Warning),
            (20.0, State::Warning),
            (20.1, State::Error),
            (f64::NAN, State::Unknown),
            (f64::INFINITY, State::Unknown),
            (f64::NEG_INFINITY, State::Unknown),
        ] {
            assert_eq!(bands.judge(value), state, "{value}");
        }
    }

    #[test]
    fn numbers_are_short_and_never_look_like_a_limit_that_they_miss() {
        let at_least = Bands { warning_below: Some(9.0), ..Bands::default() };
        let both = Bands { warning_above: Some(0.2), error_below: Some(-0.1), ..Bands::default() };
        for (bands, value, text) in [
            (at_least, 4.2, "4.2 Hz, at least 9 Hz wanted"),
            (at_least, 8.9996, "8.9996 Hz, at least 9 Hz wanted"),
            (at_least, 9.0, "9 Hz, at least 9 Hz wanted"),
            (at_least, 20_000.0, "20000 Hz, at least 9 Hz wanted"),
            (at_least, 0.0, "0 Hz, at least 9 Hz wanted"),
            (at_least, 1.0 / 3.0, "0.33 Hz, at least 9 Hz wanted"),
            (
                Bands { warning_above: Some(1.15), ..Bands::default() },
                0.0735,
                "0.07 Hz, at most 1.15 Hz wanted",
            ),
            (both, 1e-9, "1e-9 Hz, -0.1 to 0.2 Hz wanted"),
            (both, 1e300, "1.00e300 Hz, -0.1 to 0.2 Hz wanted"),
        ] {
            assert_eq!(&*bands.say(value, "Hz".into()).en, text);
        }
    }

    #[test]
    fn spans_and_quotes_are_readable() {
        for (nanos, text) in [(350_000_000, "350 ms"), (2_000_000_000, "2 s"), (5_400_000_000_000, "90 min")]
        {
            assert_eq!(&*span(Span::from_nanos(nanos)).en, text);
        }
        assert_eq!(quoted("idle"), "\"idle\"");
        assert!(quoted(&"ä".repeat(500)).len() < 100);
    }
}
