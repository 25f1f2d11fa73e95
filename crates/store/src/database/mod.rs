//! The database as a file: its schema, its folder, its daily copies; and how it holds times.

pub(super) mod backup;
pub(super) mod files;
pub(super) mod foreign;
pub(super) mod schema;

use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Of a time in the database: milliseconds since 1970.
pub(crate) fn from_unix_ms(ms: i64) -> SystemTime {
    UNIX_EPOCH + Duration::from_millis(u64::try_from(ms).unwrap_or(0))
}
