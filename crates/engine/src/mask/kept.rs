//! The net in a keyframe: the own states, and the modules that were made while the engine ran. All other states
//! follow from these and are computed again.

use serde::{Deserialize, Serialize};

use super::net::Net;
use super::node::{GroupNode, ModuleKind, ModuleNode, new_node};
use crate::files::{KeyframeError, count};
use crate::model::{GroupId, ModuleId, NodeId};
use crate::module::OwnState;
use crate::module::system::SystemCheck;
use crate::time::Timestamp;

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct KeptNet {
    #[serde(deserialize_with = "count")]
    arrivals: u64,
    /// By [`GroupId`]: since when each is relevant.
    groups: Vec<Option<Timestamp>>,
    /// By [`GroupId`]: when the own state of each was last OK or WARNING before the present one.
    well: Vec<Option<Timestamp>>,
    /// By [`ModuleId`]: the declared modules and the built-in ones.
    modules: Vec<OwnState>,
    /// The modules after these.
    made: Vec<MadeModule>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct MadeModule {
    kind: ModuleKind,
    group: GroupId,
    #[serde(deserialize_with = "count")]
    arrival: u64,
    made_by: Option<u32>,
    own: OwnState,
}

impl Net {
    /// The number of modules that follow from the configuration: later ones were made while the engine ran.
    pub(crate) fn fixed(&self) -> usize {
        self.model.modules.len() + SystemCheck::ALL.len()
    }

    pub(crate) fn kept(&self) -> KeptNet {
        let Net {
            groups,
            modules,
            arrivals,
            // From the configuration.
            model: _,
            threshold: _,
            policies: _,
            built_in_policy: _,
            recounts: _,
            // From the states of the nodes.
            root: _,
            own_errors: _,
            locked: _,
            // Empty between two inputs.
            queue: _,
            left: _,
            forgotten: _,
            changes: _,
            graces: _,
            rearm: _,
            blocked_errors: _,
            beginnings: _,
            late: _,
        } = self;
        let (fixed, made) = modules.split_at(self.fixed());
        KeptNet {
            arrivals: *arrivals,
            groups: groups.iter().map(since).collect(),
            well: groups.iter().map(|group| group.well_until).collect(),
            modules: fixed.iter().map(|module| module.own.clone()).collect(),
            made: made.iter().map(MadeModule::of).collect(),
        }
    }

    /// Goes on with the state of a keyframe: `members` are the made modules of each group, in order. Nothing is
    /// judged yet.
    pub(crate) fn resume<'a>(
        &mut self,
        kept: KeptNet,
        members: impl Iterator<Item = &'a [ModuleId]>,
    ) -> Result<(), KeyframeError> {
        let KeptNet { arrivals, groups, well, modules, made } = kept;
        KeyframeError::unless_same("groups", groups.len(), self.groups.len())?;
        KeyframeError::unless_same("modules", modules.len(), self.modules.len())?;
        self.arrivals = arrivals;
        for (group, since) in self.groups.iter_mut().zip(groups) {
            group.relevant_since = since;
        }
        for (group, until) in self.groups.iter_mut().zip(well) {
            group.well_until = until;
        }
        for (module, own) in self.modules.iter_mut().zip(modules) {
            module.own = own;
        }
        for module in made {
            self.make_again(module)?;
        }
        let mut is_placed: Vec<bool> = self.modules.iter().map(|it| it.kind == ModuleKind::Gone).collect();
        is_placed[..self.fixed()].fill(true);
        for (members, group) in members.zip((0..).map(GroupId)) {
            for &id in members {
                let module = self.modules.get(id.0 as usize).filter(|it| it.node.parent == Some(group));
                let kind = module.map(|module| module.kind);
                if kind.is_none() || std::mem::replace(&mut is_placed[id.0 as usize], true) {
                    return Err(KeyframeError::new("a module is in a group to which it does not belong"));
                }
                if kind != Some(ModuleKind::Overflow) {
                    self.add_member(group, NodeId::Module(id));
                }
                self.mark_module(id);
            }
        }
        match is_placed.contains(&false) {
            true => Err(KeyframeError::new("a module is in no group")),
            false => Ok(()),
        }
    }

    fn make_again(&mut self, module: MadeModule) -> Result<(), KeyframeError> {
        let MadeModule { kind, group, arrival, made_by, own } = module;
        if group.0 as usize >= self.groups.len() {
            return Err(KeyframeError::new(format!("there is no group {}", group.0)));
        }
        let id = ModuleId(self.modules.len() as u32);
        let own = match kind {
            ModuleKind::Discovered => own,
            ModuleKind::Overflow if self.groups[group.0 as usize].overflow.replace(id).is_none() => own,
            ModuleKind::Gone => OwnState::new(false, Timestamp::ZERO),
            ModuleKind::Declared | ModuleKind::BuiltIn | ModuleKind::Overflow => {
                return Err(KeyframeError::new(format!("module {} cannot have been made", id.0)));
            }
        };
        let (node, rank) = (new_node(Some(group), &[]), self.leave_rank(group) - 1);
        self.modules.push(ModuleNode { kind, node, own, rank, arrival, made_by });
        Ok(())
    }
}

impl MadeModule {
    fn of(module: &ModuleNode) -> MadeModule {
        let ModuleNode { kind, node, own, rank: _, arrival, made_by } = module;
        // Every module is in a group.
        let group = node.parent.unwrap_or(GroupId(0));
        MadeModule { kind: *kind, group, arrival: *arrival, made_by: *made_by, own: own.clone() }
    }
}

fn since(group: &GroupNode) -> Option<Timestamp> {
    let GroupNode {
        relevant_since,
        // Kept beside it.
        well_until: _,
        // From the states of its members and dependencies.
        node: _,
        told: _,
        shown: _,
        own: _,
        masked: _,
        failing: _,
        second: _,
        only_dropped: _,
        dirty_leave: _,
        // The view has the members, in order.
        members: _,
        overflow: _,
        aside: _,
    } = group;
    *relevant_since
}
