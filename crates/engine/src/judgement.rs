//! Turns the judgements of monitors into reports of their modules.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use super::Engine;
use super::input::StatusArray;
use super::mask::net::{Change, Net};
use super::model::sample::{Probe, PublisherReport, Sample};
use super::model::{ModuleId, NodeId};
use super::monitor::feeds::{Judgement, Purpose};
use super::state::State;
use super::time::{Span, Timestamp};
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
                self.net.late = sample.delay;
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
        self.net.late = Span::ZERO;
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
        let (names, held_back, limits) = (&self.names, &self.held_back, &self.model.limits);
        let counts = |name: &str| names.counts(name, number) && !held_back.contains(name);
        self.watching.take_keys(array, counts, limits, self.now - array.late(), &mut judge);
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

    /// Evaluates every marked node. A window that begins anew with a recovery does so before anything follows what
    /// it judged before.
    pub(super) fn evaluate(&mut self) {
        let (mut seen, mut begun) = (0, false);
        loop {
            self.net.evaluate(self.vehicle.stage, &self.signals, self.now);
            let mut recovered = Vec::new();
            for change in &self.net.changes[seen..] {
                if let NodeId::Module(id) = change.node {
                    let (blocked, own) = (change.after.blocked, change.after.own);
                    recovered.extend(self.watching.follow_block(id, blocked, own, self.now));
                }
            }
            seen = self.net.changes.len();
            if recovered.is_empty() {
                break;
            }
            begun = true;
            for (id, index) in recovered {
                self.net.give_time(id, self.now);
                self.judge_monitor(index, false);
            }
        }
        if begun {
            self.net.merge_changes();
        }
    }

    /// Counts the modules of groups that must have a certain number of them. Returns whether that changed anything.
    pub(super) fn count_members(&mut self) -> bool {
        let mut changed = false;
        for (id, watch, nested) in self.watching.counts().collect::<Vec<_>>() {
            let group = self.net.modules[id.0 as usize].node.parent;
            let members = group.map_or(0, |group| self.net.groups[group.0 as usize].members.len());
            // The counting module is a member itself.
            let found = members.saturating_sub(nested + 1) as u32;
            if self.watching.set_count(watch, found, self.now) {
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

    /// Makes one change of all those of a node.
    fn merge_changes(&mut self) {
        let mut places: HashMap<NodeId, usize> = HashMap::new();
        let mut merged: Vec<Change> = Vec::with_capacity(self.changes.len());
        for change in self.changes.drain(..) {
            match places.entry(change.node) {
                Entry::Occupied(place) => merged[*place.get()].after = change.after,
                Entry::Vacant(place) => {
                    place.insert(merged.len());
                    merged.push(change);
                }
            }
        }
        self.changes = merged;
    }

    /// A module's window begins anew.
    fn give_time(&mut self, id: ModuleId, now: Timestamp) {
        let policy = self.policy(id).clone();
        self.modules[id.0 as usize].own.give_time(&policy, now);
        self.mark_module(id);
    }

    /// A module's monitor has no judgement any more.
    fn forget(&mut self, id: ModuleId, now: Timestamp) -> bool {
        let policy = self.policy(id).clone();
        self.modules[id.0 as usize].own.forget(&policy, now);
        true
    }
}
