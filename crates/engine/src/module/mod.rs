//! A module's own state, from its reports to the state that counts: reported, silent, debounced, latched.

use super::model::Policy;
use super::model::lateness::Notice;
use super::snapshot::Steps;
use super::state::State;
use super::time::{Span, Timestamp};
use onset::Onset;
use serde::{Deserialize, Serialize};

/// The own state of one module over time. The caller passes the time and asks [`OwnState::due`] for deadlines.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct OwnState {
    /// The state of the last report.
    reported: Option<State>,
    received: Option<Timestamp>,
    silent: bool,
    /// A monitor judges it by the clock: it needs no reports.
    judged_by_clock: bool,
    debounce: Debounce,
    /// While it is silent within its grace: the debounce as if its last report were being repeated.
    repeated: Option<Box<Debounce>>,
    /// It still has time to report: its silence does not count yet.
    grace: bool,
    /// Since when it counts as ERROR by its reports.
    error_since: Option<Timestamp>,
    latched: bool,
    /// DDS went down after its last report.
    cut_off: bool,
    relevant_since: Option<Timestamp>,
    /// For a discovered module: the time from which its silence counts towards leaving.
    made: Option<Timestamp>,
    pub(super) onset: Onset,
}

impl OwnState {
    /// `discovered`: a status made it.
    pub(super) fn new(discovered: bool, now: Timestamp) -> OwnState {
        OwnState {
            made: discovered.then_some(now),
            onset: Onset::new(now),
            grace: true,
            error_since: None,
            reported: None,
            received: None,
            silent: false,
            judged_by_clock: false,
            debounce: Debounce::default(),
            repeated: None,
            latched: false,
            cut_off: false,
            relevant_since: None,
        }
    }

    pub(super) fn received(&self) -> Option<Timestamp> {
        self.received
    }

    /// Whether there is any judgement of it, by a report or by the clock.
    pub(super) fn known(&self) -> bool {
        self.reported.is_some()
    }

    pub(super) fn silent(&self) -> bool {
        self.silent
    }

    pub(super) fn latched(&self) -> bool {
        self.latched
    }

    /// Whether it has no report, or is silent, and still has time.
    pub(super) fn in_grace(&self) -> bool {
        self.grace
    }

    /// Whether a discovered module was silent for so long that it leaves.
    pub(super) fn lapsed(&self, policy: &Policy, now: Timestamp) -> bool {
        self.made.is_some() && !self.latched && self.lapse_due(policy).is_some_and(|due| due <= now)
    }

    /// Whether a report repeats the last one of a module that is not silent: then only its age changes. All
    /// other reports are for [`OwnState::report`].
    pub(super) fn repeats(&mut self, state: State, late: Span, now: Timestamp) -> bool {
        let repeats = self.reported == Some(state) && self.heard() && !self.cut_off;
        if repeats {
            self.received = self.received.max(Some(now - late));
        }
        repeats
    }

    /// Takes a report that is not a repetition. One that came so late that the timeout is over ends no silence.
    pub(super) fn report(&mut self, state: State, policy: &Policy, late: Span, now: Timestamp) {
        self.cut_off = false;
        let at = self.received.max(Some(now - late.min(policy.timeout))).unwrap_or(now);
        // Time begins with the program, so `at` may be later than the report.
        let heard = !self.silent && self.received.is_some_and(|before| now < before + policy.timeout);
        let is_over = now >= at + policy.timeout || late >= policy.timeout && !heard;
        (self.reported, self.received, self.silent) = (Some(state), Some(at), is_over);
        if self.silent {
            self.debounce.take(state.max(policy.stale), policy, now);
        } else {
            if let Some(mut repeated) = self.repeated.take() {
                repeated.step(policy, now);
                self.debounce = *repeated;
            }
            self.debounce.take(state, policy, now);
        }
        self.judge(policy, now);
    }

    /// Takes a new judgement of the received values, by time or by discovery: it ends no silence. By the clock
    /// even a module without reports is judged.
    pub(super) fn revise(
        &mut self,
        state: State,
        policy: &Policy,
        by_the_clock: bool,
        now: Timestamp,
    ) -> bool {
        self.advance(policy, now);
        let same = self.reported == Some(state) && self.judged_by_clock == by_the_clock;
        self.judged_by_clock = by_the_clock;
        if same {
            return false;
        }
        self.reported = Some(state);
        let judged = if self.heard() { state } else { state.max(policy.stale) };
        self.debounce.take(judged, policy, now);
        if let Some(repeated) = &mut self.repeated {
            repeated.take(state, policy, now);
        }
        self.judge(policy, now);
        true
    }

    /// There is nothing to judge any more, as before the first report. A latched ERROR stays.
    pub(super) fn forget(&mut self, policy: &Policy, now: Timestamp) {
        (self.reported, self.received) = (None, None);
        (self.silent, self.judged_by_clock, self.cut_off) = (false, false, false);
        (self.debounce, self.repeated) = (Debounce::default(), None);
        self.judge(policy, now);
    }

    /// DDS is down: UNKNOWN at once and until the next report, unless the module is in ERROR. Returns whether
    /// that changed anything.
    pub(super) fn cut_off(&mut self) -> bool {
        let is_news = self.heard() && !self.cut_off;
        self.cut_off |= is_news;
        is_news
    }

    fn heard(&self) -> bool {
        (self.received.is_some() || self.judged_by_clock) && !self.silent
    }

    /// Sets whether the module is relevant, after [`OwnState::advance`] to `now`; the grace period of a silent
    /// module starts when it becomes relevant.
    pub(super) fn set_relevant(&mut self, relevant: bool, policy: &Policy, now: Timestamp) {
        match (relevant, self.relevant_since) {
            (true, None) => self.relevant_since = Some(now),
            (false, Some(_)) => self.relevant_since = None,
            _ => return,
        }
        self.judge(policy, now);
        if relevant {
            self.onset.became_relevant(self.state(policy));
        }
    }

    pub(super) fn relevant_since(&self) -> Option<Timestamp> {
        self.relevant_since
    }

    /// Its measurement begins anew: it has time to report as if it had just become relevant.
    pub(super) fn give_time(&mut self, policy: &Policy, now: Timestamp) {
        self.relevant_since = self.relevant_since.map(|_| now);
        self.judge(policy, now);
    }

    /// Advances to `now`: silence first, then debounce, grace and latch at their instants, and finally the
    /// expiry of old reports.
    pub(super) fn advance(&mut self, policy: &Policy, now: Timestamp) {
        if let (Some(received), Some(reported), false) = (self.received, self.reported, self.silent)
            && now >= received + policy.timeout
        {
            let since = received + policy.timeout;
            self.settle(policy, since);
            self.silent = true;
            self.repeated = self.is_given(policy, since).then(|| Box::new(self.debounce.clone()));
            self.debounce.take(reported.max(policy.stale), policy, since);
            self.judge_before(policy, since, now);
        }
        if let Some(due) = self.lapse_due(policy).filter(|&due| self.received.is_some() && due <= now) {
            self.settle(policy, due);
            self.forget(policy, due);
        }
        self.settle(policy, now);
    }

    /// Whether the module counts as ERROR, latched or not.
    pub(super) fn is_in_error(&self, policy: &Policy) -> bool {
        self.judged(policy) == State::Error
    }

    /// Latches an ERROR of an earlier run of the program, if the module still has a latch.
    pub(super) fn latch_again(&mut self, policy: &Policy) {
        self.latched |= policy.latch.is_some();
    }

    /// Resets a latched ERROR; without effect while the module is still in ERROR.
    pub(super) fn reset(&mut self, policy: &Policy) {
        self.latched &= self.is_in_error(policy);
    }

    /// The own state, after [`OwnState::advance`].
    pub(super) fn state(&self, policy: &Policy) -> State {
        if self.latched { State::Error } else { self.judged(policy) }
    }

    /// The own state, and whether the module is silent.
    pub(super) fn notice(&self, policy: &Policy) -> Notice {
        Notice { state: self.state(policy), silent: self.silent }
    }

    /// The state after debounce and grace.
    fn judged(&self, policy: &Policy) -> State {
        let state = if self.grace { State::Unknown } else { self.debounce.state.unwrap_or(policy.stale) };
        if self.cut_off { state.max(State::Unknown) } else { state }
    }

    /// The intermediate steps of [`OwnState::state`].
    pub(super) fn steps(&self, policy: &Policy) -> Steps {
        Steps {
            reported: self.reported,
            judged: self.debounce.input,
            debounced: self.debounce.state,
            latched: self.latched,
            grace: self.grace,
            in_error: self.is_in_error(policy),
        }
    }

    /// The next instant after `now` at which time alone may change the own state.
    pub(super) fn due(&self, policy: &Policy, now: Timestamp) -> Option<Timestamp> {
        let silence = self.received.filter(|_| !self.silent).map(|at| at + policy.timeout);
        let debounce = self.debounce.next_step(policy);
        [silence, debounce, self.grace_end(policy), self.latch_due(policy), self.lapse_due(policy)]
            .into_iter()
            .flatten()
            .filter(|&at| at > now)
            .min()
    }

    /// Runs debounce, grace and latch through their instants up to `now`, in order. An ERROR that ends at the
    /// instant at which it has lasted long enough latches.
    fn settle(&mut self, policy: &Policy, now: Timestamp) {
        loop {
            let steps = [self.debounce.next_step(policy), self.grace_end(policy), self.latch_due(policy)];
            let Some(at) = steps.into_iter().flatten().min().filter(|&at| at <= now) else { return };
            if self.latch_due(policy).is_some_and(|due| due <= at) {
                self.latched = true;
            }
            self.debounce.step(policy, at);
            self.judge_before(policy, at, now);
        }
    }

    /// Judges at an instant on the way to the present one. There only the last of several states counts for the
    /// beginning of a fault: the one that is shown.
    fn judge_before(&mut self, policy: &Policy, at: Timestamp, now: Timestamp) {
        self.judge(policy, at);
        if at < now {
            self.onset.follow(self.notice(policy), at);
        }
    }

    /// Follows the judged state at every instant at which it changes, for latch and reset.
    fn judge(&mut self, policy: &Policy, at: Timestamp) {
        self.grace = !self.heard() && self.is_given(policy, at);
        if !(self.silent && self.grace) {
            self.repeated = None;
        } else if let (None, Some(reported)) = (&self.repeated, self.reported) {
            // The silence counted until now.
            let mut repeated = self.debounce.clone();
            repeated.take(reported, policy, at);
            self.repeated = Some(Box::new(repeated));
        }
        let in_error = self.reported.is_some() && self.judged(policy) == State::Error;
        self.error_since = self.error_since.or(Some(at)).filter(|_| in_error);
    }

    /// Whether a module that is not heard still has time at this instant.
    fn is_given(&self, policy: &Policy, at: Timestamp) -> bool {
        self.relevant_since.is_none_or(|since| at < since + policy.timeout)
    }

    /// The end of the grace period.
    fn grace_end(&self, policy: &Policy) -> Option<Timestamp> {
        Some(self.relevant_since.filter(|_| self.grace)? + policy.timeout)
    }

    fn latch_due(&self, policy: &Policy) -> Option<Timestamp> {
        let since = self.error_since.filter(|_| !self.latched)?;
        Some(since + policy.latch?)
    }

    /// The time at which the last report expires.
    fn lapse_due(&self, policy: &Policy) -> Option<Timestamp> {
        Some(self.received.or(self.made)? + policy.forget_after?)
    }
}

/// Follows the reported state, but rises only to the best state of the last `raise_after` and falls only to the
/// worst of the last `clear_after`. With four states, the end of each state's last appearance is all the
/// history that it needs.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct Debounce {
    state: Option<State>,
    input: Option<State>,
    /// When each state was last left, by [`State::index`].
    left: [Option<Timestamp>; 5],
}

impl Debounce {
    fn take(&mut self, input: State, policy: &Policy, now: Timestamp) {
        match self.input.replace(input) {
            None => self.state = Some(input),
            Some(before) => {
                if before != input {
                    self.left[before.index()] = Some(now);
                }
                self.step(policy, now);
            }
        }
    }

    /// Moves the state as far as the windows that end at `now` allow.
    fn step(&mut self, policy: &Policy, now: Timestamp) {
        let (Some(state), Some(input)) = (self.state, self.input) else { return };
        let seen =
            |&other: &State, window: Span| self.left[other.index()].is_some_and(|left| left + window > now);
        if state < input {
            let best =
                STATES.into_iter().filter(|other| *other < input).find(|s| seen(s, policy.raise_after));
            let best = best.unwrap_or(input);
            if best > state {
                self.state = Some(best);
            }
        } else if state > input {
            let above = STATES.into_iter().rev().filter(|other| *other > input);
            let worst = above.into_iter().find(|s| seen(s, policy.clear_after)).unwrap_or(input);
            if worst < state {
                self.state = Some(worst);
            }
        }
    }

    /// The earliest instant at which [`Debounce::step`] would change the state.
    fn next_step(&self, policy: &Policy) -> Option<Timestamp> {
        let (state, input) = (self.state?, self.input?);
        let expires = |other: State, window: Span| self.left[other.index()].map(|left| left + window);
        // A rise continues once every state at or below the present one has left the window.
        if state < input {
            STATES.into_iter().filter(|&s| s <= state).filter_map(|s| expires(s, policy.raise_after)).max()
        } else if state > input {
            STATES.into_iter().filter(|&s| s >= state).filter_map(|s| expires(s, policy.clear_after)).max()
        } else {
            None
        }
    }
}

/// The possible reported states, best first.
const STATES: [State; 4] = [State::Ok, State::Warning, State::Unknown, State::Error];

pub(super) mod budget;
pub(super) mod contradictions;
pub(super) mod names;
pub(super) mod onset;
pub(super) mod overflow;
pub mod report;
pub mod system;
#[cfg(test)]
mod tests;
pub mod writers;
