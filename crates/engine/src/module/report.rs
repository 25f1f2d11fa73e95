//! The texts of a status, kept while they do not change.

use crate::event::with_silence;
use std::borrow::Cow;

use crate::event::Said;
use crate::input::Status;
use crate::model::Limits;
use crate::snapshot::{ModuleView, Report};
use crate::text::Text;
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

    /// The message for programs. A silent module's message begins with the silence, because its last message
    /// would not explain its state.
    pub fn says(&self, now: Timestamp) -> Cow<'_, str> {
        with_silence(self.report.last_words(self.silent), self.silent_for(now))
    }

    /// The same, for events.
    pub fn said(&self, now: Timestamp) -> Option<Said> {
        Said::of(self.report.last_words(self.silent), self.silent_for(now))
    }
}
