//! Bounds the records that anybody can cause: failed logins and refused requests. A few of each kind are
//! recorded one by one; the rest is counted. Other records have no such bound.

use std::collections::HashMap;

use super::{Action, Record, TELLTALE};
use crate::Caller;
use telltale_engine::time::{Span, Timestamp};

/// Records of one kind that may come at once.
const BURST: u32 = 60;
/// And then one after each of these: about 3 MB in a day.
const REFILL: Span = Span::from_secs(10);
/// The count of records left out is written after this long, or before the next record of the kind.
const TELL_AFTER: Span = Span::from_secs(60);

/// How many records of each kind were written lately.
#[derive(Debug, Default)]
pub(crate) struct Limit(HashMap<LimitedKind, Bucket>);

/// What anybody can cause. The vehicle's own displays are counted apart, so that strangers do not keep them
/// out of the log. There are few kinds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct LimitedKind {
    action: Action,
    caller: Caller,
}

#[derive(Debug)]
struct Bucket {
    tokens: u32,
    filled: Timestamp,
    omitted: u64,
    omitted_since: Timestamp,
}

impl Limit {
    /// Whether a record may be written; with it comes a record of those of its kind that were left out
    /// before.
    pub(crate) fn admit(&mut self, now: Timestamp, record: &Record) -> Option<Option<Record>> {
        let Some(caller) = record.by_anybody else { return Some(None) };
        let kind = LimitedKind { action: record.action, caller };
        let new = Bucket { tokens: BURST, filled: now, omitted: 0, omitted_since: now };
        let bucket = self.0.entry(kind).or_insert(new);
        let refills = now.since(bucket.filled).as_nanos() / REFILL.as_nanos();
        if refills > 0 {
            bucket.tokens = bucket.tokens.saturating_add(u32::try_from(refills).unwrap_or(BURST)).min(BURST);
            bucket.filled = bucket.filled + Span::from_nanos(refills * REFILL.as_nanos());
        }
        if bucket.tokens == 0 {
            if bucket.omitted == 0 {
                bucket.omitted_since = now;
            }
            bucket.omitted += 1;
            return None;
        }
        bucket.tokens -= 1;
        Some(bucket.take_omitted(kind))
    }

    /// The counts that are to be written now.
    pub(crate) fn due(&mut self, now: Timestamp) -> Vec<Record> {
        let buckets = self.0.iter_mut();
        let due = buckets.filter(|(_, bucket)| now.since(bucket.omitted_since) >= TELL_AFTER);
        due.filter_map(|(kind, bucket)| bucket.take_omitted(*kind)).collect()
    }
}

impl Bucket {
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
