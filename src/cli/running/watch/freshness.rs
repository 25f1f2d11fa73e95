//! How old is what is shown. Data that are not fresh never look fresh.

use crate::engine::time::{Span, Timestamp};

/// The server sends four messages a second. After this long without one, what is shown is stale.
const STALE_AFTER: Span = Span::from_millis(1000);
/// After this long it says nothing about the present any more.
const LOST_AFTER: Span = Span::from_millis(2000);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Freshness {
    Live,
    /// Late for this long: it may be the network.
    Stale(Span),
    /// Nothing came for this long; `None`: nothing came at all.
    Lost {
        since: Option<Span>,
        connected: bool,
    },
}

/// What is known of the connection.
#[derive(Debug, Default)]
pub struct Link {
    pub connected: bool,
    last: Option<Timestamp>,
}

impl Link {
    pub fn heard(&mut self, now: Timestamp) {
        self.connected = true;
        self.last = Some(now);
    }

    pub fn freshness(&self, now: Timestamp) -> Freshness {
        let since = self.last.map(|last| now.since(last));
        match since {
            Some(since) if since < STALE_AFTER => Freshness::Live,
            Some(since) if since < LOST_AFTER => Freshness::Stale(since),
            since => Freshness::Lost { since, connected: self.connected },
        }
    }
}

impl Freshness {
    /// In words; empty while it is live.
    pub fn words(self) -> String {
        let ago = |since: Span| format!("last data {} s ago", since.as_millis() / 1000);
        match self {
            Freshness::Live => String::new(),
            Freshness::Stale(since) => format!("STALE, {}", ago(since)),
            Freshness::Lost { since: None, .. } => "no data yet".to_owned(),
            Freshness::Lost { since: Some(since), connected: true } => format!("NO DATA, {}", ago(since)),
            Freshness::Lost { since: Some(since), connected: false } => {
                format!("NOT CONNECTED, {}", ago(since))
            }
        }
    }

    pub const fn is_lost(self) -> bool {
        matches!(self, Freshness::Lost { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_is_stale_after_a_second_and_lost_after_two() {
        let mut link = Link::default();
        let at = Timestamp::from_millis;
        assert_eq!(link.freshness(at(0)).words(), "no data yet");
        link.heard(at(10_000));
        for (ms, words) in [
            (10_999, ""),
            (11_000, "STALE, last data 1 s ago"),
            (11_999, "STALE, last data 1 s ago"),
            (12_000, "NO DATA, last data 2 s ago"),
        ] {
            assert_eq!(link.freshness(at(ms)).words(), words, "{ms}");
        }
        link.connected = false;
        assert_eq!(link.freshness(at(13_500)).words(), "NOT CONNECTED, last data 3 s ago");
        link.heard(at(14_000));
        assert_eq!(link.freshness(at(14_000)), Freshness::Live);
    }
}
