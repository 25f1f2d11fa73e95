//! Alarms: one for each root cause, with a number that lasts (`ENGINE.md` 6).

use std::collections::{HashMap, HashSet};

use super::event::{Events, What};
use super::model::NodeId;
use super::snapshot::Alarm;
use super::time::Timestamp;

/// Alarms that are kept once they are over and not acknowledged. A module that comes and goes
/// makes a new one each time: past this the oldest that is over is dropped.
const KEPT_MAX: usize = 256;

/// All alarms that are active or not acknowledged.
#[derive(Debug, Default)]
pub(super) struct Alarms {
    list: Vec<Alarm>,
    last_id: u64,
}

impl Alarms {
    pub(super) fn list(&self) -> &[Alarm] {
        &self.list
    }

    /// Takes over alarms under new ids; one whose node is gone is over.
    pub(super) fn copy(&mut self, old: &Alarms, renamed: impl Fn(NodeId) -> Option<NodeId>) {
        self.last_id = old.last_id;
        let kept =
            old.list.iter().filter_map(|alarm| Some(Alarm { node: renamed(alarm.node)?, ..alarm.clone() }));
        self.list = kept.collect();
    }

    /// Takes the present root causes, ranked. `explained` tells for a former root the causes
    /// that mask it now: its alarm moves to the first of them that has none yet, and keeps its
    /// number. Returns whether anything changed.
    pub(super) fn follow(
        &mut self,
        roots: &[NodeId],
        explained: impl Fn(NodeId) -> Vec<NodeId>,
        now: Timestamp,
        events: &mut Events,
    ) -> bool {
        let mut active: HashMap<NodeId, usize> = HashMap::new();
        for (index, alarm) in self.list.iter().enumerate().filter(|(_, alarm)| alarm.active) {
            active.insert(alarm.node, index);
        }
        let present: HashSet<NodeId> = roots.iter().copied().collect();
        let mut changed = false;
        let mut gone: Vec<usize> =
            active.iter().filter(|(node, _)| !present.contains(node)).map(|(_, &index)| index).collect();
        gone.sort_unstable();
        for index in gone {
            changed = true;
            let causes = explained(self.list[index].node);
            let heir = causes.into_iter().find(|node| present.contains(node) && !active.contains_key(node));
            let alarm = &mut self.list[index];
            active.remove(&alarm.node);
            match heir {
                Some(node) => {
                    events.push(now, What::AlarmMoved { id: alarm.id, symptom: alarm.node, cause: node });
                    alarm.node = node;
                    alarm.acknowledged = false;
                    active.insert(node, index);
                }
                None => {
                    events.push(now, What::AlarmCleared { id: alarm.id, node: alarm.node });
                    alarm.active = false;
                }
            }
        }
        for &node in roots {
            if !active.contains_key(&node) {
                changed = true;
                self.last_id += 1;
                events.push(now, What::AlarmRaised { id: self.last_id, node });
                self.list.push(Alarm {
                    id: self.last_id,
                    node,
                    raised: now,
                    acknowledged: false,
                    active: true,
                });
            }
        }
        if changed {
            self.list.retain(|alarm| alarm.active || !alarm.acknowledged);
            self.drop_oldest();
        }
        changed
    }

    fn drop_oldest(&mut self) {
        let over = self.list.iter().filter(|alarm| !alarm.active).count();
        let mut surplus = over.saturating_sub(KEPT_MAX);
        self.list.retain(|alarm| {
            let drop = !alarm.active && surplus > 0;
            surplus -= usize::from(drop);
            !drop
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::ModuleId;
    use super::*;

    const A: NodeId = NodeId::Module(ModuleId(0));
    const B: NodeId = NodeId::Module(ModuleId(1));
    const C: NodeId = NodeId::Module(ModuleId(2));

    fn numbers(alarms: &Alarms) -> Vec<(u64, NodeId, bool)> {
        alarms.list().iter().map(|alarm| (alarm.id, alarm.node, alarm.active)).collect()
    }

    #[test]
    fn a_root_that_returns_is_a_new_alarm() {
        let mut alarms = Alarms::default();
        let none = |_| Vec::new();
        assert!(alarms.follow(&[A], none, Timestamp::ZERO, &mut Events::default()));
        assert!(!alarms.follow(&[A], none, Timestamp::ZERO, &mut Events::default()));
        alarms.follow(&[], none, Timestamp::ZERO, &mut Events::default());
        alarms.follow(&[A], none, Timestamp::ZERO, &mut Events::default());
        assert_eq!(numbers(&alarms), [(1, A, false), (2, A, true)]);
    }

    #[test]
    fn of_several_symptoms_the_first_number_moves_to_the_cause_and_the_rest_close() {
        let mut alarms = Alarms::default();
        alarms.follow(&[A], |_| Vec::new(), Timestamp::ZERO, &mut Events::default());
        alarms.follow(&[A, B], |_| Vec::new(), Timestamp::ZERO, &mut Events::default());
        alarms.follow(&[C], |_| vec![C], Timestamp::ZERO, &mut Events::default());
        assert_eq!(numbers(&alarms), [(1, C, true), (2, B, false)]);
    }

    #[test]
    fn flapping_does_not_grow_without_bound() {
        let mut alarms = Alarms::default();
        for _ in 0..1000 {
            alarms.follow(&[A], |_| Vec::new(), Timestamp::ZERO, &mut Events::default());
            alarms.follow(&[], |_| Vec::new(), Timestamp::ZERO, &mut Events::default());
        }
        assert_eq!(alarms.list().len(), KEPT_MAX);
        assert_eq!(alarms.list().last().map(|alarm| alarm.id), Some(1000));
    }
}
