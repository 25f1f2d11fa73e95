//! Masking and root causes, computed slowly from the definitions, with no state between instants. The
//! modules' own states and the stage are taken from the snapshots; everything else must follow from them. Only the
//! beginnings of faults need what was before: [`Times`] notes it.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use telltale::engine::model::lateness::Notice;
use telltale::engine::model::{
    Combine, Dependency, DependsOn, GroupId, Model, ModuleId, NodeId, Other, Policy, Stage, When, Within,
};
use telltale::engine::snapshot::Snapshot;
use telltale::engine::state::State;
use telltale::engine::time::Span;

use super::times::{Begun, Times};

pub struct Oracle<'a> {
    model: &'a Model,
    snapshot: &'a Snapshot,
    blocked: HashMap<NodeId, bool>,
    shown: HashMap<NodeId, State>,
    own: HashMap<NodeId, State>,
    explained: HashMap<NodeId, bool>,
    times: &'a Times,
}

impl<'a> Oracle<'a> {
    /// The times have seen this snapshot, but not yet what it shows.
    pub fn new(model: &'a Model, snapshot: &'a Snapshot, times: &'a Times) -> Oracle<'a> {
        Oracle {
            model,
            snapshot,
            blocked: HashMap::new(),
            shown: HashMap::new(),
            own: HashMap::new(),
            explained: HashMap::new(),
            times,
        }
    }

    pub fn nodes(&self) -> Vec<NodeId> {
        let groups = (0..self.snapshot.layout.groups.len() as u32).map(|id| NodeId::Group(GroupId(id)));
        groups.chain(self.snapshot.module_ids().map(NodeId::Module)).collect()
    }

    /// The module about dropped names is not a member.
    fn says_overflow(&self, id: ModuleId) -> bool {
        self.snapshot.layout.modules[id.0 as usize].id.ends_with("/(names past the limit)")
    }

    pub fn overflowed(&self, id: GroupId) -> bool {
        let info = &self.snapshot.layout.groups[id.0 as usize];
        info.modules.iter().any(|&id| self.says_overflow(id))
    }

    pub fn members(&self, id: GroupId) -> Vec<NodeId> {
        let info = &self.snapshot.layout.groups[id.0 as usize];
        let modules = info.modules.iter().filter(|&&id| !self.says_overflow(id));
        let modules = modules.map(|&id| NodeId::Module(id));
        info.groups.iter().map(|&id| NodeId::Group(id)).chain(modules).collect()
    }

    pub fn parent(&self, node: NodeId) -> Option<GroupId> {
        match node {
            NodeId::Group(id) => self.snapshot.layout.groups[id.0 as usize].parent,
            NodeId::Module(id) => Some(self.snapshot.layout.modules[id.0 as usize].group),
        }
    }

    /// Belongs to the statuses that no group takes, if these are not counted.
    pub fn is_aside(&self, node: NodeId) -> bool {
        let group = match node {
            NodeId::Group(id) => id,
            NodeId::Module(id) => self.snapshot.layout.modules[id.0 as usize].group,
        };
        self.snapshot.layout.groups[group.0 as usize].is_other && self.model.other != Other::Counted
    }

    fn when(&self, node: NodeId) -> Option<&'a When> {
        match node {
            NodeId::Group(id) => self.model.groups.get(id.0 as usize)?.when.as_ref(),
            NodeId::Module(id) => self.model.modules.get(id.0 as usize)?.when.as_deref(),
        }
    }

    /// A node and the groups around it, from the inside out.
    fn around(&self, node: NodeId) -> Vec<NodeId> {
        let mut list = vec![node];
        while let Some(parent) = self.parent(*list.last().expect("never empty")) {
            list.push(NodeId::Group(parent));
        }
        list
    }

    pub fn relevant(&self, node: NodeId) -> bool {
        self.around(node).into_iter().all(|node| self.holds(self.when(node)))
    }

    /// The built-in signal.
    pub fn posed(&self) -> bool {
        match self.snapshot.stage {
            Stage::Locked => false,
            Stage::Localizing => self.snapshot.localization.given.is_some(),
            Stage::Standby | Stage::Cleared | Stage::Active => true,
        }
    }

    fn holds(&self, when: Option<&When>) -> bool {
        let stage = self.snapshot.stage;
        let in_stage = match when {
            Some(when) if !when.stages.is_empty() => when.stages.contains(&stage),
            _ => stage != Stage::Locked,
        };
        let posed = self.posed();
        in_stage
            && when.is_none_or(|when| {
                when.posed.is_none_or(|wanted| wanted == posed)
                    && when.signals.iter().all(|&(index, wanted)| {
                        self.snapshot.signals[index].1.is_none_or(|value| value == wanted)
                    })
            })
    }

    /// D(n): its own dependencies and those of every group around it.
    pub fn dependencies(&self, node: NodeId) -> Vec<&'a Dependency> {
        self.around(node)
            .into_iter()
            .flat_map(|node| match node {
                NodeId::Group(id) => self.model.groups.get(id.0 as usize).map(|spec| &spec.depends_on),
                NodeId::Module(id) => self.model.modules.get(id.0 as usize).map(|spec| &spec.depends_on),
            })
            .flatten()
            .collect()
    }

    pub fn blocks(&mut self, dependency: &Dependency) -> bool {
        match &dependency.on {
            DependsOn::Node(node) => {
                self.blocked(*node) || (self.relevant(*node) && self.fails(*node, dependency.masks_unknown))
            }
            DependsOn::AnyOf(nodes) => nodes.iter().all(|&node| {
                self.relevant(node) && (self.blocked(node) || self.fails(node, dependency.masks_unknown))
            }),
        }
    }

    fn fails(&mut self, node: NodeId, masks_unknown: bool) -> bool {
        [self.shown(node), self.own(node)]
            .into_iter()
            .any(|state| state == State::Error || (masks_unknown && state == State::Unknown))
    }

    pub fn blocked(&mut self, node: NodeId) -> bool {
        if let Some(&known) = self.blocked.get(&node) {
            return known;
        }
        let blocked = self.dependencies(node).into_iter().any(|dependency| self.blocks(dependency));
        self.blocked.insert(node, blocked);
        blocked
    }

    pub fn own(&mut self, node: NodeId) -> State {
        let id = match node {
            NodeId::Module(id) => return self.snapshot.modules[id.0 as usize].own,
            NodeId::Group(id) => id,
        };
        if let Some(&known) = self.own.get(&node) {
            return known;
        }
        let (own, _) = self.raised(id, false);
        self.own.insert(node, own);
        own
    }

    fn fold(&self, id: GroupId, members: &[NodeId], states: Vec<State>) -> State {
        let counted = states.into_iter().filter(|&state| state != State::Ignore);
        let folded = match self.model.groups.get(id.0 as usize).map(|spec| spec.combine) {
            Some(Combine::Any) => counted.min(),
            _ => counted.max(),
        };
        let counted =
            self.snapshot.layout.groups[id.0 as usize].is_other && !self.is_aside(NodeId::Group(id));
        let may_be_empty = self.model.groups.get(id.0 as usize).is_some_and(|group| group.may_be_empty);
        let empty = if counted || may_be_empty { State::Ok } else { State::Unknown };
        folded.unwrap_or(if members.is_empty() { empty } else { State::Ignore })
    }

    /// The fold of a group by what its members show, or by their own states, at least WARNING if names were
    /// dropped, and whether it would be ignored otherwise. No group becomes better by that.
    fn raised(&mut self, id: GroupId, shown: bool) -> (State, bool) {
        let members = self.members(id);
        let (mut states, mut any_only) = (Vec::new(), false);
        for &member in &members {
            let (state, only) = match member {
                _ if !self.relevant(member) => (State::Ignore, false),
                NodeId::Module(_) if shown => (self.shown(member), false),
                NodeId::Module(_) => (self.own(member), false),
                NodeId::Group(id) => self.raised(id, shown),
            };
            any_only |= only;
            states.push(if only { State::Ignore } else { state });
        }
        let waits = shown && self.blocked(NodeId::Group(id));
        let state = if waits && members.is_empty() { State::Ignore } else { self.fold(id, &members, states) };
        let says = self.overflowed(id) && self.relevant(NodeId::Group(id)) && !waits;
        let is_worst = self.model.groups.get(id.0 as usize).is_none_or(|it| it.combine == Combine::Worst);
        let rises = match state {
            State::Ignore => says || any_only,
            State::Ok => says || any_only && is_worst,
            _ => false,
        };
        if rises { (State::Warning, state == State::Ignore) } else { (state, false) }
    }

    pub fn shown(&mut self, node: NodeId) -> State {
        if !self.relevant(node) {
            return State::Ignore;
        }
        let id = match node {
            NodeId::Module(_) if self.masked(node) => return State::Ignore,
            NodeId::Module(id) => return self.snapshot.modules[id.0 as usize].own,
            NodeId::Group(id) => id,
        };
        if let Some(&known) = self.shown.get(&node) {
            return known;
        }
        let (shown, _) = self.raised(id, true);
        self.shown.insert(node, shown);
        shown
    }

    /// Shows IGNORE because a dependency fails: its own, or that of a member.
    pub fn masked(&mut self, node: NodeId) -> bool {
        if !self.relevant(node) {
            return false;
        }
        match node {
            NodeId::Module(_) => {
                self.blocked(node) && (self.own(node) != State::Error || self.explained(node))
            }
            NodeId::Group(id) => {
                self.shown(node) == State::Ignore
                    && (self.blocked(node) || self.members(id).into_iter().any(|member| self.masked(member)))
            }
        }
    }

    /// A blocked module in ERROR that no cause explains.
    fn second(&mut self, node: NodeId) -> bool {
        matches!(node, NodeId::Module(_)) && self.relevant(node) && self.blocked(node) && !self.masked(node)
    }

    /// Whether a dependency that blocks this module in ERROR explains it.
    pub fn explained(&mut self, node: NodeId) -> bool {
        let NodeId::Module(id) = node else { panic!("a group is not explained") };
        if let Some(&known) = self.explained.get(&node) {
            return known;
        }
        let blocking = self.blocking(node);
        let explained = blocking.into_iter().any(|dependency| {
            let limit = match dependency.within {
                Within::Always => return true,
                Within::Limit(limit) => limit,
            };
            let times = self.times.of(self.snapshot, id);
            if times.shown_longest(self.snapshot.now) > limit {
                return false;
            }
            let mut causes = BTreeSet::new();
            for target in targets(dependency) {
                self.failing_upstream(target, dependency.masks_unknown, &mut causes);
            }
            let effect = times.as_effect(limit, &self.late(id, limit));
            causes.into_iter().any(|(cause, masks_unknown)| {
                let begun = match cause {
                    NodeId::Module(id) => {
                        let late = self.late(id, limit);
                        self.times.of(self.snapshot, id).as_cause(masks_unknown, &late)
                    }
                    NodeId::Group(id) => self.times.of_group(id),
                };
                begun.iter().any(|&cause| effect.iter().any(|&effect| is_near(cause, effect, limit)))
            })
        });
        self.explained.insert(node, explained);
        explained
    }

    /// How long before its notice a fault of this module began, if that is known.
    fn late(&self, id: ModuleId, limit: Span) -> impl Fn(Notice) -> Option<Span> + use<'a> {
        let model = self.model;
        let policy = self.policy(id);
        move |notice| {
            let monitor = model.modules.get(id.0 as usize).map(|spec| &spec.monitor);
            model.lateness_of(monitor, policy, notice).known(limit)
        }
    }

    /// Of a discovered module: that of the first entry that takes its status.
    fn policy(&self, id: ModuleId) -> &'a Policy {
        let model = self.model;
        if let Some(spec) = model.modules.get(id.0 as usize) {
            return &spec.policy;
        }
        let info = &self.snapshot.layout.modules[id.0 as usize];
        let Some(status) = &info.status else { return &model.discovered };
        let of_group = match model.groups.get(info.group.0 as usize) {
            Some(group) => group.filters.iter().find(|it| it.takes(status)).and_then(|it| it.policy.as_ref()),
            None => model.unclaimed.policy.as_ref(),
        };
        of_group.unwrap_or(&model.discovered)
    }

    /// The failing modules and failing groups without members on the paths upstream through a node, each with
    /// whether UNKNOWN masks on the way to it.
    fn failing_upstream(&mut self, node: NodeId, masks_unknown: bool, found: &mut BTreeSet<(NodeId, bool)>) {
        let blocked = self.blocked(node);
        if blocked {
            for dependency in self.blocking(node) {
                for target in targets(dependency) {
                    self.failing_upstream(target, dependency.masks_unknown, found);
                }
            }
        }
        match node {
            NodeId::Module(_) => {
                let own = self.own(node);
                let fails = own == State::Error || own == State::Unknown && !blocked;
                if self.relevant(node) && fails {
                    found.insert((node, masks_unknown));
                }
            }
            NodeId::Group(id) if self.relevant(node) && self.fails(node, masks_unknown) => {
                if self.members(id).is_empty() && !blocked {
                    found.insert((node, masks_unknown));
                }
                for member in self.responsible(id) {
                    self.failing_upstream(member, masks_unknown, found);
                }
            }
            NodeId::Group(_) => {}
        }
    }

    fn blocking(&mut self, node: NodeId) -> Vec<&'a Dependency> {
        self.dependencies(node).into_iter().filter(|dependency| self.blocks(dependency)).collect()
    }

    fn responsible(&mut self, id: GroupId) -> Vec<NodeId> {
        let node = NodeId::Group(id);
        let bar = self.shown(node).max(self.own(node));
        let members = self.members(id).into_iter();
        members
            .filter(|&member| self.relevant(member) && self.shown(member).max(self.own(member)) >= bar)
            .collect()
    }

    /// The next nodes upstream of one that fails or is blocked.
    pub fn upstream(&mut self, node: NodeId) -> Vec<NodeId> {
        let mut next = Vec::new();
        if self.blocked(node) {
            next.extend(self.blocking(node).into_iter().flat_map(targets));
        }
        if let NodeId::Group(id) = node {
            next.extend(self.responsible(id));
        }
        next
    }

    /// The root causes of all that waits for a node: the dependencies that block it, and the members for which it
    /// fails.
    fn roots_through(&mut self, node: NodeId, masks_unknown: bool) -> BTreeSet<NodeId> {
        let mut found = self.roots_behind(node);
        let blocked = self.blocked(node);
        match node {
            NodeId::Module(_) if !blocked || self.second(node) => {
                found.insert(node);
            }
            NodeId::Group(id) if self.relevant(node) && self.fails(node, masks_unknown) => {
                if self.members(id).is_empty() && !blocked {
                    found.insert(node);
                }
                for member in self.responsible(id) {
                    found.extend(self.roots_through(member, true));
                }
            }
            _ => {}
        }
        found
    }

    /// The root causes behind the dependencies that block a node.
    fn roots_behind(&mut self, node: NodeId) -> BTreeSet<NodeId> {
        let mut found = BTreeSet::new();
        if self.blocked(node) {
            for dependency in self.blocking(node) {
                for target in targets(dependency) {
                    found.extend(self.roots_through(target, dependency.masks_unknown));
                }
            }
        }
        found
    }

    /// The root causes of a node that fails or is blocked, by itself.
    fn ends(&mut self, node: NodeId) -> BTreeSet<NodeId> {
        let id = match node {
            NodeId::Module(_) if self.masked(node) || !self.relevant(node) => {
                return self.roots_behind(node);
            }
            NodeId::Module(_) => return BTreeSet::from([node]),
            NodeId::Group(id) => id,
        };
        let mut found = BTreeSet::new();
        if self.shown(node) == State::Ignore {
            found.extend(self.roots_behind(node));
        } else if self.members(id).is_empty() {
            return BTreeSet::from([node]);
        }
        for member in self.responsible(id) {
            found.extend(self.ends(member));
        }
        found
    }

    /// The root causes of a node that shows ERROR or is masked.
    pub fn causes(&mut self, node: NodeId) -> BTreeSet<NodeId> {
        let NodeId::Group(id) = node else { return self.ends(node) };
        if self.shown(node) != State::Ignore {
            return self.ends(node);
        }
        let mut causes = self.roots_behind(node);
        for member in self.members(id) {
            if self.masked(member) {
                causes.extend(self.causes(member));
            }
        }
        causes
    }

    /// Root causes that have an alarm for sure: an ERROR, an UNKNOWN that is not given time any more, and
    /// one that hides a module in ERROR.
    pub fn calling(&mut self) -> BTreeSet<NodeId> {
        let mut calling: BTreeSet<NodeId> = self.roots().into_keys().collect();
        calling.retain(|&node| {
            let NodeId::Module(id) = node else {
                return !self.snapshot.roots.iter().any(|root| root.node == node && root.grace);
            };
            self.shown(node) == State::Error || !self.snapshot.modules[id.0 as usize].steps.grace
        });
        for node in self.nodes() {
            let hides = matches!(node, NodeId::Module(_)) && self.own(node) == State::Error;
            if hides && !self.is_aside(node) && self.masked(node) {
                calling.extend(self.causes(node));
            }
        }
        calling
    }

    /// All root causes with how many nodes show IGNORE because of each.
    pub fn roots(&mut self) -> BTreeMap<NodeId, u32> {
        let mut roots = BTreeMap::new();
        for node in self.nodes() {
            if self.is_aside(node) {
                continue;
            }
            if matches!(node, NodeId::Module(_)) && self.shown(node) == State::Error {
                roots.entry(node).or_insert(0);
            }
            // What says that names were dropped is in no count.
            let counts = !matches!(node, NodeId::Module(id) if self.says_overflow(id));
            if counts && self.masked(node) {
                for root in self.causes(node) {
                    *roots.entry(root).or_insert(0) += 1;
                }
            }
        }
        roots
    }
}

fn targets(dependency: &Dependency) -> Vec<NodeId> {
    match &dependency.on {
        DependsOn::Node(node) => vec![*node],
        DependsOn::AnyOf(nodes) => nodes.clone(),
    }
}

/// Estimates are compared where both have one, and notices otherwise.
fn is_near((noticed, began): Begun, (other_noticed, other_began): Begun, limit: Span) -> bool {
    let (one, other) = began.zip(other_began).unwrap_or((noticed, other_noticed));
    one.since(other).max(other.since(one)) <= limit
}
