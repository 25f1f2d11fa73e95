//! How long recordings are kept: within a size and an age, and those that somebody keeps for as long as they
//! are kept.

use std::collections::BTreeSet;

use telltale_engine::time::Span;

/// Incidents that are listed. The oldest beyond it are removed, as for the size.
pub const INCIDENTS_MAX: usize = 10_000;

/// How much is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Policy {
    /// Bytes of all recordings.
    pub disk: u64,
    /// The age of the oldest one.
    pub keep: Span,
    /// Bytes of `disk` that kept recordings do not take from the others: without them, nothing new would stay. The newest
    /// of the others stays whatever its size.
    pub reserved: u64,
}

impl Policy {
    /// Of a vehicle: a tenth is for what nobody keeps.
    pub fn new(disk: u64, keep: Span) -> Policy {
        Policy { disk, keep, reserved: disk / 10 }
    }
}

impl Default for Policy {
    fn default() -> Policy {
        Policy::new(10_000_000_000, Span::from_secs(30 * 24 * 3600))
    }
}

/// The facts of an incident that count.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Held {
    pub id: u64,
    /// Milliseconds since 1970.
    pub since_ms: i64,
    pub bytes: u64,
    pub marked: bool,
    /// Somebody keeps it. A marked one is kept until somebody says otherwise.
    pub kept: bool,
    pub finished: bool,
    pub sha256: Option<String>,
}

/// The recordings that have to go.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Surplus {
    /// The oldest first.
    pub remove: Vec<u64>,
    /// Bytes that remain.
    pub bytes: u64,
    /// Bytes that remain beyond [`Policy::disk`], because they are kept or still written: a reason for a WARNING.
    pub bytes_over: u64,
    /// Incidents that remain beyond [`INCIDENTS_MAX`], for the same reason.
    pub incidents_over: usize,
}

impl Surplus {
    /// Kept recordings alone are more than the policy permits.
    pub fn is_over(&self) -> bool {
        self.bytes_over > 0 || self.incidents_over > 0
    }
}

/// A clock that was set ahead makes no recording older than this much more, until the next start.
const CREDIBLE_MS: i64 = 7 * 24 * 3600 * 1000;

/// The beginning of 2026: a clock before that is not set yet, and a recording made by it has no age. The same in each version,
/// or an update would keep old recordings.
const CLOCK_SET_MS: i64 = 1_767_225_600_000;

/// The time by which the age of recordings is judged, in milliseconds since 1970: the wall time, but not far ahead of
/// the newest record at the start (`floor_ms`) and what has passed since then. A clock that jumps a year ahead must
/// not remove everything.
pub fn judged_ms(wall_ms: i64, floor_ms: i64, passed: Span) -> i64 {
    let passed_ms = i64::try_from(passed.as_millis()).unwrap_or(i64::MAX);
    wall_ms.min(floor_ms.saturating_add(passed_ms).saturating_add(CREDIBLE_MS))
}

/// Decides which recordings have to go. One that is kept, or still written, never does. Their order is that of
/// their numbers, which no step of the clock changes; only the age needs `now_ms`, the wall time. No recording is
/// older than one before it, or the newest ones of a clock that began in the past would go first.
pub fn surplus(held: &[Held], policy: &Policy, now_ms: i64) -> Surplus {
    let mut order: Vec<&Held> = held.iter().collect();
    order.sort_unstable_by_key(|it| it.id);
    let unkept = order.iter().filter(|it| !it.kept);
    let newest = unkept.clone().next_back().map_or(0, |it| it.id);
    let mut unkept_bytes = unkept.fold(0u64, |sum, it| sum.saturating_add(it.bytes));
    let mut bytes = order.iter().fold(0u64, |sum, it| sum.saturating_add(it.bytes));
    let mut count = order.len();
    let keep_ms = i64::try_from(policy.keep.as_millis()).unwrap_or(i64::MAX);
    let (mut remove, mut since_ms) = (Vec::new(), None);
    for it in order {
        // A time in the future was written by a wrong clock, too.
        if (CLOCK_SET_MS..=now_ms).contains(&it.since_ms) {
            since_ms = since_ms.max(Some(it.since_ms));
        }
        let is_old = since_ms.is_some_and(|since_ms| now_ms.saturating_sub(since_ms) > keep_ms);
        let is_reserved = policy.reserved > 0 && (unkept_bytes <= policy.reserved || it.id == newest);
        let is_too_much = (bytes > policy.disk && !is_reserved) || count > INCIDENTS_MAX;
        if it.kept || !it.finished || !(is_old || is_too_much) {
            continue;
        }
        remove.push(it.id);
        bytes -= it.bytes.min(bytes);
        unkept_bytes -= it.bytes.min(unkept_bytes);
        count -= 1;
    }
    Surplus {
        remove,
        bytes,
        bytes_over: bytes.saturating_sub(policy.disk),
        incidents_over: count.saturating_sub(INCIDENTS_MAX),
    }
}

/// The same, but recordings that `is_changed` says are not as they were recorded stay: they are evidence. Those that would
/// have had to go are named too.
pub fn surplus_without_changed(
    held: &[Held],
    policy: &Policy,
    now_ms: i64,
    mut is_changed: impl FnMut(&Held) -> bool,
) -> (Surplus, Vec<u64>) {
    let mut held = held.to_vec();
    let (mut unchanged, mut changed) = (BTreeSet::new(), Vec::new());
    loop {
        let found = surplus(&held, policy, now_ms);
        let known = changed.len();
        for it in held.iter_mut().filter(|it| found.remove.contains(&it.id)) {
            if unchanged.contains(&it.id) {
                continue;
            }
            if is_changed(it) {
                it.kept = true;
                changed.push(it.id);
            } else {
                unchanged.insert(it.id);
            }
        }
        // A recording that stays may make others go.
        if changed.len() == known {
            return (found, changed);
        }
    }
}

/// A number of bytes for people.
pub fn size(bytes: u64) -> String {
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kept_recordings_do_not_take_all_room_from_the_others() {
        let held = |id, bytes, kept| Held { id, bytes, kept, finished: true, ..Held::default() };
        let all = [held(1, 150, true), held(2, 6, false), held(3, 6, false), held(4, 4, false)];
        let policy = Policy::new(100, Span::from_secs(3600));
        let found = surplus(&all, &policy, 0);
        assert_eq!((&found.remove[..], found.is_over()), (&[2][..], true));
        // The newest one stays whatever its size.
        let found = surplus(&[held(1, 150, true), held(2, 5, false), held(3, 60, false)], &policy, 0);
        assert_eq!(found.remove, [2]);
        // Without kept ones `disk` is the bound.
        let found = surplus(&[held(1, 60, false), held(2, 30, false), held(3, 30, false)], &policy, 0);
        assert_eq!((&found.remove[..], found.is_over()), (&[1][..], false));
    }

    const DAY_MS: i64 = 24 * 3600 * 1000;

    fn on(day: i64) -> i64 {
        CLOCK_SET_MS + day * DAY_MS
    }

    fn held(id: u64, day: i64, bytes: u64) -> Held {
        Held { id, since_ms: on(day), bytes, finished: true, ..Held::default() }
    }

    fn policy(disk: u64, days: u64) -> Policy {
        Policy { disk, keep: Span::from_secs(days * 24 * 3600), reserved: 0 }
    }

    #[test]
    fn the_oldest_go_until_the_rest_fits() {
        let all: Vec<Held> = (1..=5).rev().map(|id| held(id, id as i64, 10)).collect();
        let fits = surplus(&all, &policy(50, 30), on(6));
        assert_eq!(fits, Surplus { bytes: 50, ..Surplus::default() });
        let full = surplus(&all, &policy(35, 30), on(6));
        assert_eq!(full, Surplus { remove: vec![1, 2], bytes: 30, ..Surplus::default() });
        assert_eq!(surplus(&[], &policy(0, 0), 0), Surplus::default());
    }

    #[test]
    fn what_was_changed_stays_and_others_go_in_its_place() {
        let all: Vec<Held> = (1..=5).map(|id| held(id, id as i64, 10)).collect();
        let mut asked = Vec::new();
        let (left, changed) = surplus_without_changed(&all, &policy(35, 30), on(6), |it| {
            asked.push(it.id);
            [1, 3].contains(&it.id)
        });
        assert_eq!(left, Surplus { remove: vec![2, 4], bytes: 30, ..Surplus::default() });
        assert_eq!((changed, asked), (vec![1, 3], vec![1, 2, 3, 4]), "each is looked at once");
        let (left, changed) = surplus_without_changed(&all, &policy(15, 30), on(6), |_| true);
        assert!(left.remove.is_empty() && left.is_over() && changed == [1, 2, 3, 4, 5]);
    }

    #[test]
    fn what_is_too_old_goes_whatever_its_size() {
        let all = [held(1, 0, 1), held(2, 10, 1), held(3, 40, 1)];
        assert_eq!(surplus(&all, &policy(1000, 30), on(40)).remove, [1]);
        assert_eq!(surplus(&all, &policy(1000, 30), on(40) + 1).remove, [1, 2]);
        // A clock that was set back makes none old.
        assert!(surplus(&all, &policy(1000, 0), on(-1)).remove.is_empty());
        assert!(surplus(&all, &policy(1000, 0), i64::MIN).remove.is_empty());
    }

    #[test]
    fn a_clock_that_jumps_removes_nothing_that_is_not_old() {
        let (one_year, month) = (365 * DAY_MS, policy(1000, 30));
        // The clock began in the past after each start, and was set right later.
        let all = [held(1, 400, 1), held(2, 0, 1), held(3, 401, 1), held(4, 1, 1)];
        assert!(surplus(&all, &month, on(402)).remove.is_empty());
        assert_eq!(surplus(&all, &month, on(431)).remove, [1, 2]);
        // One was written by a clock far ahead: those after it become old all the same.
        let all = [held(1, 400, 1), held(2, 9000, 1), held(3, 402, 1)];
        assert_eq!(surplus(&all, &month, on(431)).remove, [1, 2]);
        assert_eq!(surplus(&all, &month, on(433)).remove, [1, 2, 3]);
        // The first one was written before the clock was set.
        let all = [held(1, -365 * 50, 1), held(2, 400, 1), held(3, -365, 1)];
        assert!(surplus(&all, &month, on(401)).remove.is_empty());
        assert_eq!(surplus(&all, &month, on(431)).remove, [2, 3]);
        // It jumps a year ahead while the program runs, or before it starts.
        let (newest, day) = (400 * DAY_MS, Span::from_secs(24 * 3600));
        assert_eq!(judged_ms(newest + one_year, newest, day), newest + 8 * DAY_MS);
        assert_eq!(judged_ms(newest + 5 * DAY_MS, newest, Span::ZERO), newest + 5 * DAY_MS);
        assert_eq!(judged_ms(newest - one_year, newest, day), newest - one_year);
        assert_eq!(judged_ms(i64::MAX, i64::MAX, day), i64::MAX);
    }

    #[test]
    fn what_is_kept_or_still_written_stays_and_is_told_if_it_is_too_much() {
        let kept = Held { marked: true, kept: true, ..held(1, 0, 100) };
        let unfinished = Held { finished: false, ..held(2, 0, 30) };
        let released = Held { marked: true, ..held(3, 0, 7) };
        let all = [kept, unfinished, released, held(4, 0, 5)];
        let left = surplus(&all, &policy(50, 1), on(1000));
        assert_eq!((left.remove.as_slice(), left.bytes, left.bytes_over), ([3, 4].as_slice(), 130, 80));
        assert!(left.is_over());
        assert!(!surplus(&all, &policy(130, 1), on(1000)).is_over());
    }

    #[test]
    fn the_number_of_incidents_is_bounded_too() {
        let mut all: Vec<Held> = (1..=INCIDENTS_MAX as u64 + 3).map(|id| held(id, 0, 0)).collect();
        assert_eq!(surplus(&all, &policy(1, 30), 0).remove, [1, 2, 3]);
        all.iter_mut().for_each(|it| it.kept = true);
        let kept = surplus(&all, &policy(1, 30), 0);
        assert_eq!((kept.remove.len(), kept.incidents_over, kept.is_over()), (0, 3, true));
    }
}
