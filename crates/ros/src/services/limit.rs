//! How often services are called. A node that calls without end is refused, and the others go on; what every
//! participant together may call is bounded too, because anybody can invent participants.

use std::collections::BTreeMap;

use crate::transport::ids::Prefix;
use telltale_clock::rate::{Bucket, Rate};
use telltale_engine::model::service::Service;
use telltale_engine::time::{Span, Timestamp};

/// Participants that are counted one by one. Those beyond share one bucket.
const CALLERS_MAX: usize = 64;

/// For one participant; all together have twice that.
pub const fn rate(service: Service) -> Rate {
    match service {
        Service::Acknowledge | Service::Reset => Rate { burst: 20, refill: Span::from_secs(1) },
        // Each reads files.
        Service::Reload => Rate { burst: 4, refill: Span::from_secs(10) },
        // Marked incidents are kept for good: they must not fill the disk.
        Service::Mark => Rate { burst: 6, refill: Span::from_secs(600) },
    }
}

/// All participants together.
fn of_all(Rate { burst, refill }: Rate) -> Rate {
    Rate { burst: 2 * burst, refill: Span::from_nanos(refill.as_nanos() / 2) }
}

/// The calls of one service.
#[derive(Debug)]
pub struct Limit {
    rate: Rate,
    all: Bucket,
    callers: BTreeMap<Prefix, Bucket>,
    others: Bucket,
}

impl Limit {
    pub fn new(service: Service, now: Timestamp) -> Limit {
        let rate = rate(service);
        let (all, others) = (Bucket::new(of_all(rate), now), Bucket::new(rate, now));
        Limit { rate, all, callers: BTreeMap::new(), others }
    }

    /// Whether this caller may call now.
    pub fn admits(&mut self, caller: Prefix, now: Timestamp) -> bool {
        if !self.callers.contains_key(&caller) && self.callers.len() >= CALLERS_MAX {
            // A caller with all its tokens is counted anew when it calls.
            self.callers.retain(|_, bucket| !bucket.is_full(now));
        }
        let is_known = self.callers.contains_key(&caller) || self.callers.len() < CALLERS_MAX;
        let bucket = match is_known {
            true => self.callers.entry(caller).or_insert_with(|| Bucket::new(self.rate, now)),
            false => &mut self.others,
        };
        bucket.take(now) && self.all.take(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn caller(number: u32) -> Prefix {
        let mut caller = Prefix::default();
        caller[..4].copy_from_slice(&number.to_le_bytes());
        caller
    }

    #[test]
    fn a_flooding_node_is_refused_and_another_one_is_not() {
        let at = Timestamp::from_millis;
        let mut limit = Limit::new(Service::Acknowledge, at(0));
        let mut admitted = 0;
        for ms in 0..60_000 {
            admitted += u32::from(limit.admits(caller(1), at(ms)));
            if ms % 1000 == 500 {
                assert!(limit.admits(caller(2), at(ms)), "at {ms} ms");
            }
        }
        assert_eq!(admitted, 20 + 59);
    }

    #[test]
    fn invented_participants_together_are_bounded_in_calls_and_in_memory() {
        let at = Timestamp::from_millis;
        let mut limit = Limit::new(Service::Mark, at(0));
        let day = 24 * 3600;
        let calls = (0..day).filter(|second| limit.admits(caller(*second), at(u64::from(*second) * 1000)));
        let admitted = calls.count();
        assert!((12..=12 + 288).contains(&admitted), "{admitted}");
        assert!(limit.callers.len() <= CALLERS_MAX);
    }
}
