//! A group that dropped names says so: it is at least WARNING, and no group becomes better by that.

use super::rules;
use crate::model::Combine;
use crate::state::{State, Tally};

/// Whether a group is WARNING, and would be ignored if it had dropped no names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct OnlyDropped {
    pub(crate) shown: bool,
    pub(crate) own: bool,
}

/// How many members of a group are WARNING for that reason alone.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct OnlyDroppedCount {
    pub(crate) shown: u32,
    pub(crate) own: u32,
}

impl OnlyDroppedCount {
    pub(crate) fn replace(&mut self, before: OnlyDropped, after: OnlyDropped) {
        self.shown = self.shown + u32::from(after.shown) - u32::from(before.shown);
        self.own = self.own + u32::from(after.own) - u32::from(before.own);
    }
}

/// The fold of a group's members, `only_dropped` of them WARNING by dropped names alone, and whether the group
/// is. `says`: the group dropped names itself.
pub(crate) fn fold(
    combine: Combine,
    members: &Tally,
    only_dropped: u32,
    alone: Option<State>,
    says: bool,
) -> (State, bool) {
    // Beside a failed member of a redundant group such a WARNING would be the better one.
    let mut others = *members;
    for _ in 0..only_dropped {
        others.remove(State::Warning);
        others.add(State::Ignore);
    }
    let state = rules::fold(combine, &others, alone);
    let rises = match state {
        State::Ignore => says || only_dropped > 0,
        State::Ok => says || only_dropped > 0 && combine == Combine::Worst,
        State::Warning | State::Unknown | State::Error => false,
    };
    if rises { (State::Warning, state == State::Ignore) } else { (state, false) }
}
