//! Delays logins after failures, for each account and for each source.
//!
//! No account is ever locked. Failures elsewhere delay only logins from elsewhere, so a stranger cannot
//! keep the operator out at one of the vehicle's own displays. A display waits only for failures at that
//! display, and a browser in which its user logged in before only for failures there.

use std::collections::HashMap;
use std::net::IpAddr;

use super::peer::network;
use telltale_engine::time::{Span, Timestamp};
use telltale_store::{Caller, Token};

/// Failures before the first delay: typing errors are no attack.
const FREE_FAILURES: u32 = 3;
const ACCOUNT_DELAY_MAX: Span = Span::from_secs(30);
const SOURCE_DELAY_MAX: Span = Span::from_secs(60);
/// Without a failure for this long, earlier ones are forgotten.
const FORGET_AFTER: Span = Span::from_secs(15 * 60);
/// The entry that failed least recently makes place for a new one.
const ENTRIES_MAX: usize = 4096;

/// Failed logins, as they are remembered.
#[derive(Debug, Default)]
pub struct Throttle(HashMap<Key, Failures>);

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Key {
    Source(IpAddr),
    /// An account as tried at one of the vehicle's own displays, or from anywhere else.
    Account {
        name: Box<str>,
        near: Option<IpAddr>,
    },
    /// A browser from which its user logged in before.
    Device(Token),
}

#[derive(Debug, Clone, Copy)]
struct Failures {
    count: u32,
    last: Timestamp,
    /// The failure before the last: a right login takes itself back as if it had never been tried.
    before: Timestamp,
}

/// The source of a login.
#[derive(Debug, Clone)]
pub struct Source {
    pub ip: IpAddr,
    pub caller: Caller,
    /// The cookie of a browser from which this user logged in before.
    pub device: Option<Token>,
}

impl Throttle {
    /// Whether a login may be tried now. It counts as failed until [`Throttle::succeeded`], so that logins
    /// that are tried at the same time count too.
    ///
    /// # Errors
    /// How long to wait. A refused try makes the wait no longer.
    pub fn attempt(&mut self, now: Timestamp, name: &str, source: &Source) -> Result<(), Span> {
        let keys = keys(name, source);
        let wait = keys.iter().map(|key| self.wait(now, key)).max().unwrap_or_default();
        if !wait.is_zero() {
            return Err(wait);
        }
        for key in keys {
            self.count(now, key);
        }
        Ok(())
    }

    /// The login that was tried last for this account and source was right.
    pub fn succeeded(&mut self, name: &str, source: &Source) {
        for key in keys(name, source) {
            if !matches!(key, Key::Source(_)) {
                self.0.remove(&key);
                continue;
            }
            // The others that failed from there stay: somebody with an account must not clear them.
            if let Some(failures) = self.0.get_mut(&key) {
                failures.count = failures.count.saturating_sub(1);
                failures.last = failures.before;
                if failures.count == 0 {
                    self.0.remove(&key);
                }
            }
        }
    }

    fn wait(&self, now: Timestamp, key: &Key) -> Span {
        let Some(failures) = self.0.get(key) else { return Span::ZERO };
        let since = now.since(failures.last);
        if failures.count < FREE_FAILURES || since > FORGET_AFTER {
            return Span::ZERO;
        }
        let doubled = Span::from_secs(1 << (failures.count - FREE_FAILURES).min(10));
        let delay_max = if matches!(key, Key::Source(_)) { SOURCE_DELAY_MAX } else { ACCOUNT_DELAY_MAX };
        doubled.min(delay_max) - since
    }

    fn count(&mut self, now: Timestamp, key: Key) {
        if self.0.len() >= ENTRIES_MAX && !self.0.contains_key(&key) {
            let oldest = self.0.iter().min_by_key(|(_, failures)| failures.last).map(|(key, _)| key.clone());
            oldest.map(|key| self.0.remove(&key));
        }
        let failures = self.0.entry(key).or_insert(Failures { count: 0, last: now, before: now });
        let forgotten = now.since(failures.last) > FORGET_AFTER;
        failures.count = if forgotten { 1 } else { failures.count.saturating_add(1) };
        failures.before = failures.last;
        failures.last = now;
    }
}

/// A known browser waits for its own failures alone.
fn keys(name: &str, source: &Source) -> Vec<Key> {
    if let Some(device) = &source.device {
        return vec![Key::Device(device.clone())];
    }
    let ip = source.ip.to_canonical();
    let account = Key::Account {
        name: name.chars().take(64).collect(),
        near: (source.caller == Caller::Vehicle).then_some(ip),
    };
    vec![Key::Source(network(ip)), account]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_right_login_makes_nobody_else_wait() {
        let mut throttle = Throttle::default();
        let source = &Source { ip: IpAddr::from([127, 0, 0, 1]), caller: Caller::Vehicle, device: None };
        let at = |seconds: u64| Timestamp::ZERO + Span::from_secs(seconds);
        for _ in 0..3 {
            throttle.attempt(at(100), "dora", source).unwrap();
        }
        throttle.attempt(at(700), "dora", source).unwrap();
        throttle.succeeded("dora", source);
        assert_eq!(throttle.attempt(at(700), "anna", source), Ok(()));
    }

    const LOCAL: &str = "127.0.0.1";
    const ENROLLED: &str = "10.0.0.7";
    const STRANGER: &str = "10.0.0.66";

    fn source(text: &str) -> Source {
        let caller = if [LOCAL, ENROLLED].contains(&text) { Caller::Vehicle } else { Caller::Elsewhere };
        Source { ip: text.parse().unwrap(), caller, device: None }
    }

    fn failed(throttle: &mut Throttle, at_s: u64, name: &str, from: &str) -> Result<(), Span> {
        throttle.attempt(Timestamp::from_millis(at_s * 1000), name, &source(from))
    }

    #[test]
    fn delays_grow_to_their_bound_and_are_forgotten() {
        let mut throttle = Throttle::default();
        let mut now_s = 100;
        for delay_s in [0, 0, 1, 2, 4, 8, 16, 32, 60, 60] {
            assert_eq!(failed(&mut throttle, now_s, "anna", LOCAL), Ok(()));
            if delay_s > 0 {
                let wait = Err(Span::from_secs(delay_s));
                assert_eq!(failed(&mut throttle, now_s, "anna", LOCAL), wait, "{delay_s}");
                assert_eq!(failed(&mut throttle, now_s, "bert", LOCAL), wait, "the source waits too");
            }
            now_s += delay_s;
        }
        now_s += 15 * 60 + 1;
        for _ in 0..3 {
            assert_eq!(failed(&mut throttle, now_s, "anna", LOCAL), Ok(()));
        }
    }

    #[test]
    fn a_stranger_delays_strangers_but_not_the_vehicles_own_displays() {
        for display in [LOCAL, ENROLLED] {
            let mut throttle = Throttle::default();
            for stranger in 70..80 {
                let _ = failed(&mut throttle, 100, "anna", &format!("10.0.0.{stranger}"));
            }
            assert!(failed(&mut throttle, 100, "anna", STRANGER).is_err(), "one account, many sources");
            assert_eq!(failed(&mut throttle, 100, "anna", display), Ok(()));
            throttle.succeeded("anna", &source(display));
            for _ in 0..3 {
                assert_eq!(failed(&mut throttle, 100, "anna", display), Ok(()), "a success forgets");
            }
        }
    }

    #[test]
    fn a_known_browser_and_another_display_wait_for_nobody_else() {
        let mut throttle = Throttle::default();
        for _ in 0..4 {
            let _ = failed(&mut throttle, 100, "anna", LOCAL);
        }
        assert!(failed(&mut throttle, 100, "anna", LOCAL).is_err());
        assert_eq!(failed(&mut throttle, 100, "anna", ENROLLED), Ok(()), "another display");
        let known = Source { device: Token::parse(&"a".repeat(64)), ..source(LOCAL) };
        let at = Timestamp::from_millis(100_000);
        for _ in 0..3 {
            assert_eq!(throttle.attempt(at, "anna", &known), Ok(()));
        }
        assert!(throttle.attempt(at, "anna", &known).is_err(), "its own failures count");
    }

    #[test]
    fn what_is_remembered_is_bounded() {
        let mut throttle = Throttle::default();
        for source in 0..20_000_u32 {
            let stranger =
                &Source { ip: IpAddr::from(source.to_be_bytes()), caller: Caller::Elsewhere, device: None };
            let _ = throttle.attempt(Timestamp::from_millis(u64::from(source)), "anna", stranger);
        }
        assert!(throttle.0.len() <= ENTRIES_MAX);
    }
}
