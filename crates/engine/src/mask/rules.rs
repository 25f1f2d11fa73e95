//! The rules of masking, each once: when a node is relevant, which dependencies block it, and how a group folds
//! its members.
//!
//! Each rule is a function of one instant. The engine applies it to the nodes that changed; the check of a
//! configuration applies it to a whole vehicle in every situation.

use crate::model::lateness::Beginning;
use crate::model::{Combine, Dependency, DependsOn, NodeId, Stage, When, Within};
use crate::state::{State, Tally};
use crate::time::{Span, Timestamp};

/// The facts of a node that the rules use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Standing {
    pub relevant: bool,
    pub blocked: bool,
    pub shown: State,
    /// The state that it would show if nothing were masked.
    pub own: State,
}

impl Standing {
    /// The worse of the shown state and the own state.
    pub fn worst(self) -> State {
        self.shown.max(self.own)
    }

    /// Whether the node fails for a dependency on it.
    pub fn fails(self, masks_unknown: bool) -> bool {
        let worst = self.worst();
        self.relevant && (worst == State::Error || masks_unknown && worst == State::Unknown)
    }

    /// Whether the node blocks a dependency on it. A node that is not relevant passes a blockage on, but keeps
    /// a redundancy set open.
    pub fn blocks(self, any_of: bool, masks_unknown: bool) -> bool {
        let fails = self.fails(masks_unknown);
        if any_of { self.relevant && (self.blocked || fails) } else { self.blocked || fails }
    }

    /// The node's contribution to the own state of its group.
    pub fn own_share(self) -> State {
        if self.relevant { self.own } else { State::Ignore }
    }

    /// Whether the group fails because of this member: it is as bad as the group, or worse.
    pub fn is_responsible_for(self, group: Standing) -> bool {
        self.relevant && self.worst() >= group.worst()
    }
}

impl Dependency {
    /// The nodes of the dependency.
    pub fn targets(&self) -> &[NodeId] {
        self.on.nodes()
    }

    /// Whether the dependency is a redundancy set.
    pub fn is_any_of(&self) -> bool {
        matches!(self.on, DependsOn::AnyOf(_))
    }

    /// Whether the dependency blocks its holder: every node in it blocks.
    pub fn blocks(&self, standing: impl Fn(NodeId) -> Standing) -> bool {
        let blocks = |&node: &NodeId| standing(node).blocks(self.is_any_of(), self.masks_unknown);
        self.targets().iter().all(blocks)
    }
}

/// The beginnings of several faults, as they are compared with those of another one. Each list is sorted.
#[derive(Debug, Clone, Default)]
pub struct Beginnings {
    /// The notices of all.
    noticed: Vec<Timestamp>,
    /// The estimated instants.
    began: Vec<Timestamp>,
    /// The notices of those without an estimate.
    vague: Vec<Timestamp>,
}

impl FromIterator<Beginning> for Beginnings {
    fn from_iter<I: IntoIterator<Item = Beginning>>(all: I) -> Beginnings {
        let mut found = Beginnings::default();
        for Beginning { noticed, began } in all {
            found.noticed.push(noticed);
            match began {
                Some(began) => found.began.push(began),
                None => found.vague.push(noticed),
            }
        }
        for list in [&mut found.noticed, &mut found.began, &mut found.vague] {
            list.sort_unstable();
            list.dedup();
        }
        found
    }
}

impl Within {
    /// Whether a fault with one of the beginnings `effect` may follow from one with the beginnings `causes`. Estimates are
    /// compared with estimates, and notices where the one or the other has no estimate.
    pub fn explains(self, effect: impl IntoIterator<Item = Beginning>, causes: &Beginnings) -> bool {
        let Within::Limit(limit) = self else { return true };
        effect.into_iter().any(|Beginning { noticed, began }| match began {
            Some(began) => is_near(&causes.began, began, limit) || is_near(&causes.vague, noticed, limit),
            None => is_near(&causes.noticed, noticed, limit),
        })
    }
}

/// Whether one of the sorted instants is at most `limit` away from this one.
fn is_near(sorted: &[Timestamp], at: Timestamp, limit: Span) -> bool {
    let after = sorted.partition_point(|&other| other < at);
    let near = |other: &Timestamp| other.since(at).max(at.since(*other)) <= limit;
    sorted.get(after).is_some_and(near) || after.checked_sub(1).is_some_and(|it| near(&sorted[it]))
}

/// Whether a module is masked. One in ERROR is masked only while a cause explains it: otherwise it is a second
/// fault.
pub fn is_masked(relevant: bool, blocked: bool, own: State, is_explained: impl FnOnce() -> bool) -> bool {
    relevant && blocked && (own != State::Error || is_explained())
}

/// The shown state of a module with the own state `own`.
pub fn shown(relevant: bool, masked: bool, own: State) -> State {
    if relevant && !masked { own } else { State::Ignore }
}

/// The shown state of a group: the fold of its members, blocked or not. A blocked group without members waits.
pub fn shown_group(standing: Standing, combine: Combine, members: &Tally, alone: Option<State>) -> State {
    if !standing.relevant {
        return State::Ignore;
    }
    fold(combine, members, alone.filter(|_| !standing.blocked))
}

/// The fold of a group's members. `alone` is the state of a group without members; a group whose members are
/// all ignored is ignored.
pub fn fold(combine: Combine, members: &Tally, alone: Option<State>) -> State {
    let folded = match combine {
        Combine::Worst => members.worst(),
        Combine::Any => members.best(),
    };
    folded.or(alone).unwrap_or(State::Ignore)
}

/// A condition that does not hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unmet {
    Stage,
    /// The built-in signal [`POSED_SIGNAL`](crate::model::POSED_SIGNAL).
    Posed,
    /// The signal of this index, and its present value.
    Signal(usize, bool),
}

/// The first condition that does not hold. An unknown signal meets every condition: only nodes that are known
/// to be irrelevant are not diagnosed.
pub fn unmet(
    when: Option<&When>,
    stage: Stage,
    posed: bool,
    signal: impl Fn(usize) -> Option<bool>,
) -> Option<Unmet> {
    let in_stage = match when {
        Some(when) if !when.stages.is_empty() => when.stages.contains(&stage),
        Some(_) | None => stage != Stage::Locked,
    };
    if !in_stage {
        return Some(Unmet::Stage);
    }
    let when = when?;
    if when.posed.is_some_and(|wanted| wanted != posed) {
        return Some(Unmet::Posed);
    }
    when.signals.iter().find_map(|&(index, wanted)| {
        let value = signal(index).filter(|&value| value != wanted)?;
        Some(Unmet::Signal(index, value))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::GroupId;

    const HEALTHY: Standing = Standing { relevant: true, blocked: false, shown: State::Ok, own: State::Ok };

    #[test]
    fn a_member_blocks_by_what_it_shows_or_hides_and_an_idle_one_only_passes_on() {
        let shows = |shown| Standing { shown, own: shown, ..HEALTHY };
        let hides = Standing { blocked: true, shown: State::Ignore, own: State::Error, ..HEALTHY };
        let idle = Standing { relevant: false, shown: State::Ignore, own: State::Error, ..HEALTHY };
        let idle_blocked = Standing { blocked: true, ..idle };
        // The member, and whether it blocks: by itself, with UNKNOWN as a masking state, and in a redundancy
        // set.
        for (member, expected) in [
            (HEALTHY, [false, false, false]),
            (shows(State::Warning), [false, false, false]),
            (shows(State::Unknown), [false, true, false]),
            (shows(State::Error), [true, true, true]),
            (hides, [true, true, true]),
            (idle, [false, false, false]),
            (idle_blocked, [true, true, false]),
        ] {
            let found = [member.blocks(false, false), member.blocks(false, true), member.blocks(true, false)];
            assert_eq!(found, expected, "{member:?}");
        }
    }

    #[test]
    fn a_redundancy_set_blocks_when_every_member_does() {
        let on = DependsOn::AnyOf(vec![NodeId::Group(GroupId(0)), NodeId::Group(GroupId(1))]);
        let set = Dependency { on, masks_unknown: false, within: Within::default() };
        let failed = Standing { shown: State::Error, ..HEALTHY };
        let only_first = |node| if node == NodeId::Group(GroupId(0)) { failed } else { HEALTHY };
        assert!(set.blocks(|_| failed) && !set.blocks(only_first));
    }

    /// Of a notice in milliseconds, and of an estimate.
    fn begun((noticed, began): (u64, Option<u64>)) -> Beginning {
        Beginning { noticed: Timestamp::from_millis(noticed), began: began.map(Timestamp::from_millis) }
    }

    #[test]
    fn a_cause_explains_what_began_near_it_the_limit_included() {
        let limit = Within::Limit(Span::from_millis(5));
        for (effect, cause, expected) in [
            (&[10][..], &[5][..], true),
            (&[10], &[4], false),
            (&[10], &[15], true),
            (&[10], &[16], false),
            (&[10], &[1, 4, 16, 30], false),
            (&[10], &[1, 7, 30], true),
            (&[10, 40], &[1, 36], true),
            (&[10], &[], false),
        ] {
            for is_known in [false, true] {
                let all = |ms: &'static [u64]| ms.iter().map(move |&ms| begun((ms, is_known.then_some(ms))));
                let causes = all(cause).collect();
                assert_eq!(limit.explains(all(effect), &causes), expected, "{effect:?} {cause:?}");
                assert!(Within::Always.explains(all(effect), &causes));
            }
        }
    }

    #[test]
    fn estimated_beginnings_count_in_place_of_notices_where_both_have_them() {
        let limit = Within::Limit(Span::from_millis(5));
        for (effect, cause, expected) in [
            // Noticed late, and begun together.
            ((20, Some(10)), (10, Some(10)), true),
            ((20, None), (10, Some(10)), false),
            // Noticed together, and begun apart.
            ((20, Some(10)), (20, Some(20)), false),
            ((20, Some(10)), (20, None), true),
        ] {
            let causes = [begun(cause)].into_iter().collect();
            assert_eq!(limit.explains([begun(effect)], &causes), expected, "{effect:?} {cause:?}");
        }
    }

    #[test]
    fn a_group_without_members_is_not_one_whose_members_are_ignored() {
        let mut ignored = Tally::default();
        ignored.add(State::Ignore);
        assert_eq!(fold(Combine::Worst, &ignored, None), State::Ignore);
        assert_eq!(fold(Combine::Any, &Tally::default(), Some(State::Unknown)), State::Unknown);
    }
}
