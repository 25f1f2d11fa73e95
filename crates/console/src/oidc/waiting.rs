//! Logins that were begun and wait for their browsers to come back from the issuer.

use std::net::IpAddr;

use openidconnect::{Nonce, PkceCodeVerifier, RedirectUrl};
use telltale_engine::time::{Span, Timestamp};
use telltale_store::Token;

/// A login must come back within this time.
pub const WAITS_FOR: Span = Span::from_secs(600);

/// Logins that wait, of all and of one network; a new one takes the place of the oldest.
const WAITING_MAX: usize = 1024;
const OF_NETWORK_MAX: usize = 16;

/// One login that was begun.
#[derive(Debug)]
pub struct Begun {
    pub state: String,
    /// In a cookie of the browser that began it.
    pub browser: Token,
    pub nonce: Nonce,
    pub verifier: PkceCodeVerifier,
    pub back: RedirectUrl,
    /// The network of the browser.
    pub network: IpAddr,
    pub until: Timestamp,
}

/// All that wait, the oldest first.
#[derive(Debug, Default)]
pub struct Waiting(Vec<Begun>);

impl Waiting {
    pub fn add(&mut self, begun: Begun, now: Timestamp) {
        self.0.retain(|it| it.until > now);
        let of_network = self.0.iter().filter(|it| it.network == begun.network).count();
        if of_network >= OF_NETWORK_MAX
            && let Some(index) = self.0.iter().position(|it| it.network == begun.network)
        {
            self.0.remove(index);
        }
        if self.0.len() >= WAITING_MAX {
            self.0.remove(0);
        }
        self.0.push(begun);
    }

    /// Takes the login with this state, once, if this browser began it.
    pub fn take(&mut self, state: &str, browser: Option<&Token>, now: Timestamp) -> Option<Begun> {
        let index = self.0.iter().position(|it| it.state == state)?;
        let begun = self.0.remove(index);
        (begun.until > now && browser == Some(&begun.browser)).then_some(begun)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn begun(state: &str, network: [u8; 4], at: Timestamp) -> Begun {
        Begun {
            state: state.to_owned(),
            browser: Token::parse(&"ab".repeat(32)).unwrap(),
            nonce: Nonce::new_random(),
            verifier: PkceCodeVerifier::new("v".repeat(43)),
            back: RedirectUrl::new("http://localhost/login/oidc/back".to_owned()).unwrap(),
            network: network.into(),
            until: at + WAITS_FOR,
        }
    }

    #[test]
    fn a_login_comes_back_once_in_time_and_in_its_browser() {
        let now = Timestamp::from_millis(1000);
        let (own, other) = (Token::parse(&"ab".repeat(32)), Token::parse(&"cd".repeat(32)));
        let mut waiting = Waiting::default();
        let mut is_taken = |browser: &Option<Token>, state: &str, after_s: u64| {
            waiting.add(begun("a", [1, 1, 1, 1], now), now);
            let later = now + Span::from_secs(after_s);
            let taken = waiting.take(state, browser.as_ref(), later).is_some();
            assert!(waiting.take("a", browser.as_ref(), later).is_none() || state != "a");
            taken
        };
        assert!(is_taken(&own, "a", 599));
        assert!(!is_taken(&own, "a", 600), "too late");
        assert!(!is_taken(&other, "a", 1), "another browser");
        assert!(!is_taken(&None, "a", 1));
        assert!(!is_taken(&own, "b", 1), "another state");
    }

    #[test]
    fn one_network_pushes_out_its_own_and_many_push_out_the_oldest() {
        let now = Timestamp::from_millis(1000);
        let mut waiting = Waiting::default();
        waiting.add(begun("first", [9, 9, 9, 9], now), now);
        for number in 0..100 {
            waiting.add(begun(&number.to_string(), [1, 1, 1, 1], now), now);
        }
        assert_eq!(waiting.0.len(), OF_NETWORK_MAX + 1);
        assert_eq!((&*waiting.0[0].state, &*waiting.0[1].state), ("first", "84"));
        for number in 0..=255 {
            (0..5).for_each(|of| waiting.add(begun("x", [2, of, 0, number], now), now));
        }
        assert_eq!((waiting.0.len(), &*waiting.0[0].state), (WAITING_MAX, "x"));
        waiting.add(begun("last", [9, 9, 9, 9], now), now + WAITS_FOR);
        assert_eq!(waiting.0.len(), 1, "late ones go");
    }
}
