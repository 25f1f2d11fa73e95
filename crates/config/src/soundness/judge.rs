//! The state of every node in a situation with given reports: the rules of masking at one instant, without
//! time. Tests compare it with the engine.

use super::situation::Situation;
use telltale_engine::mask::rules::{self, Standing};
use telltale_engine::model::order::Visit;
use telltale_engine::model::{Combine, Dependency, GroupId, Model, ModuleId, NodeId};
use telltale_engine::state::{State, Tally};

/// The model, with prepared answers to frequent questions.
#[derive(Debug)]
pub struct Judge<'m> {
    pub model: &'m Model,
    visits: Vec<Visit>,
    /// Folds redundant groups by their worst member too: then nothing can fail more than with every module in
    /// ERROR. In the real fold, a member without members may keep a redundant group from ERROR until something
    /// masks it.
    pub pessimistic: bool,
    /// The members of each group: its groups, then its modules.
    pub members: Vec<Vec<NodeId>>,
}

/// The result for one node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JudgedNode {
    pub relevant: bool,
    pub blocked: bool,
    pub own: State,
    pub shown: State,
    /// A visible failing module, or a visible group without members, causes the blockage.
    pub block_explained: bool,
    /// The same for its failure.
    pub failure_explained: bool,
}

/// The results for all nodes.
#[derive(Debug)]
pub struct Picture {
    groups: Vec<JudgedNode>,
    modules: Vec<JudgedNode>,
}

const UNSEEN: JudgedNode = JudgedNode {
    relevant: false,
    blocked: false,
    own: State::Ignore,
    shown: State::Ignore,
    block_explained: false,
    failure_explained: false,
};

impl JudgedNode {
    pub fn masked(&self) -> bool {
        self.relevant && self.blocked
    }

    fn standing(&self) -> Standing {
        Standing { relevant: self.relevant, blocked: self.blocked, shown: self.shown, own: self.own }
    }
}

impl Picture {
    pub fn is_blocked_by(&self, dependency: &Dependency) -> bool {
        dependency.blocks(|node| self.of(node).standing())
    }

    pub fn of(&self, node: NodeId) -> &JudgedNode {
        match node {
            NodeId::Group(id) => &self.groups[id.0 as usize],
            NodeId::Module(id) => &self.modules[id.0 as usize],
        }
    }
}

impl<'m> Judge<'m> {
    pub fn new(model: &'m Model) -> Judge<'m> {
        Judge { model, visits: model.visits(), pessimistic: false, members: model.members() }
    }

    /// Whether statuses may create modules in the group at run time.
    pub fn discovers(&self, id: GroupId) -> bool {
        !self.model.groups[id.0 as usize].filters.is_empty() && self.model.limits.discovered_modules > 0
    }

    /// Judges all nodes. `discovered` is the report of a module that a filter could make, one in each group
    /// with filters.
    pub fn picture(
        &self,
        situation: &Situation,
        reports: impl Fn(ModuleId) -> State,
        discovered: Option<State>,
    ) -> Picture {
        let groups = vec![UNSEEN; self.model.groups.len()];
        let mut picture = Picture { groups, modules: vec![UNSEEN; self.model.modules.len()] };
        for &visit in &self.visits {
            match visit {
                Visit::Enter(id) => {
                    picture.groups[id.0 as usize] = self.entered(&picture, situation, NodeId::Group(id));
                }
                Visit::Module(id) => {
                    let entered = self.entered(&picture, situation, NodeId::Module(id));
                    let own = reports(id);
                    let shown = rules::shown(entered.relevant, entered.blocked, own);
                    let failure_explained = shown > State::Warning || entered.block_explained;
                    picture.modules[id.0 as usize] = JudgedNode { own, shown, failure_explained, ..entered };
                }
                Visit::Leave(id) => {
                    picture.groups[id.0 as usize] = self.left(&picture, situation, id, discovered);
                }
            }
        }
        picture
    }

    fn entered(&self, picture: &Picture, situation: &Situation, node: NodeId) -> JudgedNode {
        let around = self.model.parent(node).map(|group| *picture.of(NodeId::Group(group)));
        let relevant = around.is_none_or(|group| group.relevant) && situation.meets(self.model.when(node));
        let mut blocked = around.is_some_and(|group| group.blocked);
        let mut block_explained = around.is_some_and(|group| group.block_explained);
        for dependency in self.model.depends_on(node).iter().filter(|it| picture.is_blocked_by(it)) {
            blocked = true;
            block_explained |= dependency.targets().iter().any(|&target| {
                let facts = picture.of(target);
                if facts.blocked { facts.block_explained } else { facts.failure_explained }
            });
        }
        JudgedNode { relevant, blocked, block_explained, ..UNSEEN }
    }

    fn left(
        &self,
        picture: &Picture,
        situation: &Situation,
        id: GroupId,
        discovered: Option<State>,
    ) -> JudgedNode {
        let facts = *picture.of(NodeId::Group(id));
        let discovered = discovered.filter(|_| self.discovers(id));
        let members = &self.members[id.0 as usize];
        let nobody = members.is_empty() && discovered.is_none();
        let (mut shown, mut own) = (Tally::default(), Tally::default());
        for &member in members {
            let member = picture.of(member);
            shown.add(member.shown);
            own.add(member.standing().own_share());
        }
        // A discovered module has no condition; without a condition a node is not relevant while locked.
        if let Some(state) = discovered.filter(|_| facts.relevant && situation.meets(None)) {
            own.add(state);
            shown.add(rules::shown(facts.relevant, facts.blocked, state));
        }
        let may_be_empty = self.model.groups[id.0 as usize].may_be_empty;
        let alone = nobody.then_some(if may_be_empty { State::Ok } else { State::Unknown });
        let combine = match self.model.groups[id.0 as usize].combine {
            Combine::Any if !self.pessimistic => Combine::Any,
            Combine::Any | Combine::Worst => Combine::Worst,
        };
        let shown = rules::shown_group(facts.standing(), combine, &shown, alone);
        let own = rules::fold(combine, &own, alone);
        let group = JudgedNode { shown, own, ..facts };
        let to_blame = |&member: &NodeId| {
            let member = picture.of(member);
            member.standing().is_responsible_for(group.standing()) && member.failure_explained
        };
        let failure_explained = facts.block_explained
            || nobody
            || discovered.is_some_and(|state| state >= group.standing().worst())
            || members.iter().any(to_blame);
        JudgedNode { failure_explained, ..group }
    }
}
