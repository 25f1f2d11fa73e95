//! Starts the measurements of monitors, and starts them again where what came before does not count.

use crate::monitor::Monitor;
use serde::{Deserialize, Serialize};

use super::{TopicId, Watching};
use crate::model::ModuleId;
use crate::module::onset::is_well;
use crate::state::State;
use crate::time::Timestamp;

/// A dependency blocks the module of a monitor.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Blocked {
    since: Timestamp,
    /// It was OK or WARNING at that instant.
    was_well: bool,
}

impl Watching {
    /// Notes whether a module is relevant, if that changed for its monitor.
    pub(crate) fn note_relevance(&mut self, id: ModuleId, relevant: bool) {
        let watch = self.of_module.get(id.0 as usize).copied().flatten();
        if watch.is_some_and(|watch| self.watches[watch as usize].running != relevant) {
            self.turned.push(id);
        }
    }

    /// Starts or stops the monitor of a module. Returns whether it runs.
    pub(crate) fn turn(&mut self, id: ModuleId, relevant: bool, now: Timestamp) -> Option<u32> {
        let index = self.of_module.get(id.0 as usize).copied().flatten()?;
        let watch = &mut self.watches[index as usize];
        watch.running = relevant;
        watch.monitor.set_relevant(relevant, now);
        for (slot, id) in watch.topics.iter().enumerate() {
            if let Some(news) = &self.topics[id.0 as usize].news {
                watch.monitor.publishers(slot, news.keeping(), now);
            }
        }
        self.go_on_searching(index, now);
        Some(index)
    }

    /// A module was in a fault before a restart, since this instant. Only a monitor of events would forget it.
    pub(crate) fn note_failed(&mut self, id: ModuleId, since: Timestamp) {
        if let Some(index) = self.of_module.get(id.0 as usize).copied().flatten()
            && let Monitor::Value(value) = &mut self.watches[index as usize].monitor
        {
            value.note_failed(since);
        }
    }

    /// Follows whether a module with this own state is blocked. The window of one that was well when that began and
    /// is no longer blocked begins anew, if its monitor has one: the gap in which it waited makes it no cause, nor
    /// does an ERROR from there that is still to be cleared. While it is well even with the gap, it is judged on.
    /// Returns the module with its monitor if its window began anew.
    pub(crate) fn follow_block(
        &mut self,
        id: ModuleId,
        blocked: bool,
        own: State,
        now: Timestamp,
    ) -> Option<(ModuleId, u32)> {
        let index = self.of_module.get(id.0 as usize).copied().flatten()?;
        let watch = &mut self.watches[index as usize];
        if blocked {
            let blocked = watch.blocked.get_or_insert(Blocked { since: now, was_well: false });
            if blocked.since == now {
                blocked.was_well = is_well(own) && watch.monitor.is_proven();
            }
            return None;
        }
        let recovers = watch.blocked.take().is_some_and(|it| it.was_well && it.since < now);
        if !recovers || !watch.running {
            return None;
        }
        if is_well(own) && watch.said.is_some_and(is_well) {
            watch.monitor.recover(now);
            return None;
        }
        if !watch.monitor.begin_anew(now) {
            return None;
        }
        watch.due = None;
        self.go_on_searching(index, now);
        Some((id, index))
    }

    /// A window that begins waits for publishers that discovery may not have found yet.
    fn go_on_searching(&mut self, index: u32, now: Timestamp) {
        let watch = &mut self.watches[index as usize];
        let heard = |id: &TopicId| self.topics[id.0 as usize].news.is_some();
        let search = |id: &TopicId| self.topics[id.0 as usize].searched_until.filter(|&until| until > now);
        let until = watch.topics.iter().filter(|id| !heard(id)).filter_map(search).max();
        if let Some(until) = until.filter(|_| watch.running) {
            watch.monitor.search(until);
            for (slot, _) in watch.topics.iter().enumerate().filter(|(_, id)| heard(id)) {
                watch.monitor.found(slot, now);
            }
        }
        if watch.by_the_clock {
            // Earlier measurements do not count.
            (watch.worded, watch.pending) = (None, true);
        }
    }

    /// Restarts a monitor that judges by the clock, as when it becomes relevant, unless it is in ERROR.
    /// Discovery searches for publishers until `searched`.
    pub(crate) fn begin_anew(&mut self, index: u32, searched: Timestamp, now: Timestamp) {
        let watch = &mut self.watches[index as usize];
        if watch.by_the_clock && watch.running && watch.said != Some(State::Error) {
            watch.monitor.set_relevant(false, now);
            watch.monitor.set_relevant(true, now);
            watch.monitor.search(searched);
            (watch.due, watch.worded, watch.pending) = (None, None, true);
        }
    }
}
