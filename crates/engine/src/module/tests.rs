//! Tests of a module's own state: silence, debounce, grace, latch.

use super::*;
use State::*;

fn policy() -> Policy {
    Policy::default()
}

/// Reports at milliseconds, then own states at milliseconds; relevant from the start.
#[track_caller]
fn check(policy: &Policy, reports: &[(u64, State)], expect: &[(u64, State)]) {
    let mut module = OwnState::new(false, Timestamp::ZERO);
    module.set_relevant(true, policy, Timestamp::ZERO);
    let mut reports = reports.iter().peekable();
    for &(at, state) in expect {
        while let Some(&&(when, report)) = reports.peek().filter(|(when, _)| *when <= at) {
            module.advance(policy, Timestamp::from_millis(when));
            module.report(report, policy, Span::ZERO, Timestamp::from_millis(when));
            reports.next();
        }
        let now = Timestamp::from_millis(at);
        module.advance(policy, now);
        assert_eq!(module.state(policy), state, "at {at} ms");
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
    let mut module = OwnState::new(false, Timestamp::ZERO);
    module.report(Ok, &policy, Span::ZERO, at(0));
    module.advance(&policy, at(5000));
    assert_eq!(module.state(&policy), Unknown, "while it is not relevant");
    module.set_relevant(true, &policy, at(5000));
    assert_eq!(module.due(&policy, at(5000)), Some(at(7000)));
    module.advance(&policy, at(6999));
    assert_eq!(module.state(&policy), Unknown);
    module.advance(&policy, at(7000));
    assert_eq!(module.state(&policy), Error);
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
    let mut module = OwnState::new(false, Timestamp::ZERO);
    module.set_relevant(true, &policy, at(0));
    module.report(Error, &policy, Span::ZERO, at(0));
    module.advance(&policy, at(99));
    assert!(!module.latched());
    module.advance(&policy, at(100));
    module.reset(&policy);
    assert!(module.latched() && module.is_in_error(&policy));
    module.report(Ok, &policy, Span::ZERO, at(150));
    module.advance(&policy, at(150));
    assert_eq!(module.state(&policy), Error);
    module.reset(&policy);
    assert!(!module.latched());
    assert_eq!(module.state(&policy), Ok);
}

#[test]
fn deadlines_are_met_whatever_the_steps() {
    let policy = Policy {
        raise_after: Span::from_millis(30),
        clear_after: Span::from_millis(70),
        latch: Some(Span::from_millis(50)),
        ..policy()
    };
    let mut jumping = OwnState::new(false, Timestamp::ZERO);
    jumping.report(Ok, &policy, Span::ZERO, Timestamp::ZERO);
    jumping.report(Error, &policy, Span::ZERO, Timestamp::from_millis(10));
    let mut stepping = jumping.clone();
    let end = Timestamp::from_millis(3000);
    let mut now = Timestamp::from_millis(10);
    while let Some(next) = stepping.due(&policy, now).filter(|&next| next <= end) {
        now = next;
        stepping.advance(&policy, now);
    }
    jumping.advance(&policy, end);
    assert_eq!(stepping.latched(), jumping.latched());
    assert_eq!(stepping.state(&policy), jumping.state(&policy));
}

fn silent_error() -> Policy {
    Policy { timeout: Span::from_secs(1), stale: Error, latch: Some(Span::from_millis(500)), ..policy() }
}

const fn at(millis: u64) -> Timestamp {
    Timestamp::from_millis(millis)
}

#[test]
fn a_silence_latches_only_once_its_grace_is_over() {
    let policy = silent_error();
    let mut module = OwnState::new(false, Timestamp::ZERO);
    module.report(Ok, &policy, Span::ZERO, at(0));
    module.advance(&policy, at(9000));
    assert_eq!((module.latched(), module.state(&policy)), (false, Unknown), "not relevant");
    module.set_relevant(true, &policy, at(9000));
    assert_eq!(module.due(&policy, at(9000)), Some(at(10_000)));
    module.advance(&policy, at(10_000));
    assert_eq!((module.latched(), module.state(&policy)), (false, Error));
    assert_eq!(module.due(&policy, at(10_000)), Some(at(10_500)));
    let mut heard = module.clone();
    heard.report(Ok, &policy, Span::ZERO, at(10_400));
    heard.advance(&policy, at(20_000));
    heard.set_relevant(false, &policy, at(20_000));
    assert_eq!((heard.latched(), heard.state(&policy)), (true, Error), "silent again, and out of its grace");
    module.advance(&policy, at(10_500));
    assert!(module.latched());
    // In one leap it comes to the same.
    let mut leaping = OwnState::new(false, Timestamp::ZERO);
    leaping.report(Ok, &policy, Span::ZERO, at(0));
    leaping.set_relevant(true, &policy, at(9000));
    leaping.advance(&policy, at(10_499));
    assert!(!leaping.latched());
    leaping.advance(&policy, at(30_000));
    assert!(leaping.latched());
}

#[test]
fn an_error_that_is_heard_latches_relevant_or_not_and_in_the_instant_in_which_it_ends() {
    let policy = silent_error();
    let mut module = OwnState::new(false, Timestamp::ZERO);
    module.report(Error, &policy, Span::ZERO, at(0));
    let mut short = module.clone();
    module.advance(&policy, at(500));
    assert!(module.latched());
    short.advance(&policy, at(499));
    short.report(Ok, &policy, Span::ZERO, at(499));
    short.advance(&policy, at(5000));
    assert!(!short.latched());
    // It becomes irrelevant, or silent in its grace, in the instant in which it has lasted long enough.
    let lasting = Policy { latch: Some(Span::from_secs(1)), ..policy };
    let mut module = OwnState::new(false, Timestamp::ZERO);
    module.report(Error, &lasting, Span::ZERO, at(0));
    module.advance(&lasting, at(1000));
    assert!(module.latched() && module.silent());
    let longer = Policy { latch: Some(Span::from_millis(1001)), ..lasting };
    let mut module = OwnState::new(false, Timestamp::ZERO);
    module.report(Error, &longer, Span::ZERO, at(0));
    module.advance(&longer, at(9000));
    assert!(!module.latched(), "then its silence is in its grace");
}

#[test]
fn what_never_reported_does_not_latch_and_a_reset_judges_after_the_grace() {
    let policy = silent_error();
    let mut module = OwnState::new(false, Timestamp::ZERO);
    module.set_relevant(true, &policy, at(0));
    module.advance(&policy, at(60_000));
    assert_eq!((module.latched(), module.state(&policy)), (false, Error));
    module.report(Error, &policy, Span::ZERO, at(60_000));
    module.advance(&policy, at(61_500));
    assert!(module.latched() && module.is_in_error(&policy), "a silence out of its grace refuses it");
    module.reset(&policy);
    assert!(module.latched());
    module.set_relevant(false, &policy, at(62_000));
    assert!(module.latched() && !module.is_in_error(&policy) && module.steps(&policy).latched);
    module.reset(&policy);
    assert_eq!((module.latched(), module.state(&policy)), (false, Unknown));
}

#[test]
fn what_is_silent_for_too_long_is_as_if_it_had_never_reported() {
    let policy = Policy { forget_after: Some(Span::from_secs(5)), ..policy() };
    check(&policy, &[(0, Error)], &[(4999, Error), (5000, Unknown), (9000, Unknown)]);
    let stale_warning = Policy { stale: Warning, ..policy.clone() };
    check(&stale_warning, &[(0, Error), (9000, Ok)], &[(4999, Error), (5000, Warning), (9000, Ok)]);
    let latching = Policy { latch: Some(Span::from_secs(1)), ..policy.clone() };
    check(&latching, &[(0, Error)], &[(9000, Error)]);
    let mut module = OwnState::new(false, Timestamp::ZERO);
    module.report(Error, &policy, Span::ZERO, at(0));
    module.advance(&policy, at(2000));
    assert_eq!(module.due(&policy, at(2000)), Some(at(5000)));
    assert!(!module.lapsed(&policy, at(60_000)), "it is declared");
    let made = OwnState::new(true, at(1000));
    assert!(!made.lapsed(&policy, at(5999)) && made.lapsed(&policy, at(6000)), "never heard");
}

#[test]
fn a_silence_in_its_grace_holds_nothing_up() {
    let policy = Policy { stale: Error, clear_after: Span::from_millis(500), ..policy() };
    let at = Timestamp::from_millis;
    let mut module = OwnState::new(false, Timestamp::ZERO);
    module.report(Ok, &policy, Span::ZERO, at(0));
    for ms in [3000, 4000] {
        module.advance(&policy, at(ms));
    }
    module.set_relevant(true, &policy, at(4000));
    module.report(Ok, &policy, Span::ZERO, at(4100));
    assert_eq!(module.state(&policy), Ok);
    // A silence that counted does.
    module.advance(&policy, at(6200));
    assert_eq!(module.state(&policy), Error);
    module.report(Ok, &policy, Span::ZERO, at(6300));
    assert_eq!(module.state(&policy), Error);
    module.advance(&policy, at(6800));
    assert_eq!(module.state(&policy), Ok);
}

/// Every report is judged as if the one before it had been repeated until then.
#[test]
fn a_silence_in_its_grace_is_as_if_the_last_report_had_been_repeated() {
    use proptest::prelude::*;
    let span = || (0_u64..5).prop_map(|step| Span::from_millis(step * 700));
    let state = || prop::sample::select(vec![Ok, Warning, Unknown, Error]);
    let reports = prop::collection::vec((0_u64..4, state()), 1..30);
    proptest!(|(raise_after in span(), clear_after in span(), reports in reports)| {
        let silent = Policy { timeout: Span::from_secs(1), stale: Error, raise_after, clear_after, ..policy() };
        let heard = Policy { timeout: Span::from_secs(10_000), ..silent.clone() };
        // Not relevant: every silence is within its grace.
        let (mut module, mut repeating) = (OwnState::new(false, Timestamp::ZERO), OwnState::new(false, Timestamp::ZERO));
        let mut now = Timestamp::ZERO;
        for (steps, report) in reports {
            now = now + Span::from_millis(steps * 600);
            for (it, policy) in [(&mut module, &silent), (&mut repeating, &heard)] {
                it.advance(policy, now);
                if !it.repeats(report, Span::ZERO, now) {
                    it.report(report, policy, Span::ZERO, now);
                }
            }
            prop_assert_eq!(module.state(&silent), repeating.state(&heard), "at {:?}", now);
        }
    });
}

#[test]
fn what_counted_of_a_silence_leaves_its_trace() {
    let policy = Policy { stale: Error, clear_after: Span::from_secs(3), ..policy() };
    let mut module = OwnState::new(false, Timestamp::ZERO);
    module.set_relevant(true, &policy, at(0));
    module.report(Ok, &policy, Span::ZERO, at(0));
    module.advance(&policy, at(4000));
    assert_eq!(module.state(&policy), Error, "silent out of its grace");
    // From now on it is excused, and counts as repeating its OK.
    module.set_relevant(false, &policy, at(4000));
    module.advance(&policy, at(6000));
    module.report(Ok, &policy, Span::ZERO, at(6000));
    assert_eq!(module.state(&policy), Error);
    module.advance(&policy, at(7000));
    assert_eq!(module.state(&policy), Ok, "three seconds after it last counted");
}
