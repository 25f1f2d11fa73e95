//! When each module failed, from the states that it reported by itself.

use telltale_engine::state::State;

use super::{Fact, WITHIN_MS};

/// A module reported one state from one instant to another, in milliseconds since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stretch {
    pub from_ms: i64,
    pub to_ms: i64,
    /// As if nothing were masked.
    pub own: State,
}

/// The stretches of each module of a model, in the order of the model and of time. Nothing is known of gaps.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct History {
    pub modules: Vec<Vec<Stretch>>,
    /// What else held then.
    pub facts: Vec<Fact>,
}

impl History {
    /// How many modules were well and then were not. Before its first report a module is unknown, which is no failure.
    pub fn failed(&self) -> usize {
        let has_failed = |stretches: &&Vec<Stretch>| {
            stretches.windows(2).any(|pair| pair[0].own == State::Ok && pair[1].own > State::Ok)
        };
        self.modules.iter().filter(has_failed).count()
    }
}

/// A module failed after it was well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Failure {
    pub from_ms: i64,
    pub to_ms: i64,
    /// The state with which it began.
    pub first: State,
    /// ERROR or UNKNOWN was among its states: others may not work for want of it.
    pub blocks: bool,
}

impl Failure {
    /// It lasts so long that everything that waits for it has failed too.
    pub fn is_long(&self) -> bool {
        self.blocks && self.to_ms - self.from_ms >= WITHIN_MS
    }
}

#[derive(Debug, Clone, Default)]
pub(crate) struct Module {
    pub failures: Vec<Failure>,
    /// From when to when it was well.
    well: Vec<(i64, i64)>,
}

pub(crate) fn modules(history: &History) -> Vec<Module> {
    history.modules.iter().map(|stretches| Module::of(stretches)).collect()
}

fn is_bad(state: State) -> bool {
    matches!(state, State::Warning | State::Error | State::Unknown)
}

impl Module {
    fn of(stretches: &[Stretch]) -> Module {
        let mut module = Module::default();
        let mut before: Option<&Stretch> = None;
        for stretch in stretches {
            let joins = before.filter(|before| before.to_ms == stretch.from_ms).map(|before| before.own);
            let blocks = matches!(stretch.own, State::Error | State::Unknown);
            match (joins, stretch.own) {
                (Some(State::Ok), State::Ok) => {
                    module.well.last_mut().expect("it was well").1 = stretch.to_ms;
                }
                (_, State::Ok) => module.well.push((stretch.from_ms, stretch.to_ms)),
                (Some(State::Ok), own) if is_bad(own) => module.failures.push(Failure {
                    from_ms: stretch.from_ms,
                    to_ms: stretch.to_ms,
                    first: own,
                    blocks,
                }),
                // One that was bad from the beginning on is no failure: when it began is not known.
                (Some(state), own) if is_bad(state) && is_bad(own) => {
                    if let Some(failure) = module.failures.last_mut()
                        && failure.to_ms == stretch.from_ms
                    {
                        failure.to_ms = stretch.to_ms;
                        failure.blocks |= blocks;
                    }
                }
                _ => {}
            }
            before = Some(stretch);
        }
        module
    }

    /// Whether it was well all the time.
    pub fn is_well(&self, from_ms: i64, to_ms: i64) -> bool {
        let after = self.well.partition_point(|(from, _)| *from <= from_ms);
        after > 0 && self.well[after - 1].1 >= to_ms
    }

    /// Its failures that begin then or later.
    pub fn since(&self, from_ms: i64) -> &[Failure] {
        &self.failures[self.failures.partition_point(|failure| failure.from_ms < from_ms)..]
    }

    /// Its first failure that begins within this time.
    pub fn failure(&self, from_ms: i64, to_ms: i64) -> Option<&Failure> {
        self.since(from_ms).first().filter(|failure| failure.from_ms <= to_ms)
    }

    /// The share of instants near which a failure begins, from `before` to `after` the instant, among those and the ones
    /// near which the module is well all the time.
    pub fn chance(&self, before_ms: i64, after_ms: i64) -> f64 {
        let mut covered = 0;
        let mut until = i64::MIN;
        for failure in &self.failures {
            let (from, to) = (failure.from_ms - after_ms, failure.from_ms + before_ms);
            covered += (to - from.max(until)).max(0);
            until = to;
        }
        let well = self.well.iter().map(|(from, to)| (to - from - before_ms - after_ms).max(0)).sum::<i64>();
        covered as f64 / (covered + well).max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stretches(all: &[(i64, i64, State)]) -> Vec<Stretch> {
        all.iter().map(|&(from_ms, to_ms, own)| Stretch { from_ms, to_ms, own }).collect()
    }

    #[test]
    fn a_module_that_was_never_well_has_not_failed() {
        use State::{Error, Ignore, Ok, Unknown, Warning};
        for (states, failed) in [
            (&[][..], 0),
            (&[Unknown], 0),
            (&[Unknown, Ok], 0),
            (&[Unknown, Error, Ok, Ignore], 0),
            (&[Ok, Ignore, Error], 0),
            (&[Unknown, Ok, Warning], 1),
            (&[Ok, Unknown, Ok, Error], 1),
        ] {
            let all: Vec<_> = (0..).zip(states).map(|(from, own)| (from, from + 1, *own)).collect();
            let modules = vec![stretches(&all), Vec::new()];
            assert_eq!(History { modules, facts: Vec::new() }.failed(), failed, "{states:?}");
        }
    }

    #[test]
    fn a_failure_begins_when_the_module_is_no_longer_well() {
        use State::{Error, Ignore, Ok, Unknown, Warning};
        let module = Module::of(&stretches(&[
            (0, 10, Unknown),
            (10, 50, Ok),
            (50, 60, Warning),
            (60, 6_000, Error),
            (6_000, 7_000, Ok),
            (7_000, 8_000, Ignore),
            (8_000, 9_000, Error),
            (9_500, 9_600, Ok),
            (9_700, 9_800, Error),
        ]));
        assert_eq!(
            module.failures,
            [Failure { from_ms: 50, to_ms: 6_000, first: Warning, blocks: true }],
            "a failure at the beginning, after IGNORE or after a gap does not count"
        );
        assert!(module.failures[0].is_long());
        assert!(module.is_well(10, 50) && !module.is_well(5, 50) && !module.is_well(6_500, 7_500));
        assert_eq!(module.failure(40, 50).map(|it| it.from_ms), Some(50));
        assert_eq!(module.failure(51, 9_000), None);
    }

    #[test]
    fn chance_is_the_share_of_time_near_a_beginning() {
        let module = Module::of(&stretches(&[
            (0, 100, State::Ok),
            (100, 110, State::Error),
            (110, 200, State::Ok),
            (200, 220, State::Error),
            (220, 1_000, State::Ok),
        ]));
        // From 50 to 110 and from 150 to 210; well from 10 to 50, from 120 to 150, and from 230 to 950.
        assert!((module.chance(10, 50) - 120.0 / 910.0).abs() < 1e-9, "{}", module.chance(10, 50));
        assert_eq!(module.chance(10, 1_000), 1.0);
    }
}
