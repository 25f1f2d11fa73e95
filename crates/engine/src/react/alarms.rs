//! Alarms: one for each root cause, with a lasting number.

use crate::files::count;
use serde::{Deserialize, Serialize};
use std::collections::hash_map::{Entry, HashMap};
use std::collections::{BTreeSet, HashSet};

use crate::Engine;
use crate::event::{EventKind, Events};
use crate::model::wording::Urgency;
use crate::model::{NodeId, Within};
use crate::snapshot::Alarm;
use crate::time::Timestamp;

/// The number of ended, unacknowledged alarms that are kept.
const KEPT_MAX: usize = 256;

/// The same for one node. A module that comes and goes makes a new alarm each time; beyond this number the next
/// one counts them, so no alarm of another node is dropped for them.
const OF_NODE_MAX: usize = 8;

/// All alarms that are active or not acknowledged.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Alarms {
    list: Vec<Alarm>,
    /// The number of active ones.
    active: usize,
    #[serde(deserialize_with = "count")]
    last_id: u64,
    #[serde(deserialize_with = "count")]
    merged: u64,
    #[serde(deserialize_with = "count")]
    dropped: u64,
    /// Modules with an alarm from before a restart and without a report since: the alarm does not end yet.
    awaited: BTreeSet<NodeId>,
}

impl Alarms {
    pub(crate) fn list(&self) -> &[Alarm] {
        &self.list
    }

    pub(crate) fn active(&self) -> usize {
        self.active
    }

    pub(crate) fn last_id(&self) -> u64 {
        self.last_id
    }

    /// Takes over alarms from before a restart. Active ones stay until their module reports.
    pub(crate) fn restore(&mut self, mut list: Vec<Alarm>, last_id: u64) {
        for alarm in &mut list {
            alarm.active &= matches!(alarm.node, NodeId::Module(_));
        }
        list.retain(|alarm| alarm.active || !alarm.acknowledged);
        self.awaited = list.iter().filter(|alarm| alarm.active).map(|alarm| alarm.node).collect();
        self.last_id = list.iter().map(|alarm| alarm.id).fold(last_id, u64::max);
        self.active = self.awaited.len();
        self.list = list;
    }

    /// Stops waiting for modules that have reported. Returns whether there was any.
    pub(crate) fn hear(&mut self, is_known: impl Fn(NodeId) -> bool) -> bool {
        let before = self.awaited.len();
        self.awaited.retain(|&node| !is_known(node));
        self.awaited.len() != before
    }

    /// Whether an alarm from before a restart waits for its module.
    pub(crate) fn awaits(&self) -> bool {
        !self.awaited.is_empty()
    }

    /// The nodes of all alarms.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = NodeId> {
        self.list.iter().map(|alarm| alarm.node).chain(self.awaited.iter().copied())
    }

    /// The node of an alarm.
    pub(crate) fn node(&self, id: u64) -> Option<NodeId> {
        self.list.iter().find(|alarm| alarm.id == id).map(|alarm| alarm.node)
    }

    /// The alarm of this number, if it is the latest of its node.
    pub(crate) fn latest(&self, id: u64) -> Option<Alarm> {
        let alarm = self.list.iter().find(|alarm| alarm.id == id)?;
        let of_node = self.list.iter().filter(|it| it.node == alarm.node);
        let latest = of_node.max_by_key(|it| (it.active, it.ended, it.id))?;
        (latest.id == id).then(|| alarm.clone())
    }

    /// The numbers of the alarms that are over, up to this one.
    pub(crate) fn over(&self, last: u64) -> Vec<u64> {
        self.list.iter().filter(|it| !it.active && it.id <= last).map(|it| it.id).collect()
    }

    /// Acknowledges alarms; one that has ended is then removed. Returns whether there was any.
    pub(crate) fn acknowledge(
        &mut self,
        which: impl Fn(&Alarm) -> bool,
        now: Timestamp,
        events: &mut Events,
    ) -> bool {
        let mut found = false;
        for alarm in self.list.iter_mut().filter(|alarm| which(alarm)) {
            found = true;
            if !std::mem::replace(&mut alarm.acknowledged, true) {
                alarm.acknowledged_at = Some(now);
                events.push(now, EventKind::AlarmAcknowledged { id: alarm.id, node: alarm.node });
            }
        }
        self.list.retain(|alarm| alarm.active || !alarm.acknowledged);
        found
    }

    /// Takes over alarms under new ids; one whose node is gone has ended.
    pub(crate) fn copy(&mut self, old: &Alarms, renamed: impl Fn(NodeId) -> Option<NodeId>) {
        self.last_id = old.last_id;
        self.awaited = old.awaited.iter().filter_map(|&node| renamed(node)).collect();
        let kept =
            old.list.iter().filter_map(|alarm| Some(Alarm { node: renamed(alarm.node)?, ..alarm.clone() }));
        self.list = kept.collect();
        self.active = self.list.iter().filter(|alarm| alarm.active).count();
    }

    /// Takes the present root causes, ranked, each with whether it raises an alarm: one that raises none keeps
    /// an existing alarm, and takes over that of a symptom. `explained` names the causes that now explain the alarm
    /// of a former root: it moves to the first of them without an alarm, and keeps its number. If all of them have
    /// one, the alarm is removed, because theirs cover it. Returns whether anything changed.
    pub(crate) fn follow(
        &mut self,
        roots: &[(NodeId, bool)],
        explained: impl Fn(&Alarm) -> Vec<NodeId>,
        now: Timestamp,
        events: &mut Events,
    ) -> bool {
        let mut active: HashMap<NodeId, usize> = HashMap::new();
        for (index, alarm) in self.list.iter().enumerate().filter(|(_, alarm)| alarm.active) {
            active.insert(alarm.node, index);
        }
        let present: HashSet<NodeId> = roots.iter().map(|(node, _)| *node).collect();
        let is_gone = |node: &NodeId| !present.contains(node) && !self.awaited.contains(node);
        let mut changed = false;
        let mut gone: Vec<usize> =
            active.iter().filter(|(node, _)| is_gone(node)).map(|(_, &index)| index).collect();
        gone.sort_unstable();
        for index in gone {
            changed = true;
            let causes = explained(&self.list[index]);
            let heir = causes.iter().find(|node| present.contains(node) && !active.contains_key(node));
            let cover = causes.iter().find_map(|node| active.get(node).copied());
            let alarm = &mut self.list[index];
            active.remove(&alarm.node);
            match heir {
                Some(&node) => {
                    events
                        .push(now, EventKind::AlarmMoved { id: alarm.id, symptom: alarm.node, cause: node });
                    alarm.node = node;
                    alarm.acknowledged = false;
                    active.insert(node, index);
                }
                None => {
                    events.push(now, EventKind::AlarmCleared { id: alarm.id, node: alarm.node });
                    alarm.active = false;
                    alarm.ended = Some(now);
                    if let Some(cover) = cover {
                        let (asked, known) = (alarm.asked, alarm.acknowledged);
                        alarm.acknowledged = true;
                        self.list[cover].take_over_urgency(asked, known);
                    }
                }
            }
        }
        for &(node, _) in roots.iter().filter(|(_, sounds)| *sounds) {
            if let Entry::Vacant(slot) = active.entry(node) {
                changed = true;
                self.last_id += 1;
                events.push(now, EventKind::AlarmRaised { id: self.last_id, node });
                slot.insert(self.list.len());
                self.list.push(Alarm {
                    id: self.last_id,
                    node,
                    raised: now,
                    ended: None,
                    acknowledged: false,
                    acknowledged_at: None,
                    active: true,
                    repeats: 0,
                    asked: None,
                });
            }
        }
        self.active = active.len();
        if changed {
            self.list.retain(|alarm| alarm.active || !alarm.acknowledged);
            self.merge_repeated();
            self.drop_oldest();
        }
        changed
    }

    /// Acknowledges alarms raised at `now` by a status that an acknowledged alarm already covers: the fault
    /// only shows in a further place.
    fn know(&mut self, same: impl Fn(NodeId, NodeId) -> bool, now: Timestamp, events: &mut Events) {
        let known = self.list.iter().filter(|it| it.active && it.acknowledged);
        let known: Vec<(NodeId, Option<Urgency>)> = known.map(|it| (it.node, it.asked)).collect();
        for alarm in self.list.iter_mut().filter(|it| it.raised == now && it.active && !it.acknowledged) {
            if let Some((_, asked)) = known.iter().find(|(node, _)| same(*node, alarm.node)) {
                (alarm.acknowledged, alarm.asked) = (true, *asked);
                events.push(now, EventKind::AlarmAcknowledged { id: alarm.id, node: alarm.node });
            }
        }
    }

    /// Takes what each root cause, and all that waits for it, asks for now. The highest urgency is remembered while the
    /// vehicle is on its way. An alarm whose urgency rises calls again. Returns whether anything changed.
    pub(crate) fn ask(&mut self, now: impl Fn(NodeId) -> Option<Urgency>, remembers: bool) -> bool {
        let mut changed = false;
        for alarm in self.list.iter_mut().filter(|alarm| alarm.active) {
            let (before, now) = (alarm.asked, now(alarm.node));
            alarm.asked = if remembers { before.max(now) } else { now };
            if now > before && alarm.acknowledged {
                (alarm.acknowledged, alarm.acknowledged_at) = (false, None);
            }
            changed |= alarm.asked != before;
        }
        changed
    }

    /// Merges the oldest of a node's repeated alarms into the next one.
    fn merge_repeated(&mut self) {
        let over = |alarm: &&Alarm| !alarm.active;
        let mut count: HashMap<NodeId, usize> = HashMap::new();
        self.list.iter().filter(over).for_each(|alarm| *count.entry(alarm.node).or_default() += 1);
        count.retain(|_, count| *count > OF_NODE_MAX);
        let mut surplus: usize = self.list.iter().filter(over).count().saturating_sub(KEPT_MAX);
        if count.is_empty() && surplus == 0 {
            return;
        }
        let mut index = 0;
        while index < self.list.len() {
            let Alarm { node, active, repeats, .. } = self.list[index];
            let of_node = count.get_mut(&node).filter(|count| **count > OF_NODE_MAX);
            let is_meant = !active && (of_node.is_some() || surplus > 0);
            let mut later = self.list[index + 1..].iter_mut().filter(|_| is_meant);
            match later.find(|alarm| alarm.node == node) {
                Some(later) => {
                    later.repeats = later.repeats.saturating_add(repeats).saturating_add(1);
                    of_node.into_iter().for_each(|count| *count -= 1);
                    surplus = surplus.saturating_sub(1);
                    self.merged += 1;
                    self.list.remove(index);
                }
                None => index += 1,
            }
        }
    }

    fn drop_oldest(&mut self) {
        let over = self.list.iter().filter(|alarm| !alarm.active).count();
        let mut surplus = over.saturating_sub(KEPT_MAX);
        self.dropped += surplus as u64;
        self.list.retain(|alarm| {
            let drop = !alarm.active && surplus > 0;
            surplus -= usize::from(drop);
            !drop
        });
    }

    /// The numbers of merged and of dropped alarms since the last call.
    fn take_lost(&mut self) -> (u64, u64) {
        (std::mem::take(&mut self.merged), std::mem::take(&mut self.dropped))
    }
}

impl Engine {
    /// Updates the alarms to the present root causes.
    pub(crate) fn follow_alarms(&mut self) {
        let (views, net, now, roots) = (&self.views, &self.net, self.now, self.views.roots(&self.shelves));
        // A fault that stood for longer is not owed to what failed later.
        let is_near = |alarm: &Alarm| match net.reach(alarm.node) {
            Within::Always => true,
            Within::Limit(limit) => now.since(alarm.raised) <= limit,
        };
        let causes = |alarm: &Alarm| if is_near(alarm) { views.masked_by(alarm.node) } else { Vec::new() };
        if self.alarms.follow(&roots, causes, self.now, &mut self.events) {
            let same = |a, b| a != b && views.status_of(a).is_some_and(|it| views.status_of(b) == Some(it));
            self.alarms.know(same, self.now, &mut self.events);
            self.views.set_alarms(self.alarms.list());
            let (merged, dropped) = self.alarms.take_lost();
            self.counters.merged_alarms += merged;
            self.counters.dropped_alarms += dropped;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ModuleId;

    const A: NodeId = NodeId::Module(ModuleId(0));
    const B: NodeId = NodeId::Module(ModuleId(1));
    const C: NodeId = NodeId::Module(ModuleId(2));

    fn calling(roots: &[NodeId]) -> Vec<(NodeId, bool)> {
        roots.iter().map(|&node| (node, true)).collect()
    }

    fn numbers(alarms: &Alarms) -> Vec<(u64, NodeId, bool)> {
        alarms.list().iter().map(|alarm| (alarm.id, alarm.node, alarm.active)).collect()
    }

    #[test]
    fn a_root_that_returns_is_a_new_alarm() {
        let mut alarms = Alarms::default();
        let none = |_: &Alarm| Vec::new();
        assert!(alarms.follow(&[(A, true)], none, Timestamp::ZERO, &mut Events::default()));
        assert!(!alarms.follow(&[(A, true)], none, Timestamp::ZERO, &mut Events::default()));
        alarms.follow(&[], none, Timestamp::ZERO, &mut Events::default());
        alarms.follow(&[(A, true)], none, Timestamp::ZERO, &mut Events::default());
        assert_eq!(numbers(&alarms), [(1, A, false), (2, A, true)]);
    }

    #[test]
    fn of_several_symptoms_the_first_number_moves_to_the_cause_and_the_rest_close() {
        let mut alarms = Alarms::default();
        alarms.follow(&[(A, true)], |_| Vec::new(), Timestamp::ZERO, &mut Events::default());
        alarms.follow(&[(A, true), (B, true)], |_| Vec::new(), Timestamp::ZERO, &mut Events::default());
        alarms.follow(&[(C, true)], |_| vec![C], Timestamp::ZERO, &mut Events::default());
        assert_eq!(numbers(&alarms), [(1, C, true)], "the rest is owed to it and asks for nothing");
        alarms.follow(&[(C, true), (A, true)], |_| Vec::new(), Timestamp::ZERO, &mut Events::default());
        alarms.follow(&[(C, true)], |_| Vec::new(), Timestamp::ZERO, &mut Events::default());
        assert_eq!(numbers(&alarms), [(1, C, true), (3, A, false)], "over without a cause");
    }

    #[test]
    fn what_is_given_time_raises_none_and_takes_over_that_of_a_symptom() {
        let mut alarms = Alarms::default();
        let mut follow = |roots: &[(NodeId, bool)], causes: &[NodeId]| {
            alarms.follow(roots, |_| causes.to_vec(), Timestamp::ZERO, &mut Events::default());
            numbers(&alarms)
        };
        assert_eq!(follow(&[(C, false)], &[]), []);
        assert_eq!(follow(&[(C, true)], &[]), [(1, C, true)]);
        assert_eq!(follow(&[(C, false)], &[]), [(1, C, true)], "what was raised stays");
        assert_eq!(follow(&[(A, true)], &[]), [(1, C, false), (2, A, true)]);
        assert_eq!(follow(&[(B, false)], &[B]), [(1, C, false), (2, B, true)]);
    }

    #[test]
    fn what_is_known_at_one_place_is_known_at_another_that_comes_later() {
        let mut alarms = Alarms::default();
        let at = Timestamp::from_millis;
        alarms.follow(&calling(&[A]), |_| Vec::new(), at(0), &mut Events::default());
        alarms.acknowledge(|_| true, at(1), &mut Events::default());
        alarms.follow(&calling(&[A, B, C]), |_| Vec::new(), at(2), &mut Events::default());
        alarms.know(|a, b| (a, b) == (A, B), at(2), &mut Events::default());
        let known: Vec<bool> = alarms.list().iter().map(|alarm| alarm.acknowledged).collect();
        assert_eq!(known, [true, true, false]);
    }

    #[test]
    fn urgency_holds_until_it_is_acknowledged_or_the_vehicle_stands_and_a_rise_calls_again() {
        use Urgency::{BeReady, TakeOver};
        let mut alarms = Alarms::default();
        alarms.follow(&calling(&[A]), |_| Vec::new(), Timestamp::ZERO, &mut Events::default());
        let look = |alarms: &Alarms| (alarms.list()[0].asked, alarms.list()[0].acknowledged);
        let ask = |alarms: &mut Alarms, urgency: Option<Urgency>, remembers| {
            let changed = alarms.ask(|_| urgency, remembers);
            (look(alarms), changed)
        };
        assert_eq!(ask(&mut alarms, Some(TakeOver), true), ((Some(TakeOver), false), true));
        assert_eq!(
            ask(&mut alarms, Some(BeReady), true),
            ((Some(TakeOver), false), false),
            "nothing got better"
        );
        assert_eq!(ask(&mut alarms, Some(BeReady), false), ((Some(BeReady), false), true), "it stands");
        alarms.acknowledge(|_| true, Timestamp::ZERO, &mut Events::default());
        assert_eq!(ask(&mut alarms, Some(BeReady), true), ((Some(BeReady), true), false));
        assert_eq!(ask(&mut alarms, Some(TakeOver), true), ((Some(TakeOver), false), true), "it calls again");
        alarms.acknowledge(|_| true, Timestamp::ZERO, &mut Events::default());
        assert_eq!(ask(&mut alarms, None, true), ((Some(TakeOver), true), false));
        assert_eq!(ask(&mut alarms, Some(TakeOver), true), ((Some(TakeOver), true), false), "it is known");
    }

    #[test]
    fn a_symptom_that_closes_leaves_its_urgency_to_its_cause() {
        for acknowledged in [false, true] {
            let mut alarms = Alarms::default();
            let follow = |alarms: &mut Alarms, roots: &[NodeId], causes: &[NodeId]| {
                alarms.follow(&calling(roots), |_| causes.to_vec(), Timestamp::ZERO, &mut Events::default());
            };
            follow(&mut alarms, &[A, B], &[]);
            alarms.ask(|node| Some(if node == A { Urgency::BeReady } else { Urgency::TakeOver }), true);
            let of = |alarm: &Alarm| alarm.node == A || acknowledged;
            alarms.acknowledge(of, Timestamp::ZERO, &mut Events::default());
            follow(&mut alarms, &[A], &[A]);
            let left: Vec<_> = alarms.list().iter().map(|it| (it.node, it.asked, it.acknowledged)).collect();
            assert_eq!(left, [(A, Some(Urgency::TakeOver), acknowledged)]);
        }
    }

    #[test]
    fn an_alarm_from_before_a_restart_is_over_once_its_module_is_known_and_no_root() {
        for (acknowledged, left) in [(true, vec![]), (false, vec![(7, A, false)])] {
            let mut alarms = Alarms::default();
            let (raised, ended) = (Timestamp::ZERO, None);
            let alarm = Alarm {
                id: 7,
                node: A,
                raised,
                ended,
                acknowledged,
                acknowledged_at: None,
                active: true,
                repeats: 0,
                asked: None,
            };
            alarms.restore(vec![alarm], 7);
            let follow = |alarms: &mut Alarms, roots: &[NodeId]| {
                alarms.follow(&calling(roots), |_| Vec::new(), Timestamp::ZERO, &mut Events::default());
            };
            assert!(!alarms.hear(|_| false) && alarms.awaits());
            follow(&mut alarms, &[]);
            assert_eq!(numbers(&alarms), [(7, A, true)]);
            assert!(alarms.hear(|_| true) && !alarms.awaits());
            follow(&mut alarms, &[]);
            assert_eq!(numbers(&alarms), left);
            follow(&mut alarms, &[A]);
            let new = alarms.list().last().map(|alarm| (alarm.id, alarm.acknowledged, alarm.active));
            assert_eq!(new, Some((8, false, true)));
        }
    }

    #[test]
    fn flapping_is_counted_and_takes_no_room_from_others() {
        let mut alarms = Alarms::default();
        let mut follow = |roots: &[NodeId]| {
            alarms.follow(&calling(roots), |_| Vec::new(), Timestamp::ZERO, &mut Events::default());
        };
        follow(&[B]);
        (0..1000).for_each(|_| [&[][..], &[A]].into_iter().for_each(&mut follow));
        follow(&[]);
        assert_eq!(alarms.list().len(), OF_NODE_MAX + 1);
        assert_eq!(numbers(&alarms)[0], (1, B, false));
        assert_eq!(alarms.list().last().map(|alarm| alarm.id), Some(1001));
        let told: u32 = alarms.list()[1..].iter().map(|alarm| 1 + alarm.repeats).sum();
        assert_eq!((told, alarms.take_lost()), (1000, (1000 - OF_NODE_MAX as u64, 0)));
    }

    #[test]
    fn what_repeats_gives_way_to_what_was_there_once() {
        let mut alarms = Alarms::default();
        let mut follow = |roots: &[NodeId]| {
            alarms.follow(&calling(roots), |_| Vec::new(), Timestamp::ZERO, &mut Events::default());
        };
        follow(&[A]);
        follow(&[]);
        follow(&[A]);
        let others: Vec<NodeId> = (10..).take(KEPT_MAX).map(|id| NodeId::Module(ModuleId(id))).collect();
        follow(&others);
        follow(&[]);
        // The node's second alarm counts its first; an alarm of a node with one alarm is dropped and counted.
        assert_eq!((alarms.list().len(), alarms.take_lost()), (KEPT_MAX, (1, 1)));
        assert_eq!(numbers(&alarms)[0], (3, others[0], false));
    }
}
