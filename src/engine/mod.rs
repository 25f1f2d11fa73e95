//! The pure core: statuses, signals and operator actions in, snapshots out (`ENGINE.md`).
//!
//! No clock, no I/O, no async, no serde, no logging. Whoever feeds it says what time it is and
//! when to call again is asked of [`Engine::next_deadline`].

pub mod filter;
pub mod graph;
pub mod input;
pub mod model;
pub mod persistent;
pub mod snapshot;
pub mod state;
pub mod time;

use std::sync::Arc;

use input::{Input, Response};
use model::Model;
use snapshot::Snapshot;
use time::Timestamp;

/// The aggregation engine of one vehicle.
#[derive(Debug)]
pub struct Engine {
    model: Arc<Model>,
}

impl Engine {
    pub fn new(model: Arc<Model>, _now: Timestamp) -> Engine {
        Engine { model }
    }

    /// Takes one input at `now`; an instant before the last one counts as the last one.
    pub fn handle(&mut self, _input: &Input, _now: Timestamp) -> Response {
        Response::Done
    }

    /// What everything shows now. Cheap where little changed.
    pub fn snapshot(&mut self) -> Arc<Snapshot> {
        let _ = &self.model;
        unreachable!("skeleton")
    }

    /// When time alone changes something next: call [`Engine::handle`] with [`Input::Tick`] then.
    pub fn next_deadline(&self) -> Option<Timestamp> {
        None
    }
}
