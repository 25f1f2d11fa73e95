//! A simulated machine as a campaign sees it.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use telltale_engine::input::Input;
use telltale_engine::model::Model;
use telltale_engine::time::{Span, Timestamp};

use super::plan::{Fault, Injection, Place};

/// Machine and engines advance in such steps.
pub const STEP: Span = Span::from_millis(10);

/// What a diagnosis hears, step by step.
pub type History = Vec<Step>;

#[derive(Debug, Clone)]
pub struct Step {
    pub at: Timestamp,
    pub inputs: Vec<Input>,
}

pub trait Machine: Sync {
    fn name(&self) -> &'static str;

    /// Its configuration.
    fn model(&self) -> &Arc<Model>;

    fn faults(&self) -> &[Fault];

    /// From the start until it is at this place without a fault. All trials there begin with it.
    fn beginning(&self, place: Place) -> &History;

    /// What follows, with these faults, until so long after the beginning. The machine does not obey a diagnosis.
    fn history(&self, place: Place, injections: &[Injection], length_ms: u64) -> History;
}

/// What comes of each of these seeds, in their order, by so many threads.
pub(crate) fn of_each<T: Send>(seeds: &Range<u64>, threads: usize, of: impl Fn(u64) -> T + Sync) -> Vec<T> {
    let next = AtomicU64::new(seeds.start);
    let all: Mutex<BTreeMap<u64, T>> = Mutex::default();
    std::thread::scope(|scope| {
        for _ in 0..threads.max(1) {
            scope.spawn(|| {
                while let seed = next.fetch_add(1, Ordering::Relaxed)
                    && seed < seeds.end
                {
                    let one = of(seed);
                    all.lock().unwrap_or_else(PoisonError::into_inner).insert(seed, one);
                }
            });
        }
    });
    all.into_inner().unwrap_or_else(PoisonError::into_inner).into_values().collect()
}
