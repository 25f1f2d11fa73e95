//! The words of a status, kept while they do not change.

use super::input::Status;
use super::model::{Limits, Text};
use super::snapshot::Report;

impl Report {
    /// Whether the status says the same in the same words. Longer than the limits, it is compared
    /// as cut by whoever received it.
    pub(super) fn says(&self, status: Status<'_>) -> bool {
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
    pub(super) fn of_engine(said: Text, values: Vec<(Box<str>, Box<str>)>) -> Report {
        let german = Some(said.de.as_ref().into());
        Report { message: said.en.as_ref().into(), german, hardware_id: "".into(), values }
    }

    pub(super) fn of(status: Status<'_>, limits: &Limits) -> Report {
        let cut = |text: &str| -> Box<str> { text[..text.floor_char_boundary(limits.string_bytes)].into() };
        let values = status.values().take(limits.values_per_status);
        Report {
            message: cut(status.message()),
            german: None,
            hardware_id: cut(status.hardware_id()),
            values: values.map(|(key, value)| (cut(key), cut(value))).collect(),
        }
    }
}
