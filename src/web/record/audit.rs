//! The records that the server writes into the audit log, with a bound on those that anybody can cause.
//!
//! Actions with a session are always recorded. Anybody can cause failed logins and refused requests, so
//! only a limited number of each kind is recorded one by one; the rest is counted.

use std::collections::HashMap;
use std::hash::BuildHasher as _;
use std::net::IpAddr;
use std::sync::PoisonError;

use crate::engine::time::{Span, Timestamp};
use crate::store::audit::{Action, Record, TELLTALE};
use crate::store::{Caller, Session, StoreError};
use crate::web::AppState;

/// Records of one kind that may come at once.
const BURST: u32 = 60;
/// And then one after each of these: about 3 MB in a day.
const REFILL: Span = Span::from_secs(10);
/// What was left out is told after this long, if nothing of its kind is recorded before.
const TELL_AFTER: Span = Span::from_secs(60);

/// How much of what was recorded lately.
#[derive(Debug, Default)]
pub struct Limit {
    buckets: HashMap<Kind, Bucket>,
    /// Records that could not be written, of any kind.
    lost: u64,
}

/// What anybody can cause. The vehicle's own displays are counted apart, so that nobody out there
/// keeps them out of the log. There are few kinds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Kind {
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
    /// Whether a record may be written, and how many of its kind were left out before it.
    fn admit(&mut self, now: Timestamp, kind: Kind) -> Option<u64> {
        let bucket = self.buckets.entry(kind).or_insert(Bucket {
            tokens: BURST,
            filled: now,
            omitted: 0,
            omitted_since: now,
        });
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
        Some(std::mem::take(&mut bucket.omitted))
    }

    /// What was left out could not be told.
    fn put_back(&mut self, now: Timestamp, kind: Kind, count: u64) {
        if let Some(bucket) = self.buckets.get_mut(&kind) {
            bucket.omitted_since = if bucket.omitted == 0 { now } else { bucket.omitted_since };
            bucket.omitted += count;
        }
    }

    /// What was left out and is to be told now.
    fn due(&mut self, now: Timestamp) -> Vec<(Kind, u64)> {
        let due = self
            .buckets
            .iter_mut()
            .filter(|(_, bucket)| bucket.omitted > 0 && now.since(bucket.omitted_since) >= TELL_AFTER);
        due.map(|(kind, bucket)| (*kind, std::mem::take(&mut bucket.omitted))).collect()
    }
}

impl Kind {
    fn omitted(self, count: u64) -> Record {
        let source = match self.caller {
            Caller::Vehicle => "the vehicle's displays",
            Caller::Elsewhere => "elsewhere",
        };
        let target = format!("{count} more refusals: {}, from {source}", self.action.as_str());
        Record::of(Action::Omitted, TELLTALE).on(target)
    }
}

impl AppState {
    /// Records what somebody did. When this returns, it is on the disk; only then may it be
    /// acknowledged.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn audit(&self, record: Record) -> Result<(), StoreError> {
        self.store.audit(record).await
    }

    /// Records a refusal that anybody can cause, unless there were too many of its kind.
    pub async fn audit_refusal(&self, source: IpAddr, record: Record) {
        if self.may_record_refusal(source, record.action).await {
            self.audit_or_log_from(self.caller(source), record).await;
        }
    }

    /// Whether one more refusal of this kind is to be recorded; what was left out before it is told.
    pub async fn may_record_refusal(&self, source: IpAddr, action: Action) -> bool {
        let caller = self.caller(source);
        let kind = Kind { action, caller };
        let admitted = self.audit_limit().admit(self.clock.now(), kind);
        let Some(omitted) = admitted else { return false };
        if omitted > 0 && self.store.audit_from(caller, kind.omitted(omitted)).await.is_err() {
            self.audit_limit().put_back(self.clock.now(), kind, omitted);
        }
        true
    }

    /// What is recorded of a name with which a login failed. What is no user's may be a secret that
    /// was typed into the wrong field: of that only repeats can be told, until the next restart.
    pub async fn recorded_name(&self, name: &str) -> String {
        match self.store.knows_user(name).await {
            Ok(true) => name.to_owned(),
            _ => format!("(unknown name, {:08x})", self.unknown_names.hash_one(name) >> 32),
        }
    }

    /// Records how much was not recorded one by one.
    pub async fn audit_omitted(&self) {
        let now = self.clock.now();
        let (due, lost) = {
            let mut limit = self.audit_limit();
            (limit.due(now), std::mem::take(&mut limit.lost))
        };
        for (kind, count) in due {
            if self.store.audit(kind.omitted(count)).await.is_err() {
                self.audit_limit().put_back(now, kind, count);
            }
        }
        let target = match lost {
            1 => "1 record that could not be written".to_owned(),
            _ => format!("{lost} records that could not be written"),
        };
        let record = Record::of(Action::Omitted, TELLTALE).on(target);
        if lost > 0 && self.store.audit(record).await.is_err() {
            self.audit_limit().lost += lost;
        }
    }

    /// Records what happened whether it can be recorded or not. What cannot is counted.
    pub async fn audit_or_log(&self, record: Record) {
        self.audit_or_log_from(Caller::Vehicle, record).await;
    }

    /// The same for what somebody caused who comes from there.
    pub async fn audit_or_log_from(&self, caller: Caller, record: Record) {
        let action = record.action.as_str();
        if let Err(error) = self.store.audit_from(caller, record).await {
            tracing::error!(%error, action, "the audit log lacks a record");
            self.audit_limit().lost += 1;
        }
    }

    fn audit_limit(&self) -> std::sync::MutexGuard<'_, Limit> {
        self.audit_limit.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The beginning of a record of what a session did.
pub fn record_of(session: &Session, action: Action, source: IpAddr) -> Record {
    Record::of(action, source.to_canonical().to_string()).by(&*session.user, session.role)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_counted_and_does_not_hide_the_vehicles_own_displays() {
        let mut limit = Limit::default();
        let stranger = Kind { action: Action::Login, caller: Caller::Elsewhere };
        let local = Kind { caller: Caller::Vehicle, ..stranger };
        let (mut admitted, mut told, mut records) = (0, 0, 0);
        for second in 0..24 * 3600_u64 {
            let now = Timestamp::ZERO + Span::from_secs(second);
            for _ in 0..10 {
                if let Some(omitted) = limit.admit(now, stranger) {
                    admitted += 1;
                    told += omitted;
                    records += 1 + u64::from(omitted > 0);
                }
            }
            if second == 3600 {
                assert_eq!(limit.admit(now, local), Some(0));
            }
            for (kind, count) in limit.due(now) {
                assert_eq!(kind, stranger);
                records += 1;
                told += count;
            }
        }
        assert!(records < 3 * 8640, "{records}");
        let later = Timestamp::ZERO + Span::from_secs(48 * 3600);
        let rest: u64 = limit.due(later).iter().map(|(_, count)| count).sum();
        assert_eq!(admitted + told + rest, 10 * 24 * 3600);
        assert!(limit.due(later).is_empty());
    }
}
