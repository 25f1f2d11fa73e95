//! The rules of masking, each once: when a node is relevant, which dependencies block it, and how a group folds
//! its members.
//!
//! Each rule is a function of one instant. The engine applies it to the nodes that changed; the check of a
//! configuration applies it to a whole vehicle in every situation.

use crate::engine::model::{Combine, Dependency, DependsOn, NodeId, Stage, When};
use crate::engine::state::{State, Tally};

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

    fn fails(self, masks_unknown: bool) -> bool {
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

/// The shown state of a node with the own state `state`.
pub fn shown(relevant: bool, blocked: bool, state: State) -> State {
    if relevant && !blocked { state } else { State::Ignore }
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
    /// The built-in signal [`POSED_SIGNAL`](crate::engine::model::POSED_SIGNAL).
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
    use crate::engine::model::GroupId;

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
        let set = Dependency { on, masks_unknown: false };
        let failed = Standing { shown: State::Error, ..HEALTHY };
        let only_first = |node| if node == NodeId::Group(GroupId(0)) { failed } else { HEALTHY };
        assert!(set.blocks(|_| failed) && !set.blocks(only_first));
    }

    #[test]
    fn a_group_without_members_is_not_one_whose_members_are_ignored() {
        let mut ignored = Tally::default();
        ignored.add(State::Ignore);
        assert_eq!(fold(Combine::Worst, &ignored, None), State::Ignore);
        assert_eq!(fold(Combine::Any, &Tally::default(), Some(State::Unknown)), State::Unknown);
    }
}
