//! The texts of a status, kept while they do not change.

use crate::event::with_silence;
use std::borrow::Cow;

use crate::event::Said;
use crate::input::Status;
use crate::model::Limits;
use crate::snapshot::{ModuleView, Report, Steps};
use crate::state::State;
use crate::text::{Text, say};
use crate::time::{Span, Timestamp};

/// The memory of a KeyValue apart from its text: two strings.
const VALUE_BYTES: usize = 64;

impl Report {
    /// Whether the status has the same texts. A longer status is compared as the bridge would cut it.
    pub(crate) fn says(&self, status: Status<'_>) -> bool {
        *self.message == *status.message()
            && *self.hardware_id == *status.hardware_id()
            && self.values.len() == status.values().len()
            && self
                .values
                .iter()
                .zip(status.values())
                .all(|((k, v), (key, value))| **k == *key && **v == *value)
    }

    /// The report of a monitor or of one of Telltale's own modules.
    pub(crate) fn of_engine(said: Text, values: Vec<(Box<str>, Box<str>)>) -> Report {
        let german = Some(said.de.as_ref().into());
        Report { message: said.en.as_ref().into(), german, values, ..Report::default() }
    }

    /// The values that are numbers. NaN and the infinities are none: they have no place in a mean or a curve.
    pub fn numbers(&self) -> impl Iterator<Item = (&str, f32)> {
        let number = |text: &str| text.trim().parse().ok().filter(|value: &f32| value.is_finite());
        self.values.iter().filter_map(move |(key, text)| Some((&**key, number(text)?)))
    }

    /// The message, unless it only tells of the silence that is shown anyway.
    pub fn last_words(&self, silent: bool) -> &str {
        if silent && self.aged { "" } else { &self.message }
    }

    pub(crate) fn of(status: Status<'_>, limits: &Limits) -> Report {
        let cut = |text: &str| -> Box<str> { text[..text.floor_char_boundary(limits.string_bytes)].into() };
        let values = status.values().take(limits.values_per_status);
        Report {
            message: cut(status.message()),
            german: None,
            hardware_id: cut(status.hardware_id()),
            aged: false,
            values: values.map(|(key, value)| (cut(key), cut(value))).collect(),
            cut: 0,
        }
    }

    /// The approximate memory of its texts. Reports that the engine makes are bounded elsewhere.
    pub(crate) fn weight(&self) -> usize {
        if self.german.is_some() {
            return 0;
        }
        let values = self.values.iter().map(|(key, value)| VALUE_BYTES + key.len() + value.len());
        self.message.len() + self.hardware_id.len() + values.sum::<usize>()
    }

    /// The same report with at most `bytes`: values are dropped first, from the end, then the hardware id, then
    /// the end of the message.
    pub(crate) fn cut_to(&self, bytes: usize) -> Report {
        let before = self.weight();
        let keep = |text: &str, bytes: usize| -> Box<str> { text[..text.floor_char_boundary(bytes)].into() };
        let message = keep(&self.message, bytes);
        let hardware_id = keep(&self.hardware_id, bytes - message.len());
        let mut left = bytes - message.len() - hardware_id.len();
        let fits = |(key, value): &&(Box<str>, Box<str>)| {
            let size = VALUE_BYTES + key.len() + value.len();
            let fits = size <= left;
            left = left.saturating_sub(size);
            fits
        };
        let values = self.values.iter().take_while(fits).cloned().collect();
        let shorter = Report { message, hardware_id, values, aged: self.aged, german: None, cut: 0 };
        let cut = self.cut + before.saturating_sub(shorter.weight());
        Report { cut, ..shorter }
    }
}

impl ModuleView {
    /// The length of the silence, if it is longer than the module's timeout.
    pub fn silent_for(&self, now: Timestamp) -> Option<Span> {
        self.received.filter(|_| self.silent).map(|received| now.since(received))
    }

    /// Why it is UNKNOWN, where neither its report nor its silence tells.
    pub fn why_unknown(&self) -> Option<Text> {
        self.steps.why_unknown(self.own, self.silent)
    }

    /// The message for programs. It begins with the silence of a silent module, or with another reason for UNKNOWN,
    /// because the last message would not explain the state.
    pub fn says(&self, now: Timestamp) -> Cow<'_, str> {
        let last = self.report.last_words(self.silent);
        match self.why_unknown() {
            Some(why) => unknown(&why.en, last).into(),
            None if last.is_empty() && self.received.is_none() && self.own >= State::Warning => {
                "nothing received yet".into()
            }
            None => with_silence(last, self.silent_for(now)),
        }
    }

    /// The same, for events.
    pub fn said(&self, now: Timestamp) -> Option<Said> {
        said(&self.report, self.silent, self.why_unknown(), self.silent_for(now))
    }
}

/// What is kept of a message, with the reason for UNKNOWN before it.
pub(crate) fn said(
    report: &Report,
    silent: bool,
    why: Option<Text>,
    silent_for: Option<Span>,
) -> Option<Said> {
    let last = report.last_words(silent);
    match why {
        Some(why) => Said::of(&unknown(&why.en, last), silent_for),
        None => Said::of(last, silent_for),
    }
}

fn unknown(why: &str, last: &str) -> String {
    if last.is_empty() { why.to_owned() } else { format!("{why}; last: {last}") }
}

impl Steps {
    /// Why a module with this own state is UNKNOWN although its last report was better, and it is not silent.
    pub(crate) fn why_unknown(&self, own: State, silent: bool) -> Option<Text> {
        let was_better = self.reported.is_some_and(|reported| reported < State::Unknown);
        if own != State::Unknown || silent || !was_better {
            None
        } else if self.grace || self.judged == Some(State::Unknown) {
            Some(say!("nothing received yet", "noch nichts empfangen"))
        } else if self.debounced == Some(State::Unknown) {
            Some(say!(
                "unknown until it has been better for long enough",
                "unbekannt, bis es lange genug besser ist"
            ))
        } else {
            // Nothing else takes away a state that counts.
            Some(say!(
                "nothing received since the connection to the vehicle failed",
                "nichts empfangen, seit die Verbindung zum Fahrzeug ausfiel"
            ))
        }
    }
}
