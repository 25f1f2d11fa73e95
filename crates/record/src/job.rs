//! An incident that is to be written: what the recorder decides, and the writer reads.

use std::sync::Arc;

use super::freeze;
use super::incident::{Open, Trigger};
use super::latched::Kept;
use super::ring::{ConfigurationText, Position};
use super::summary::FrozenNode;
use telltale_engine::model::Stage;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::time::Timestamp;

/// An incident to be written.
#[derive(Debug, Clone)]
pub(super) struct Job {
    pub number: u64,
    pub open: Open,
    /// The engine's state with which the recording begins.
    pub begin: Position,
    /// The first instant that is shown.
    pub shown_from: Timestamp,
    /// The entry after the last one; `None` while the incident is open.
    pub end: Option<Position>,
    pub configuration: Arc<[ConfigurationText]>,
    pub roots: Vec<Arc<str>>,
    /// The stage at the first trigger; a machine may have none.
    pub stage: Option<Stage>,
    /// With the times of the triggers to which they belong.
    pub freeze: Vec<(Timestamp, FrozenNode)>,
    /// The last messages of latched topics before it begins.
    pub latched: Vec<Kept>,
}

impl Job {
    /// It lasts longer. What has failed since is kept with its values.
    pub fn extend(&mut self, open: Open, snapshot: &Snapshot) {
        for (at, trigger) in open.triggers.iter().skip(self.open.triggers.len()) {
            if let Trigger::Root { node, .. } | Trigger::OwnError { node } = trigger {
                let known: Vec<FrozenNode> = self.freeze.iter().map(|(_, it)| it.clone()).collect();
                let new = freeze::later(snapshot, node, &known);
                self.freeze.extend(new.into_iter().map(|it| (*at, it)));
            }
        }
        self.open = open;
    }
}
