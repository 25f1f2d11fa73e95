//! Monitors that count the modules of their group.

use super::Watching;
use crate::engine::model::ModuleId;
use crate::engine::monitor::Monitor;

impl Watching {
    /// The modules that count the members of their group.
    pub(in crate::engine) fn counts(&self) -> impl Iterator<Item = (ModuleId, u32)> {
        self.counts.iter().copied()
    }

    /// Sets what a monitor counts. Returns whether it has to be judged.
    pub(in crate::engine) fn set_count(&mut self, index: u32, found: u32) -> bool {
        let watch = &mut self.watches[index as usize];
        let Monitor::Count(count) = &mut watch.monitor else { return false };
        let changed = count.set(found);
        if changed {
            (watch.worded, watch.pending) = (None, true);
        }
        changed
    }
}
