//! Turns the judgements of monitors into reports of their modules.

use super::Engine;
use super::input::StatusArray;
use super::mask::net::Net;
use super::model::ModuleId;
use super::model::sample::{Probe, PublisherReport, Sample};
use super::monitor::feeds::{Judgement, Purpose};
use super::state::State;
use super::time::Timestamp;
use super::timers::TimerKey;

/// An input for monitors.
#[derive(Debug, Clone, Copy)]
pub(super) enum Received<'a> {
    Sample(&'a Sample),
    Topic(&'a PublisherReport),
    Probe(&'a Probe),
}

impl Engine {
    /// Takes an input for monitors. Returns whether more than counters changed.
    pub(super) fn take_watched(&mut self, received: Received<'_>) -> bool {
        if let Received::Probe(probe) = received
            && self.has_no_answer(probe)
        {
            return false;
        }
        let mut judge = std::mem::take(&mut self.watching.judge);
        let (mut sampled, mut heard) = (None, true);
        let taken = match received {
            Received::Sample(sample) => {
                self.counters.samples += 1;
                let topic = self.watching.take_sample(sample, self.now, &mut judge);
                sampled = topic.map(|topic| (topic, sample));
                topic.map(|_| ())
            }
            Received::Topic(news) => {
                heard = false;
                self.watching.take_news(news, self.now, &mut judge)
            }
            Received::Probe(probe) => self.watching.take_probe(probe, self.now, &mut judge),
        };
        self.counters.dropped_samples += u64::from(taken.is_none());
        let mut changed = false;
        for &index in &judge {
            changed |= self.judge_monitor(index, heard);
        }
        if let Some((topic, sample)) = sampled {
            changed |= self.take_motion(topic, sample);
        }
        judge.clear();
        self.watching.judge = judge;
        changed
    }

    /// Takes the KeyValues that monitors watch, after the statuses have been assigned to their modules.
    pub(super) fn take_keys(&mut self, array: &StatusArray, number: u64) {
        let mut judge = std::mem::take(&mut self.watching.judge);
        let (names, limits) = (&self.names, &self.model.limits);
        self.watching.take_keys(array, |name| names.counts(name, number), limits, self.now, &mut judge);
        for index in judge.drain(..) {
            self.judge_monitor(index, true);
        }
        self.watching.judge = judge;
    }

    /// Judges a monitor after an input (`heard`) or after time has passed. Returns whether that changed
    /// anything.
    pub(super) fn judge_monitor(&mut self, index: u32, heard: bool) -> bool {
        let id = match self.watching.watches[index as usize].purpose {
            Purpose::Module(id) => id,
            Purpose::Signal(signal) => return heard && self.judge_condition(index, signal),
        };
        if self.dds_fault.is_some() && !heard && self.watching.hears_dds(id) {
            // Silence while DDS is down is no statement about the vehicle.
            return false;
        }
        let by_the_clock = self.watching.by_the_clock(index);
        let Judgement { state, changed, words, aged, due } =
            self.watching.judge(index, self.net.policy(id), self.now);
        if let Some(due) = due {
            self.timers.arm(TimerKey::Monitor(index), due);
        }
        let moved = match state {
            Some(state) if heard => self.net.report(id, state, self.now),
            Some(state) if changed => self.net.revise(id, state, by_the_clock, self.now),
            None if changed => self.net.forget(id, self.now),
            Some(_) | None => false,
        };
        if moved {
            self.net.mark_module(id);
        }
        if heard || state.is_none() {
            self.views.note_heard(id);
        }
        let said = words.is_some_and(|words| self.views.set_words(id, words, aged));
        moved || said
    }

    /// Starts the monitors of modules that became relevant, and stops the others. Returns whether there were
    /// any.
    pub(super) fn turn_monitors(&mut self) -> bool {
        let turned = std::mem::take(&mut self.watching.turned);
        for &id in &turned {
            let relevant = self.net.modules[id.0 as usize].node.facts.relevant;
            if let Some(index) = self.watching.turn(id, relevant, self.now) {
                self.judge_monitor(index, false);
            }
        }
        !turned.is_empty()
    }

    /// Counts the members of groups that must have a certain number of them. Returns whether that changed anything.
    pub(super) fn count_members(&mut self) -> bool {
        let mut changed = false;
        for (id, watch) in self.watching.counts().collect::<Vec<_>>() {
            let group = self.net.modules[id.0 as usize].node.parent;
            let members = group.map_or(0, |group| self.net.groups[group.0 as usize].members.len());
            // The counting module is a member itself.
            if self.watching.set_count(watch, members.saturating_sub(1) as u32) {
                changed |= self.judge_monitor(watch, false);
            }
        }
        changed
    }

    /// Continues the monitors from before a reload, once their modules exist.
    pub(super) fn resume_monitors(&mut self) {
        for index in 0..self.watching.watches.len() as u32 {
            self.judge_monitor(index, false);
        }
    }
}

impl Net {
    /// A module's monitor has a new judgement without a new input. Returns whether the module's own state may
    /// have changed.
    fn revise(&mut self, id: ModuleId, state: State, by_the_clock: bool, now: Timestamp) -> bool {
        let state = self.counted(id, state);
        let policy = self.policy(id).clone();
        let own = &mut self.modules[id.0 as usize].own;
        let heard = own.received().is_some();
        let moved = own.revise(state, &policy, by_the_clock, now);
        // Time acts first: the effect of an input may end at this very instant.
        let forgotten = heard && own.received().is_none();
        if forgotten {
            self.forgotten.push(id);
        }
        moved || forgotten
    }

    /// A module's monitor has no judgement any more.
    fn forget(&mut self, id: ModuleId, now: Timestamp) -> bool {
        let policy = self.policy(id).clone();
        self.modules[id.0 as usize].own.forget(&policy, now);
        true
    }
}
