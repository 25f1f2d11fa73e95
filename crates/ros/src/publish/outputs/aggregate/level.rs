//! The levels of `diagnostic_msgs/DiagnosticStatus`, and how they fold.

use telltale_engine::model::Stage;
use telltale_engine::model::output::Like;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::state::State;

/// The level in `diagnostic_msgs/DiagnosticStatus`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    Ok = 0,
    Warning = 1,
    Error = 2,
    Stale = 3,
}

/// UNKNOWN is STALE. IGNORE has no level there and must not alarm, so it is OK; but while the vehicle is
/// locked nothing is diagnosed at all, and OK would be a claim.
pub(super) fn level(snapshot: &Snapshot, state: State) -> Level {
    match state {
        State::Ignore if snapshot.stage == Stage::Locked => Level::Stale,
        State::Ok | State::Ignore => Level::Ok,
        State::Warning => Level::Warning,
        State::Error => Level::Error,
        State::Unknown => Level::Stale,
    }
}

impl Level {
    /// Whether it is worse than another one, by what it asks of people.
    pub fn is_worse_than(self, other: Level) -> bool {
        let rank = |level| {
            [Level::Ok, Level::Warning, Level::Stale, Level::Error].iter().position(|it| *it == level)
        };
        rank(self) > rank(other)
    }

    /// In the words of the aggregator of ROS 2.
    pub(super) const fn word(self, state: State) -> &'static str {
        match (self, state) {
            (_, State::Ignore) => "Ignored",
            (Level::Ok, _) => "OK",
            (Level::Warning, _) => "Warning",
            (Level::Error, _) => "Error",
            (Level::Stale, _) => "Stale",
        }
    }
}

/// The worst level. What is STALE only in part is ERROR, or since the newer releases the worst of the rest, if that
/// is not OK.
pub(super) fn fold_levels(like: Like, levels: impl Iterator<Item = Level>) -> Level {
    let (mut worst_known, mut is_any_known, mut is_any_stale) = (Level::Ok, false, false);
    for level in levels {
        match level {
            Level::Stale => is_any_stale = true,
            level => {
                is_any_known = true;
                worst_known = if level as u8 > worst_known as u8 { level } else { worst_known };
            }
        }
    }
    match (is_any_stale, like) {
        (false, _) => worst_known,
        (true, Like::Before) if is_any_known => Level::Error,
        (true, Like::Since) if worst_known != Level::Ok => worst_known,
        (true, _) => Level::Stale,
    }
}
