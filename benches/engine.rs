//! What one status, and one message of a watched topic, costs the engine. `cargo bench --bench engine`.

mod vehicle;
#[path = "vehicle/watched.rs"]
mod watched;

use std::sync::Arc;

use divan::{Bencher, counter::ItemsCount};
use telltale::engine::Engine;
use telltale::engine::time::Timestamp;

fn main() {
    divan::main();
}

const NOW: Timestamp = Timestamp::from_millis(1);

/// A thousand statuses that say what they said before, in one array: lookup of the name included.
#[divan::bench(args = [1_000, 10_000, 100_000])]
fn unchanged(bencher: Bencher<'_, '_>, modules: usize) {
    let mut engine = vehicle::running(modules);
    let arrays: Vec<_> =
        (0..modules / 1_000).map(|index| vehicle::array(index * 1_000..(index + 1) * 1_000, 0)).collect();
    let mut next = 0;
    bencher.counter(ItemsCount::new(1_000_usize)).bench_local(|| {
        engine.handle(&arrays[next % arrays.len()], NOW);
        next += 1;
    });
}

/// One module goes from OK to WARNING or back, and a snapshot is taken.
#[divan::bench(args = [100, 1_000, 10_000, 100_000])]
fn warning_and_snapshot(bencher: Bencher<'_, '_>, modules: usize) {
    flip(bencher, modules, 1);
}

/// One module of the last group of a chain goes from OK to ERROR or back, and a snapshot is taken: root causes
/// are searched, nothing is masked.
#[divan::bench(args = [100, 1_000, 10_000, 100_000])]
fn error_and_snapshot(bencher: Bencher<'_, '_>, modules: usize) {
    flip(bencher, modules, 2);
}

/// As `warning_and_snapshot`, with one snapshot for a hundred changes in different groups.
#[divan::bench(args = [10_000, 100_000])]
fn hundred_warnings_and_snapshot(bencher: Bencher<'_, '_>, modules: usize) {
    let mut engine = vehicle::running(modules);
    let step = modules / 100;
    let changes: Vec<Vec<_>> = [1, 0]
        .map(|level| (0..100).map(|index| vehicle::array(index * step..index * step + 1, level)).collect())
        .to_vec();
    let mut next = 0;
    bencher.counter(ItemsCount::new(100_usize)).bench_local(|| {
        for change in &changes[next % 2] {
            engine.handle(change, NOW);
        }
        next += 1;
        engine.snapshot()
    });
}

/// 10 ms of 20,000 messages a second on 200 topics that 1,000 monitors watch, with the monitors' timers.
/// 15 us a message are 30 % of a core.
#[divan::bench]
fn watched_messages(bencher: Bencher<'_, '_>) {
    let model = Arc::new(watched::model());
    let topics = model.watched.topics.clone();
    let mut engine = Engine::new(model, Timestamp::ZERO);
    let mut number = 0;
    let mut hundredth = move || -> Vec<_> {
        number += watched::TOPICS as u64;
        (number..number + watched::TOPICS as u64).map(|number| watched::message(&topics, number)).collect()
    };
    // The windows are full before anything is measured.
    for (input, now) in (0..300).flat_map(|_| hundredth()) {
        engine.handle(&input, now);
    }
    bencher.counter(ItemsCount::new(watched::TOPICS)).with_inputs(hundredth).bench_local_values(|messages| {
        for (input, now) in &messages {
            engine.handle(input, *now);
        }
        messages
    });
}

fn flip(bencher: Bencher<'_, '_>, modules: usize, level: u8) {
    let mut engine = vehicle::running(modules);
    // The last group of the vehicle: nothing depends on it.
    let chosen = modules - 1..modules;
    let changes = [vehicle::array(chosen.clone(), level), vehicle::array(chosen, 0)];
    // A published snapshot is held while the next is made, as the server does.
    let mut held = engine.snapshot();
    let mut next = 0;
    bencher.bench_local(|| {
        engine.handle(&changes[next % 2], NOW);
        next += 1;
        held = engine.snapshot();
    });
    drop(held);
}
