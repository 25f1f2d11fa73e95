//! Monitors that count the modules of their group.

use super::Watching;
use crate::model::ModuleId;
use crate::monitor::Monitor;
use crate::time::Timestamp;

impl Watching {
    /// The modules that count the modules of their group, each with its monitor and the number of nested groups.
    pub(crate) fn counts(&self) -> impl Iterator<Item = (ModuleId, u32, usize)> {
        self.counts.iter().copied()
    }

    /// Sets what a monitor counts. Returns whether it has to be judged.
    pub(crate) fn set_count(&mut self, index: u32, found: u32, now: Timestamp) -> bool {
        let watch = &mut self.watches[index as usize];
        let Monitor::Count(count) = &mut watch.monitor else { return false };
        let changed = count.set(found, now);
        if changed {
            (watch.worded, watch.pending) = (None, true);
        }
        changed
    }
}
