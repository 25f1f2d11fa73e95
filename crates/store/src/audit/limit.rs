//! Bounds the records that one source can cause. Failed logins and refused requests, which anybody can cause, are
//! bounded here: a few of each kind are recorded one by one, the rest is counted. What an account does is bounded
//! before it is done.

use std::collections::HashMap;

use super::{Action, Record, TELLTALE};
use crate::Caller;
use telltale_clock::rate::{Bucket, Rate};
use telltale_engine::time::{Span, Timestamp};

/// Records of one source that may come at once.
pub const BURST: u32 = 60;
/// And then one after each of these: about 3 MB in a day.
pub const REFILL: Span = Span::from_secs(10);
/// The records of one source.
pub const RECORDS: Rate = Rate { burst: BURST, refill: REFILL };
/// The count of records left out is written after this long, or before the next record of the kind.
const TELL_AFTER: Span = Span::from_secs(60);

/// How many records of each kind were written lately.
#[derive(Debug, Default)]
pub(crate) struct Limit(HashMap<LimitedKind, Counted>);

/// Records that strangers can cause. The vehicle's own displays are counted apart, so that strangers do not keep them
/// out of the log. There are few kinds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct LimitedKind {
    action: Action,
    caller: Caller,
}

/// The records of one kind, and those that were left out.
#[derive(Debug)]
struct Counted {
    bucket: Bucket,
    omitted: u64,
    omitted_since: Timestamp,
}

impl Limit {
    /// Whether a record may be written; with it comes a record of those of its kind that were left out
    /// before.
    pub(crate) fn admit(&mut self, now: Timestamp, record: &Record) -> Option<Option<Record>> {
        let Some(caller) = record.by_anybody else { return Some(None) };
        let kind = LimitedKind { action: record.action, caller };
        let new = Counted { bucket: Bucket::new(RECORDS, now), omitted: 0, omitted_since: now };
        let counted = self.0.entry(kind).or_insert(new);
        if !counted.bucket.take(now) {
            if counted.omitted == 0 {
                counted.omitted_since = now;
            }
            counted.omitted += 1;
            return None;
        }
        Some(counted.take_omitted(kind))
    }

    /// The counts that are to be written now.
    pub(crate) fn due(&mut self, now: Timestamp) -> Vec<Record> {
        let all = self.0.iter_mut();
        let due = all.filter(|(_, counted)| now.since(counted.omitted_since) >= TELL_AFTER);
        due.filter_map(|(kind, counted)| counted.take_omitted(*kind)).collect()
    }
}

impl Counted {
    fn take_omitted(&mut self, LimitedKind { action, caller }: LimitedKind) -> Option<Record> {
        let source = match caller {
            Caller::Vehicle => "the vehicle's displays",
            Caller::Elsewhere => "elsewhere",
        };
        let omitted = std::mem::take(&mut self.omitted);
        let target = format!("{omitted} more refusals: {}, from {source}", action.as_str());
        (omitted > 0).then(|| Record::of(Action::Omitted, TELLTALE).on(target))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(record: &Record) -> u64 {
        assert_eq!(record.action, Action::Omitted);
        record
            .target
            .split(' ')
            .next()
            .and_then(|count| count.parse().ok())
            .expect("it begins with the count")
    }

    #[test]
    fn a_flood_is_counted_and_does_not_hide_the_vehicles_own_displays() {
        let mut limit = Limit::default();
        let refused = || Record::of(Action::Login, "10.0.0.66").refused("no");
        let (stranger, local) =
            (refused().by_anybody(Caller::Elsewhere), refused().by_anybody(Caller::Vehicle));
        let (mut admitted, mut told, mut records) = (0, 0, 0);
        for second in 0..24 * 3600_u64 {
            let now = Timestamp::ZERO + Span::from_secs(second);
            for _ in 0..10 {
                if let Some(omitted) = limit.admit(now, &stranger) {
                    admitted += 1;
                    told += omitted.as_ref().map_or(0, count);
                    records += 1 + u64::from(omitted.is_some());
                }
            }
            if second == 3600 {
                assert_eq!(limit.admit(now, &local), Some(None));
            }
            for omitted in limit.due(now) {
                assert!(omitted.target.contains("login, from elsewhere"));
                records += 1;
                told += count(&omitted);
            }
        }
        assert!(records < 3 * 8640, "{records}");
        let later = Timestamp::ZERO + Span::from_secs(48 * 3600);
        let rest: u64 = limit.due(later).iter().map(count).sum();
        assert_eq!(admitted + told + rest, 10 * 24 * 3600);
        assert!(limit.due(later).is_empty());
    }

    #[test]
    fn records_with_a_session_have_no_bound() {
        let mut limit = Limit::default();
        let record = Record::of(Action::Stop, "127.0.0.1");
        assert!((0..10 * BURST).all(|_| limit.admit(Timestamp::ZERO, &record) == Some(None)));
    }
}
