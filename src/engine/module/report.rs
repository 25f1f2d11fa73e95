//! The texts of a status, kept while they do not change.

use crate::engine::event::with_silence;
use std::borrow::Cow;

use crate::engine::event::Said;
use crate::engine::input::Status;
use crate::engine::model::Limits;
use crate::engine::snapshot::{ModuleView, Report};
use crate::engine::text::Text;
use crate::engine::time::{Span, Timestamp};

/// What a KeyValue takes beside its text: two strings, each on its own.
const VALUE_BYTES: usize = 64;

impl Report {
    /// Whether the status says the same in the same words. Longer than the limits, it is compared
    /// as cut by the bridge.
    pub(in crate::engine) fn says(&self, status: Status<'_>) -> bool {
        *self.message == *status.message()
            && *self.hardware_id == *status.hardware_id()
            && self.values.len() == status.values().len()
            && self
                .values
                .iter()
                .zip(status.values())
                .all(|((k, v), (key, value))| **k == *key && **v == *value)
    }

    /// What a monitor, or the diagnosis of itself, says.
    pub(in crate::engine) fn of_engine(said: Text, values: Vec<(Box<str>, Box<str>)>) -> Report {
        let german = Some(said.de.as_ref().into());
        Report { message: said.en.as_ref().into(), german, values, ..Report::default() }
    }

    /// The message, unless the module is silent and its message says only that.
    pub fn last_words(&self, silent: bool) -> &str {
        if silent && self.aged { "" } else { &self.message }
    }

    pub(in crate::engine) fn of(status: Status<'_>, limits: &Limits) -> Report {
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

    /// The bytes that its words take in memory, about. What the engine says itself is bounded elsewhere.
    pub(in crate::engine) fn weight(&self) -> usize {
        if self.german.is_some() {
            return 0;
        }
        let values = self.values.iter().map(|(key, value)| VALUE_BYTES + key.len() + value.len());
        self.message.len() + self.hardware_id.len() + values.sum::<usize>()
    }

    /// The same with at most so many bytes: values go first, from the end, then the hardware id, then the
    /// end of the message.
    pub(in crate::engine) fn cut_to(&self, bytes: usize) -> Report {
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
    /// For how long nothing came, where that is longer than the module's timeout.
    pub fn silent_for(&self, now: Timestamp) -> Option<Span> {
        self.received.filter(|_| self.silent).map(|received| now.since(received))
    }

    /// What it says, for programs: of a silent module first that it is. Its last words alone would
    /// stand beside a state that they do not explain.
    pub fn says(&self, now: Timestamp) -> Cow<'_, str> {
        with_silence(self.report.last_words(self.silent), self.silent_for(now))
    }

    /// The same, to be kept.
    pub(in crate::engine) fn said(&self, now: Timestamp) -> Option<Said> {
        Said::of(self.report.last_words(self.silent), self.silent_for(now))
    }
}
