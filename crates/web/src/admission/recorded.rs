//! How often an account may do actions that the audit log records: the records of one person, who acts all day long,
//! must not push the records of others out of the log. The actions of an operator on the vehicle have no such bound.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use axum::http::Method;

use telltale_clock::rate::Bucket;
use telltale_engine::time::Timestamp;
use telltale_store::Role;
use telltale_store::audit::limit::RECORDS;

/// The token bucket of an account has one more action after this long.
pub const TRY_AGAIN_AFTER_S: u16 = 10;

/// The actions that each account has left. There are no more accounts than users who log in between two restarts.
#[derive(Debug, Default)]
pub struct Recorded(Mutex<HashMap<Arc<str>, Bucket>>);

impl Recorded {
    /// Whether this account may do one more thing that is recorded.
    pub fn admit(&self, now: Timestamp, user: &Arc<str>) -> bool {
        let mut accounts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // A full bucket is that of a new account.
        accounts.retain(|_, bucket| !bucket.is_full(now));
        accounts.entry(user.clone()).or_insert_with(|| Bucket::new(RECORDS, now)).take(now)
    }
}

/// Whether the bound holds for a request: its action is recorded, and it is no action of an operator on the vehicle.
pub fn is_bounded(method: &Method, path: &str, role: Role) -> bool {
    let acts = !matches!(*method, Method::GET | Method::HEAD);
    let is_mark = matches!(path, "/api/v1/mark" | "/incidents/mark");
    // A replay is moved often and leaves no record. Everybody may log out, and log in as somebody else.
    let is_free = path.starts_with("/replay/") || matches!(path, "/login" | "/logout");
    acts && (is_mark || role != Role::Operator && !is_free)
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_engine::time::Span;
    use telltale_store::audit::limit::{BURST, REFILL};

    #[test]
    fn a_flood_of_one_account_is_refused_and_others_go_on() {
        assert_eq!(Span::from_secs(TRY_AGAIN_AFTER_S.into()), REFILL);
        let (recorded, anna, bert) = (Recorded::default(), "anna".into(), "bert".into());
        let mut admitted = 0_u32;
        for second in 0..24 * 3600 {
            let now = Timestamp::ZERO + Span::from_secs(second);
            admitted += (0..10).map(|_| u32::from(recorded.admit(now, &anna))).sum::<u32>();
            if second % 3600 == 0 {
                assert!(recorded.admit(now, &bert), "at {second} s");
            }
        }
        assert!((8640..=8640 + BURST).contains(&admitted), "{admitted}");
        let later = Timestamp::ZERO + Span::from_secs(48 * 3600);
        assert!((0..BURST).all(|_| recorded.admit(later, &bert)));
        assert!(!recorded.admit(later, &bert));
        assert_eq!(recorded.0.lock().unwrap().len(), 1, "an account with a full bucket is forgotten");
    }

    #[test]
    fn what_an_operator_does_to_the_vehicle_has_no_bound() {
        for path in ["/vehicle/stop", "/vehicle/clearance/withdraw", "/alarms/1/acknowledge", "/logout"] {
            assert!(!is_bounded(&Method::POST, path, Role::Operator), "{path}");
        }
        for path in ["/login", "/logout"] {
            assert!(!is_bounded(&Method::POST, path, Role::Authority), "{path}");
        }
        assert!(!is_bounded(&Method::GET, "/incidents", Role::Developer));
        assert!(!is_bounded(&Method::POST, "/replay/1/state", Role::Developer));
        for path in ["/api/v1/incidents/1/note", "/incidents/1/keep", "/api/v1/mark", "/incidents/1/what-if"]
        {
            assert!(is_bounded(&Method::POST, path, Role::Developer), "{path}");
        }
        assert!(is_bounded(&Method::POST, "/api/v1/mark", Role::Operator));
    }
}
