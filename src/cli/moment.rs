//! How commands are told of a moment: a time after a beginning, or a time of the clock.

use std::time::{Duration, SystemTime};

#[derive(Debug, Clone, Copy)]
pub enum Moment {
    /// After the first instant that there is.
    After(Duration),
    Wall(SystemTime),
}

/// Reads one of the command line.
///
/// # Errors
/// It is none.
pub fn moment(text: &str) -> Result<Moment, String> {
    let after = || humantime::parse_duration(text).map(Moment::After).ok();
    let seconds = || text.parse().ok().and_then(|s| Duration::try_from_secs_f64(s).ok()).map(Moment::After);
    let wall = || humantime::parse_rfc3339_weak(text).map(Moment::Wall).ok();
    after().or_else(seconds).or_else(wall).ok_or_else(|| "write `12s` or `2026-11-20T12:00:00Z`".to_owned())
}
