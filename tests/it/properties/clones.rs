//! A clone of the engine that gets the same inputs reaches the same states, and the original does not
//! notice. Replay and keyframes will rest on this.

use proptest::prelude::*;
use telltale::engine::Engine;
use telltale::engine::event::Event;
use telltale::engine::input::Input;
use telltale::engine::snapshot::Snapshot;
use telltale::engine::time::Timestamp;

use super::cases::{Choices, history, model};
use super::{config, numbers};

/// Feeds the inputs, each after the deadlines before it. Returns the snapshot after each, and the events.
fn feed(engine: &mut Engine, inputs: &[(Timestamp, Input)]) -> (Vec<Snapshot>, Vec<Event>) {
    let mut shown = Vec::new();
    for (at, input) in inputs {
        while let Some(due) = engine.next_deadline().filter(|due| due < at) {
            engine.handle(&Input::Tick, due);
        }
        engine.handle(input, *at);
        shown.push(Snapshot::clone(&engine.snapshot()));
    }
    (shown, engine.take_events())
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn a_clone_goes_the_same_way_and_its_original_does_not_notice(numbers in numbers(), pick in any::<usize>()) {
        let mut choices = Choices::new(&numbers);
        let model = model(&mut choices);
        let history = history(&mut choices);
        let (past, future) = history.split_at(pick % (history.len() + 1));
        let mut engine = Engine::new(model, Timestamp::ZERO);
        engine.keep_events();
        feed(&mut engine, past);
        let (before, deadline) = (engine.snapshot(), engine.next_deadline());
        let mut clone = engine.clone();
        let of_clone = feed(&mut clone, future);
        prop_assert_eq!(&before, &engine.snapshot());
        prop_assert_eq!(deadline, engine.next_deadline());
        let of_original = feed(&mut engine, future);
        prop_assert!(of_clone == of_original, "{of_clone:#?}\n{of_original:#?}");
        prop_assert_eq!(clone.snapshot(), engine.snapshot());
    }
}
