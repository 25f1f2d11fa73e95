//! A module's own state, from what is reported of it to what it counts as (`ENGINE.md` 2):
//! reported, silent, debounced, latched.

use super::model::Policy;
use super::state::State;
use super::time::{Span, Timestamp};
use super::why::Steps;

/// The own state of one module over time. Time is given; deadlines are asked for by [`OwnState::due`].
#[derive(Debug, Clone)]
pub(super) struct OwnState {
    /// What the last report said.
    reported: Option<State>,
    received: Option<Timestamp>,
    silent: bool,
    /// It is judged by the clock: it needs not be heard.
    spoken_for: bool,
    debounce: Debounce,
    latched: bool,
    relevant_since: Option<Timestamp>,
}

impl OwnState {
    pub(super) fn new() -> OwnState {
        OwnState {
            reported: None,
            received: None,
            silent: false,
            spoken_for: false,
            debounce: Debounce::default(),
            latched: false,
            relevant_since: None,
        }
    }

    pub(super) fn received(&self) -> Option<Timestamp> {
        self.received
    }

    /// Whether anything was said of it, by itself or by the clock.
    pub(super) fn known(&self) -> bool {
        self.reported.is_some()
    }

    pub(super) fn silent(&self) -> bool {
        self.silent
    }

    pub(super) fn latched(&self) -> bool {
        self.latched
    }

    /// A report arrived. Returns whether the own state may have changed: a repeated report
    /// from a module that is not silent moves nothing but its age.
    pub(super) fn report(&mut self, state: State, policy: &Policy, now: Timestamp) -> bool {
        let heard = self.heard();
        self.received = Some(now);
        if self.reported == Some(state) && heard {
            return false;
        }
        self.reported = Some(state);
        self.silent = false;
        self.debounce.take(state, policy, now);
        true
    }

    /// What was received is judged otherwise, by time or by what is known of its source: that ends
    /// no silence. By the clock even a module that never heard anything is judged.
    pub(super) fn revise(
        &mut self,
        state: State,
        policy: &Policy,
        by_the_clock: bool,
        now: Timestamp,
    ) -> bool {
        self.advance(policy, now);
        let same = self.reported == Some(state) && self.spoken_for == by_the_clock;
        self.spoken_for = by_the_clock;
        if same {
            return false;
        }
        self.reported = Some(state);
        let judged = if self.heard() { state } else { state.max(policy.stale) };
        self.debounce.take(judged, policy, now);
        true
    }

    /// There is nothing to judge any more: as if it had never reported. What latched stays.
    pub(super) fn forget(&mut self) {
        (self.reported, self.received) = (None, None);
        (self.silent, self.spoken_for) = (false, false);
        self.debounce = Debounce::default();
    }

    fn heard(&self) -> bool {
        (self.received.is_some() || self.spoken_for) && !self.silent
    }

    /// Says whether the module is relevant; the grace of a silent one starts when it becomes so.
    pub(super) fn set_relevant(&mut self, relevant: bool, now: Timestamp) {
        match (relevant, self.relevant_since) {
            (true, None) => self.relevant_since = Some(now),
            (false, Some(_)) => self.relevant_since = None,
            _ => {}
        }
    }

    /// Lets the time up to `now` act: silence first, then debounce and latch at their instants.
    pub(super) fn advance(&mut self, policy: &Policy, now: Timestamp) {
        if let (Some(received), Some(reported), false) = (self.received, self.reported, self.silent)
            && now >= received + policy.timeout
        {
            let since = received + policy.timeout;
            self.settle(policy, since);
            self.silent = true;
            self.debounce.take(reported.max(policy.stale), policy, since);
        }
        self.settle(policy, now);
    }

    /// Whether what it reports is ERROR, latched or not.
    pub(super) fn is_in_error(&self) -> bool {
        self.debounce.state == Some(State::Error)
    }

    /// Forgets a latched ERROR; nothing changes while the module is still in ERROR.
    pub(super) fn reset(&mut self) {
        self.latched &= self.is_in_error();
    }

    /// The own state at `now`, after [`OwnState::advance`] to `now`.
    pub(super) fn state(&self, policy: &Policy, now: Timestamp) -> State {
        if self.latched {
            return State::Error;
        }
        let heard = self.heard();
        let grace = self.relevant_since.is_none_or(|since| now < since + policy.timeout);
        if !heard && grace {
            return State::Unknown;
        }
        self.debounce.state.unwrap_or(policy.stale)
    }

    /// How [`OwnState::state`] came about.
    pub(super) fn steps(&self, policy: &Policy, now: Timestamp) -> Steps {
        let heard = self.heard();
        Steps {
            reported: self.reported,
            judged: self.debounce.input,
            debounced: self.debounce.state,
            latched: self.latched,
            grace: !heard && self.relevant_since.is_none_or(|since| now < since + policy.timeout),
        }
    }

    /// The next instant after `now` at which time alone may change the own state.
    pub(super) fn due(&self, policy: &Policy, now: Timestamp) -> Option<Timestamp> {
        let silence = self.received.filter(|_| !self.silent).map(|at| at + policy.timeout);
        let heard = self.heard();
        let grace = self.relevant_since.filter(|_| !heard).map(|at| at + policy.timeout);
        [silence, grace, self.debounce.due(policy, now), self.latch_due(policy)]
            .into_iter()
            .flatten()
            .filter(|&at| at > now)
            .min()
    }

    /// Runs debounce and latch through their instants up to `now`, in order.
    fn settle(&mut self, policy: &Policy, now: Timestamp) {
        loop {
            let next = [self.debounce.next_step(policy), self.latch_due(policy)].into_iter().flatten().min();
            let Some(at) = next.filter(|&at| at <= now) else { return };
            if self.latch_due(policy).is_some_and(|due| due <= at) {
                self.latched = true;
            }
            self.debounce.step(policy, at);
        }
    }

    fn latch_due(&self, policy: &Policy) -> Option<Timestamp> {
        let since = self.debounce.error_since.filter(|_| !self.latched)?;
        Some(since + policy.latch?)
    }
}

/// Follows what is reported, but rises only to the best state of the last `raise_after` and falls
/// only to the worst of the last `clear_after`. With four states, the end of each state's last
/// appearance is all the history that it needs.
#[derive(Debug, Clone, Default)]
struct Debounce {
    state: Option<State>,
    input: Option<State>,
    /// When each state was last left, by [`State::index`].
    left: [Option<Timestamp>; 5],
    /// Since when the debounced state is ERROR.
    error_since: Option<Timestamp>,
}

impl Debounce {
    fn take(&mut self, input: State, policy: &Policy, now: Timestamp) {
        match self.input.replace(input) {
            None => self.set(input, now),
            Some(before) => {
                if before != input {
                    self.left[before.index()] = Some(now);
                }
                self.step(policy, now);
            }
        }
    }

    fn set(&mut self, state: State, now: Timestamp) {
        if self.state == Some(state) {
            return;
        }
        self.state = Some(state);
        self.error_since = (state == State::Error).then_some(now);
    }

    /// Moves the state to where the windows that end at `now` allow it.
    fn step(&mut self, policy: &Policy, now: Timestamp) {
        let (Some(state), Some(input)) = (self.state, self.input) else { return };
        let seen =
            |&other: &State, window: Span| self.left[other.index()].is_some_and(|left| left + window > now);
        if state < input {
            let best =
                STATES.into_iter().filter(|other| *other < input).find(|s| seen(s, policy.raise_after));
            let best = best.unwrap_or(input);
            if best > state {
                self.set(best, now);
            }
        } else if state > input {
            let above = STATES.into_iter().rev().filter(|other| *other > input);
            let worst = above.into_iter().find(|s| seen(s, policy.clear_after)).unwrap_or(input);
            if worst < state {
                self.set(worst, now);
            }
        }
    }

    /// The earliest instant at which [`Debounce::step`] would change the state.
    fn next_step(&self, policy: &Policy) -> Option<Timestamp> {
        let (state, input) = (self.state?, self.input?);
        let expires = |other: State, window: Span| self.left[other.index()].map(|left| left + window);
        // Rising goes on once every state at or below the present one is out of the window.
        if state < input {
            STATES.into_iter().filter(|&s| s <= state).filter_map(|s| expires(s, policy.raise_after)).max()
        } else if state > input {
            STATES.into_iter().filter(|&s| s >= state).filter_map(|s| expires(s, policy.clear_after)).max()
        } else {
            None
        }
    }

    fn due(&self, policy: &Policy, now: Timestamp) -> Option<Timestamp> {
        self.next_step(policy).filter(|&at| at > now)
    }
}

/// The states that can be reported, best first.
const STATES: [State; 4] = [State::Ok, State::Warning, State::Unknown, State::Error];

#[cfg(test)]
mod tests {
    use super::*;
    use State::*;

    fn policy() -> Policy {
        Policy::default()
    }

    /// Reports at milliseconds, then own states at milliseconds; relevant from the start.
    #[track_caller]
    fn check(policy: &Policy, reports: &[(u64, State)], expect: &[(u64, State)]) {
        let mut module = OwnState::new();
        module.set_relevant(true, Timestamp::ZERO);
        let mut reports = reports.iter().peekable();
        for &(at, state) in expect {
            while let Some(&&(when, report)) = reports.peek().filter(|(when, _)| *when <= at) {
                module.advance(policy, Timestamp::from_millis(when));
                module.report(report, policy, Timestamp::from_millis(when));
                reports.next();
            }
            let now = Timestamp::from_millis(at);
            module.advance(policy, now);
            assert_eq!(module.state(policy, now), state, "at {at} ms");
        }
    }

    #[test]
    fn follows_reports_at_once_without_debounce() {
        check(&policy(), &[(0, Ok), (10, Error), (20, Warning)], &[(0, Ok), (10, Error), (20, Warning)]);
    }

    #[test]
    fn silence_acts_at_its_instant_and_keeps_the_worse() {
        check(&policy(), &[(0, Ok)], &[(1999, Ok), (2000, Unknown)]);
        check(&policy(), &[(0, Error)], &[(1999, Error), (2000, Error)]);
        let stale_warning = Policy { stale: Warning, ..policy() };
        check(&stale_warning, &[(0, Ok), (3000, Ok)], &[(2000, Warning), (2999, Warning), (3000, Ok)]);
    }

    #[test]
    fn never_heard_is_unknown_for_one_timeout_then_stale() {
        let stale_error = Policy { stale: Error, ..policy() };
        check(&stale_error, &[], &[(0, Unknown), (1999, Unknown), (2000, Error)]);
    }

    #[test]
    fn a_silent_module_has_grace_each_time_it_becomes_relevant() {
        let policy = Policy { stale: Error, ..policy() };
        let at = Timestamp::from_millis;
        let mut module = OwnState::new();
        module.report(Ok, &policy, at(0));
        module.advance(&policy, at(5000));
        assert_eq!(module.state(&policy, at(5000)), Unknown, "while it is not relevant");
        module.set_relevant(true, at(5000));
        assert_eq!(module.due(&policy, at(5000)), Some(at(7000)));
        assert_eq!(module.state(&policy, at(6999)), Unknown);
        assert_eq!(module.state(&policy, at(7000)), Error);
    }

    #[test]
    fn rises_to_the_best_and_falls_to_the_worst_of_the_window() {
        let slow =
            Policy { raise_after: Span::from_millis(200), clear_after: Span::from_millis(500), ..policy() };
        check(
            &slow,
            &[(0, Ok), (100, Warning), (200, Error), (600, Ok)],
            &[(0, Ok), (299, Ok), (300, Warning), (399, Warning), (400, Error), (1099, Error), (1100, Ok)],
        );
        // A blink shorter than the window changes nothing.
        check(&slow, &[(0, Ok), (100, Error), (250, Ok)], &[(299, Ok), (300, Ok), (900, Ok)]);
        // The first report is taken at once.
        check(&slow, &[(50, Error)], &[(50, Error)]);
    }

    #[test]
    fn an_error_that_lasted_is_latched_until_reset() {
        let policy = Policy { latch: Some(Span::from_millis(100)), ..policy() };
        let at = Timestamp::from_millis;
        let mut module = OwnState::new();
        module.set_relevant(true, at(0));
        module.report(Error, &policy, at(0));
        module.advance(&policy, at(99));
        assert!(!module.latched());
        module.advance(&policy, at(100));
        module.reset();
        assert!(module.latched() && module.is_in_error());
        module.report(Ok, &policy, at(150));
        module.advance(&policy, at(150));
        assert_eq!(module.state(&policy, at(150)), Error);
        module.reset();
        assert!(!module.latched());
        assert_eq!(module.state(&policy, at(150)), Ok);
    }

    #[test]
    fn deadlines_are_met_whatever_the_steps() {
        let policy = Policy {
            raise_after: Span::from_millis(30),
            clear_after: Span::from_millis(70),
            latch: Some(Span::from_millis(50)),
            ..policy()
        };
        let mut jumping = OwnState::new();
        jumping.report(Ok, &policy, Timestamp::ZERO);
        jumping.report(Error, &policy, Timestamp::from_millis(10));
        let mut stepping = jumping.clone();
        let end = Timestamp::from_millis(3000);
        let mut now = Timestamp::from_millis(10);
        while let Some(next) = stepping.due(&policy, now).filter(|&next| next <= end) {
            now = next;
            stepping.advance(&policy, now);
        }
        jumping.advance(&policy, end);
        assert_eq!(stepping.latched(), jumping.latched());
        assert_eq!(stepping.state(&policy, end), jumping.state(&policy, end));
    }
}
