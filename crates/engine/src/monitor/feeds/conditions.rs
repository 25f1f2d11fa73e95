//! Conditions of signals across a reload.

use super::{Purpose, Watch, Watching};

impl Watching {
    /// Continues the inputs of a condition with the same meaning from before a reload.
    pub(crate) fn keep_condition(&mut self, signal: usize, old: &Watching, before: usize) {
        let of = |signal| move |watch: &&Watch| watch.purpose == Purpose::Signal(signal);
        let Some(before) = old.watches.iter().find(of(before)) else { return };
        let of = |watch: &&mut Watch| watch.purpose == Purpose::Signal(signal);
        if let Some(watch) = self.watches.iter_mut().find(of) {
            watch.monitor = before.monitor.clone();
        }
    }
}
