//! Decides when a page gets the next state.

use std::time::Duration;

use telltale_engine::time::{Span, Timestamp};

/// Between two states: people see no more in a second.
const APART: Span = Span::from_millis(60);
/// Between two states under continuous change, which would keep a display busy.
const APART_LONG: Span = Span::from_millis(125);
/// The backlog from which a change counts as continuous.
const BACKLOG_MAX: Span = Span::from_millis(500);

/// A state is sent at once if the last one was sent more than [`APART`] ago; under continuous change, a state
/// is sent every [`APART_LONG`]. After a pause only the newest state is sent. The first change of a state does
/// not wait for the end of a pause ([`first_changes`](super::first_changes)); words do.
#[derive(Debug, Default)]
pub struct Pacing {
    /// When the states that were sent would all be out, if each took [`APART_LONG`].
    backlog_until: Timestamp,
}

impl Pacing {
    /// The pause after the present state. It was sent if there was something to see in it.
    pub fn pause(&mut self, now: Timestamp, sent: bool) -> Duration {
        if sent {
            // First changes do not wait, and must not make the pauses after them longer and longer.
            let backlog_max = now + BACKLOG_MAX + APART_LONG;
            self.backlog_until = (self.backlog_until.max(now) + APART_LONG).min(backlog_max);
        }
        let pause = (self.backlog_until.since(now) - BACKLOG_MAX).max(APART);
        Duration::from(pause)
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
    fn states_that_do_not_wait_make_no_pause_longer() {
        let mut pacing = Pacing::default();
        let longest = (0..1000).map(|number| pacing.pause(Timestamp::from_millis(50 * number), true)).max();
        assert_eq!(longest, Some(Duration::from_millis(125)));
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
