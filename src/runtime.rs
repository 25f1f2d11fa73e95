//! The loop that owns the engine: inputs in, the latest snapshot out.

use std::sync::Arc;
use std::time::SystemTime;

use tokio::sync::{mpsc, oneshot, watch};

use crate::clock::Clock;
use crate::engine::input::{OperatorAction, Response, Stamped};
use crate::engine::model::Model;
use crate::engine::snapshot::Snapshot;

/// Inputs that may wait for the engine. A full queue holds its senders back: the bridge's
/// readers then lose the oldest samples by their own depth, and count that.
pub const INPUT_QUEUE: usize = 1024;

/// The latest snapshot with the wall time at which it was taken.
#[derive(Debug, Clone)]
pub struct Published {
    pub snapshot: Arc<Snapshot>,
    pub at: SystemTime,
}

/// An operator's action that waits for the engine's answer.
#[derive(Debug)]
pub struct Command {
    pub action: OperatorAction,
    pub reply: oneshot::Sender<Response>,
}

/// What the rest of the program holds of the engine. Clones feed and watch the same one.
#[derive(Debug, Clone)]
pub struct Link {
    pub inputs: mpsc::Sender<Stamped>,
    pub commands: mpsc::Sender<Command>,
    /// Holds at most the latest; whoever is slow skips what lies between.
    pub snapshots: watch::Receiver<Published>,
}

/// Starts the engine in a task of the current tokio runtime. It ends when all links are dropped.
pub fn start(_model: Arc<Model>, _clock: Clock) -> Link {
    unreachable!("skeleton")
}
