//! The numbers of all modules over days: of each minute the least, the mean and the greatest, later of each hour.
//!
//! A minute is one row with all modules, so a card or a disk is written little and in order. When an hour is over, its
//! minutes become one row for each module: a page reads those of its module alone. When minutes are
//! too many, the oldest become hours, a row for each module and day. Beyond the bound of the hours the oldest day goes, and the log says so.
//! Rows of one time may be there twice, as the wall clock may go back and the program may start again: readers put
//! together what belongs together.

mod minute;
mod pack;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub use minute::{Minute, MinuteSums};
pub use read::{Resolution, Trend, TrendPoint, TrendQuery, ValueTrend, drives, trend};
pub use write::TrendWriter;

pub(super) const SCHEMA: &str = "
    CREATE TABLE IF NOT EXISTS trends (
        id INTEGER PRIMARY KEY,
        level INTEGER NOT NULL,
        from_ms INTEGER NOT NULL,
        node TEXT NOT NULL,
        bytes INTEGER NOT NULL,
        data BLOB NOT NULL
    ) STRICT;
    CREATE INDEX IF NOT EXISTS trends_by_time ON trends (level, from_ms, node, bytes);
";

const MINUTE_MS: i64 = 60_000;
const HOUR_MS: i64 = 60 * MINUTE_MS;
const DAY_MS: i64 = 24 * HOUR_MS;

/// The span of a row. The numbers stand on the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Level {
    /// A minute of all modules.
    Minute = 0,
    /// The minutes of a module in an hour.
    Hour = 1,
    /// The hours of a module in a day.
    Day = 2,
}

impl Level {
    /// The span of time of a row.
    const fn row_ms(self) -> i64 {
        match self {
            Level::Minute => MINUTE_MS,
            Level::Hour => HOUR_MS,
            Level::Day => DAY_MS,
        }
    }
}
