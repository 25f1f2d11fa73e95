//! Bounds how often something happens, with time as a parameter.

use telltale_engine::time::{Span, Timestamp};

/// So many at once, and one more after each span.
#[derive(Debug, Clone, Copy)]
pub struct Rate {
    pub burst: u32,
    pub refill: Span,
}

/// Tokens that refill at a [`Rate`].
#[derive(Debug, Clone, Copy)]
pub struct Bucket {
    rate: Rate,
    tokens: u32,
    filled: Timestamp,
}

impl Bucket {
    pub fn new(rate: Rate, now: Timestamp) -> Bucket {
        Bucket { rate, tokens: rate.burst, filled: now }
    }

    /// Takes a token, if there is one.
    pub fn take(&mut self, now: Timestamp) -> bool {
        self.fill(now);
        let is_left = self.tokens > 0;
        self.tokens -= u32::from(is_left);
        is_left
    }

    /// Whether all that may come at once is left, as at first.
    pub fn is_full(&mut self, now: Timestamp) -> bool {
        self.fill(now);
        self.tokens == self.rate.burst
    }

    fn fill(&mut self, now: Timestamp) {
        let refill = self.rate.refill.as_nanos();
        let steps = now.since(self.filled).as_nanos() / refill;
        if steps > 0 {
            let more = u32::try_from(steps).unwrap_or(u32::MAX);
            self.tokens = self.tokens.saturating_add(more).min(self.rate.burst);
            self.filled = self.filled + Span::from_nanos(steps * refill);
        }
    }
}
