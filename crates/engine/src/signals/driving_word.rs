//! Whether the signal that the vehicle drives is believed.
//!
//! It is believed as long as it does not contradict itself. A vehicle that has arrived drives again only after
//! a clearance. If the signal turns true sooner and without one, the vehicle did not arrive: two components
//! disagree, or one flaps. For a while, a `false` then counts only once it has lasted, so no diagnosis of the
//! drive is interrupted.

use crate::time::{Span, Timestamp};
use serde::{Deserialize, Serialize};

/// The time for which an arrival must last before it ends the drive's requests.
pub(crate) const ARRIVAL: Span = Span::from_secs(3);

/// How long a contradiction is remembered.
const DOUBT: Span = Span::from_secs(10);

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub(crate) struct Drive {
    /// The time of the last believed arrival.
    ended: Option<Timestamp>,
    doubted_until: Option<Timestamp>,
    /// Since when the signal is false without a break, if it was doubted when it turned false.
    denied: Option<Timestamp>,
    /// It has said that it drives, and was not silent since then. A component that starts again is silent first.
    heard: bool,
}

impl Drive {
    /// Takes a sample. `drove`: the vehicle was believed to drive until now. `expected`: it was cleared.
    pub(crate) fn take(&mut self, drives: bool, drove: bool, expected: bool, now: Timestamp) {
        if drives {
            self.heard = true;
            let denied = self.denied.take();
            // A `false` that lasted is an arrival as well, from then on.
            let ended = self.ended.take().or(denied.map(|at| at + ARRIVAL));
            let is_soon = |at: Option<Timestamp>| at.is_some_and(|at| now < at + ARRIVAL);
            if (is_soon(ended) && !expected) || is_soon(denied) {
                self.doubted_until = Some(now + DOUBT);
            }
        } else if self.is_doubted(now) {
            self.denied = self.denied.or(Some(now));
        } else if drove && self.denied.is_none() {
            self.ended = Some(now);
        }
    }

    /// Nothing was heard for longer than the timeout: a `false` after that begins anew.
    pub(crate) fn lapse(&mut self) {
        (self.denied, self.heard) = (None, false);
    }

    /// It is taken to drive, as if it had said so.
    pub(crate) fn assume(&mut self, drives: bool) {
        self.heard = drives;
    }

    /// Whether the vehicle counts as driving although the last sample is false.
    pub(crate) fn holds(&self, now: Timestamp) -> bool {
        self.denied.is_some_and(|at| now < at + ARRIVAL)
    }

    /// Whether the present `false` tells nothing of a stop, because the signal contradicted itself or was
    /// not heard before it.
    pub(crate) fn is_no_arrival(&self) -> bool {
        !self.heard || self.denied.is_some()
    }

    pub(crate) fn is_doubted(&self, now: Timestamp) -> bool {
        self.doubted_until.is_some_and(|until| now < until)
    }

    /// The time at which time alone changes the belief.
    pub(crate) fn due(&self, now: Timestamp) -> Option<Timestamp> {
        let stands = self.denied.map(|at| at + ARRIVAL);
        [stands, self.doubted_until].into_iter().flatten().filter(|&due| due > now).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Passes samples at milliseconds and compares the belief and the doubt.
    fn check(words: &[(u64, bool, bool, bool)], expected: bool) {
        let mut drive = Drive::default();
        let mut believed = true;
        for &(millis, drives, held, doubted) in words {
            let now = Timestamp::from_millis(millis);
            drive.take(drives, believed, expected, now);
            believed = drives || drive.holds(now);
            assert_eq!((believed, drive.is_doubted(now)), (held, doubted), "at {millis} ms");
        }
    }

    #[test]
    fn an_arrival_is_believed_at_once_and_a_contradicted_one_only_if_it_stands() {
        check(&[(0, true, true, false), (1000, false, false, false), (5000, true, true, false)], false);
        check(&[(1000, false, false, false), (1100, true, true, false), (1200, false, false, false)], true);
        check(
            &[
                (1000, false, false, false),
                (1100, true, true, true),
                (1200, false, true, true),
                (1300, true, true, true),
                (2000, false, true, true),
                (4900, false, true, true),
                (5000, false, false, true),
                (20_000, false, false, false),
                (30_000, true, true, false),
                (40_000, false, false, false),
            ],
            false,
        );
        // A `false` that began in the doubt must last, also when the doubt ends meanwhile.
        let at_the_end = [(1000, false, false, false), (1100, true, true, true), (10_000, false, true, true)];
        check(
            &[&at_the_end[..], &[(12_000, false, true, false), (13_000, false, false, false)]].concat(),
            false,
        );
        // A doubted `false` that lasted is an arrival that can be contradicted again.
        let before = [(5000, false, false, false), (6000, true, true, true), (15_000, false, true, true)];
        let after = [(18_050, true, true, true), (18_100, false, true, true), (21_100, false, false, true)];
        check(&[before, after].concat(), false);
    }
}
