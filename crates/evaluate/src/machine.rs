//! A simulated machine as a campaign sees it.

use std::sync::Arc;

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
