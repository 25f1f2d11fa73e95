//! What one status costs the engine. `cargo bench --bench engine`.

mod vehicle;

use divan::{Bencher, counter::ItemsCount};
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
