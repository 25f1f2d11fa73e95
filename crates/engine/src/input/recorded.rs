//! A `diagnostic_msgs/DiagnosticArray` in files: a list of statuses, each with its texts.

use serde::{Deserialize, Serialize};

use crate::discovery::WriterId;
use crate::time::Span;

#[derive(Serialize, Deserialize)]
pub(super) struct StatusArray {
    writer: WriterId,
    statuses: Vec<Status>,
    /// How much later than usual it was received, in nanoseconds.
    #[serde(default, skip_serializing_if = "Span::is_zero")]
    late_ns: Span,
}

#[derive(Serialize, Deserialize)]
struct Status {
    /// The level byte as it was received.
    level: u8,
    name: String,
    message: String,
    hardware_id: String,
    /// Keys with their values, in order; a key may repeat.
    values: Vec<(String, String)>,
}

impl From<super::StatusArray> for StatusArray {
    fn from(array: super::StatusArray) -> StatusArray {
        let of = |it: super::Status<'_>| Status {
            level: it.level(),
            name: it.name().to_owned(),
            message: it.message().to_owned(),
            hardware_id: it.hardware_id().to_owned(),
            values: it.values().map(|(key, value)| (key.to_owned(), value.to_owned())).collect(),
        };
        StatusArray { writer: array.writer, statuses: array.iter().map(of).collect(), late_ns: array.late }
    }
}

impl From<StatusArray> for super::StatusArray {
    fn from(recorded: StatusArray) -> super::StatusArray {
        let mut array =
            super::StatusArray::default().said_by(recorded.writer).received_late(recorded.late_ns);
        for Status { level, name, message, hardware_id, values } in recorded.statuses {
            array.push_status(level, &name, &message, &hardware_id);
            values.iter().for_each(|(key, value)| array.push_value(key, value));
        }
        array
    }
}
