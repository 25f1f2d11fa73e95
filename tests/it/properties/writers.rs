//! The state of a status with several writers, compared with the definition: the worst of their last
//! reports, of the writers that may publish it.

use std::collections::BTreeMap;
use std::sync::Arc;

use proptest::prelude::*;
use telltale::engine::Engine;
use telltale::engine::input::{Input, NodeOf, OperatorAction, WriterId, WriterList};
use telltale::engine::model::{Model, ModuleId, Parts, Policy};
use telltale::engine::state::State;
use telltale::engine::time::Timestamp;

use super::cases::{self, Choices, WRITERS};

/// The same history with one writer.
pub fn said_by_one(history: Vec<(Timestamp, Input)>) -> Vec<(Timestamp, Input)> {
    let one = |input| match input {
        Input::Diagnostics(array) => Input::Diagnostics(array.said_by(WriterId::default())),
        other => other,
    };
    history.into_iter().map(|(at, input)| (at, one(input))).collect()
}

/// No module accepts its status only from certain nodes, also no discovered one: else its KeyValues wait for
/// their node, for every module that watches them.
pub fn admit_all(parts: &mut Parts) {
    each_policy(parts, |policy| policy.writers = None);
}

fn each_policy(parts: &mut Parts, change: impl Fn(&mut Policy)) {
    let filters = parts.groups.iter_mut().flat_map(|group| &mut group.filters);
    let of_filters = filters.filter_map(|filter| filter.policy.as_mut());
    let of_modules = parts.modules.iter_mut().map(|module| &mut module.policy);
    of_filters.chain(of_modules).chain([&mut parts.discovered]).for_each(change);
}

/// The reports for one name.
type Words = BTreeMap<WriterId, (State, Timestamp)>;

#[derive(Default)]
struct Reference {
    list: WriterList,
    words: BTreeMap<String, Words>,
    reported: BTreeMap<ModuleId, State>,
}

fn admitted(policy: &Policy, list: &WriterList, writer: WriterId, state: State) -> bool {
    let Some(writers) = &policy.writers else { return true };
    match list.writers.get(&writer) {
        Some(NodeOf::Named(name)) => writers.contains(name),
        Some(NodeOf::Unannounced) => false,
        Some(NodeOf::Pending) | None => state > State::Ok,
    }
}

impl Reference {
    fn take(&mut self, model: &Model, input: &Input, now: Timestamp) {
        match input {
            Input::Writers(list) => {
                let before = std::mem::replace(&mut self.list, (**list).clone());
                if !list.complete {
                    for (writer, node) in before.writers {
                        let known = self.list.writers.entry(writer).or_insert(NodeOf::Pending);
                        if *known == NodeOf::Pending {
                            *known = node;
                        }
                    }
                }
            }
            Input::Diagnostics(array) => {
                let mut said: BTreeMap<&str, State> = BTreeMap::new();
                for status in array.iter() {
                    let state = said.entry(status.name()).or_insert(status.state());
                    *state = (*state).max(status.state());
                }
                for (name, state) in said {
                    self.word(model, name, array.writer(), state, now);
                }
            }
            _ => {}
        }
    }

    fn word(&mut self, model: &Model, name: &str, writer: WriterId, state: State, now: Timestamp) {
        let list = &self.list;
        let declared = (0..).map(ModuleId).zip(&model.modules);
        let fed = declared.filter(|(_, it)| it.monitor.status().is_some_and(|status| **status == *name));
        let fed: Vec<_> = fed.filter(|(_, it)| admitted(&it.policy, list, writer, state)).collect();
        if fed.is_empty() {
            return;
        }
        let words = self.words.entry(name.to_owned()).or_default();
        let left = |other: &WriterId, at: Timestamp| {
            list.complete && at < list.as_of && !list.writers.contains_key(other)
        };
        words.retain(|other, (_, at)| *other == writer || !left(other, *at));
        words.insert(writer, (state, now));
        for (id, module) in fed {
            let counts = |(other, (state, at)): (&WriterId, &(State, Timestamp))| {
                let fresh = *at + module.policy.timeout > now;
                (fresh && admitted(&module.policy, list, *other, *state)).then_some(*state)
            };
            self.reported.extend(words.iter().filter_map(counts).max().map(|worst| (id, worst)));
        }
    }
}

proptest! {
    #![proptest_config(super::config())]

    #[test]
    fn the_worst_of_all_writers_counts(numbers in super::numbers()) {
        let mut choices = Choices::new(&numbers);
        let model = cases::model_that(&mut choices, |parts| {
            parts.modules.iter_mut().for_each(|module| module.policy.forget_after = None);
        });
        let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
        let mut reference = Reference::default();
        for (at, input) in cases::history(&mut choices) {
            engine.handle(&input, at);
            reference.take(&model, &input, at);
            let snapshot = engine.snapshot();
            for (id, module) in (0..).map(ModuleId).zip(&model.modules) {
                if module.monitor.status().is_some() {
                    let reported = snapshot.module(id).1.steps.reported;
                    let said = reference.reported.get(&id).map(|&state| module.policy.counts_as.of(state));
                    prop_assert_eq!(reported, said, "{} at {:?}", module.id, at);
                }
            }
        }
    }

    #[test]
    fn a_stranger_changes_nothing(numbers in super::numbers()) {
        let mut choices = Choices::new(&numbers);
        let model = cases::model_that(&mut choices, |parts| {
            each_policy(parts, |policy| policy.writers = Some(Arc::from([WRITERS[0].into()])));
        });
        let named = |name: &str| NodeOf::Named(name.into());
        let (driver, stranger) = (cases::writer(2), cases::writer(3));
        let writers = [(driver, named(WRITERS[0])), (stranger, named("/stranger"))];
        let list = WriterList { complete: true, writers: writers.into(), ..WriterList::default() };
        let (mut alone, mut disturbed) =
            (Engine::new(model.clone(), Timestamp::ZERO), Engine::new(model.clone(), Timestamp::ZERO));
        for engine in [&mut alone, &mut disturbed] {
            engine.handle(&Input::Writers(Arc::new(list.clone())), Timestamp::ZERO);
        }
        for (index, (at, input)) in cases::history(&mut choices).into_iter().enumerate() {
            let says = |input: &Input, writer| match input {
                Input::Diagnostics(array) => Input::Diagnostics(array.clone().said_by(writer)),
                // The WARNING of `telltale` refuses a clearance.
                Input::Writers(_)
                | Input::Operator(OperatorAction::AskClearance { .. } | OperatorAction::Clear { .. }) => {
                    Input::Tick
                }
                other => other.clone(),
            };
            let is_strange = matches!(input, Input::Diagnostics(_)) && numbers[index % numbers.len()] % 2 == 1;
            if is_strange {
                disturbed.handle(&says(&input, stranger), at);
                alone.handle(&Input::Tick, at);
            } else {
                alone.handle(&says(&input, driver), at);
                disturbed.handle(&says(&input, driver), at);
            }
            let of_vehicle = |engine: &mut Engine| {
                let told = super::told(&engine.snapshot()).into_iter();
                told.filter(|line| !line.starts_with("telltale")).collect::<Vec<_>>()
            };
            prop_assert_eq!(of_vehicle(&mut alone), of_vehicle(&mut disturbed), "at {:?}", at);
        }
    }
}
