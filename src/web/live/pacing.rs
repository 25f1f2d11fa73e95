//! Decides when a page gets the next state.

use std::time::Duration;

use crate::engine::time::{Span, Timestamp};

/// No more states in a second than eyes see.
const APART: Span = Span::from_millis(60);
/// Where there is no end of them: a display that takes in each of them does little else.
const APART_LONG: Span = Span::from_millis(125);
/// Until then there is an end of them.
const BACKLOG_MAX: Span = Span::from_millis(500);

/// A state goes out at once where none went before it for [`APART`], and while they come without a
/// pause [`APART_LONG`] after the last. What comes meanwhile is not sent later: the newest is.
#[derive(Debug, Default)]
pub struct Pacing {
    /// Until when all that was sent would have taken at the long distance.
    backlog_until: Timestamp,
}

impl Pacing {
    /// How long to wait after the state of now, which was sent if there was anything to see in it.
    pub fn pause(&mut self, now: Timestamp, sent: bool) -> Duration {
        if sent {
            self.backlog_until = self.backlog_until.max(now) + APART_LONG;
        }
        let pause = (self.backlog_until.since(now) - BACKLOG_MAX).max(APART);
        Duration::from_nanos(pause.as_nanos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pauses after states that come as soon as they may, or so much later, and when they end.
    fn pauses(
        pacing: &mut Pacing,
        sent: bool,
        start_ms: u64,
        later_ms: u64,
        count: usize,
    ) -> (Vec<u128>, u64) {
        let mut now_ms = start_ms;
        let mut pause = || {
            let pause = pacing.pause(Timestamp::from_millis(now_ms), sent).as_millis();
            now_ms += pause as u64 + later_ms;
            pause
        };
        let pauses = (0..count).map(|_| pause()).collect();
        (pauses, now_ms)
    }

    #[test]
    fn single_states_go_out_at_once_and_a_flood_of_them_slowly() {
        let mut pacing = Pacing::default();
        let (flood, end_ms) = pauses(&mut pacing, true, 10_000, 0, 40);
        assert_eq!(flood[..7], [60; 7]);
        assert_eq!(flood[10..], [125; 30]);
        // Six in a second are no flood, nor are a few after a second of quiet.
        let (calm, end_ms) = pauses(&mut pacing, true, end_ms + 1000, 100, 50);
        assert_eq!(calm, [60; 50]);
        // States in which there is nothing to see are none.
        let (unseen, end_ms) = pauses(&mut pacing, false, end_ms, 0, 50);
        assert_eq!(unseen, [60; 50]);
        let (again, _) = pauses(&mut pacing, true, end_ms, 0, 7);
        assert_eq!(again, [60; 7]);
    }
}
