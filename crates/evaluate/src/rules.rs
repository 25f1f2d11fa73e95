//! What each rule of diagnosis shows during a trial: ours by its engine, the others computed from what the modules report
//! by themselves.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use telltale_engine::model::{Model, ModuleId, NodeId};
use telltale_engine::snapshot::Snapshot;
use telltale_engine::state::State;

use super::track::Track;
use super::truth::is_bad;

/// The rules that are compared with ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// Each module raises its own alarm.
    Modules,
    /// The worst member of each top group, as diagnostic_aggregator has it.
    Aggregator,
    /// What directly depends on a fault is no cause, as `dependent` of Autoware's diagnostic graph has it.
    Dependent,
    /// What begins within five seconds of a fault belongs to it, as the time window of ros2_medkit has it.
    Window,
    /// Ours, without an end to what a cause explains.
    Always,
    /// Ours, without dependencies.
    Off,
}

impl Rule {
    pub const ALL: [Rule; 6] =
        [Rule::Modules, Rule::Aggregator, Rule::Dependent, Rule::Window, Rule::Always, Rule::Off];

    pub const fn name(self) -> &'static str {
        match self {
            Rule::Modules => "modules",
            Rule::Aggregator => "aggregator",
            Rule::Dependent => "dependent",
            Rule::Window => "window",
            Rule::Always => "always",
            Rule::Off => "off",
        }
    }
}

const WINDOW_MS: u64 = 5_000;

/// What a display says from this instant on.
#[derive(Debug, Clone, PartialEq)]
pub struct Said {
    pub ms: u64,
    /// The causes, the first one on top.
    pub causes: Vec<NodeId>,
    /// The modules and groups that it shows as faulty.
    pub faulty: BTreeSet<NodeId>,
    /// Alarms since the start.
    pub alarms: u64,
}

/// What an engine showed.
pub fn of_engine(track: &Track) -> Vec<Said> {
    let said = |(ms, snapshot): &(u64, Arc<Snapshot>)| {
        let roots = snapshot.roots.iter().filter(|root| !root.grace && is_bad(snapshot.shown(root.node).0));
        let mut causes: Vec<NodeId> = roots.map(|root| root.node).collect();
        // A WARNING is listed below the root causes.
        let warnings = snapshot.module_ids().filter(|id| snapshot.module(*id).1.state == State::Warning);
        let mut warnings: Vec<ModuleId> =
            warnings.filter(|id| !causes.contains(&NodeId::Module(*id))).collect();
        warnings.sort_by_key(|id| snapshot.module(*id).1.since);
        causes.extend(warnings.into_iter().map(NodeId::Module));
        causes.retain(|node| counts(snapshot, *node));
        let faulty = snapshot.nodes().filter(|node| is_bad(snapshot.shown(*node).0)).collect();
        Said { ms: *ms, causes, faulty, alarms: snapshot.last_alarm }
    };
    track.0.iter().map(said).collect()
}

/// Whether a node is a part of the vehicle, and not of Telltale.
fn counts(snapshot: &Snapshot, node: NodeId) -> bool {
    snapshot.group(snapshot.layout.outermost(node)).0.is_tile()
}

/// What another rule makes of a run without masking.
pub fn of_modules(rule: Rule, model: &Model, off: &Track) -> Vec<Said> {
    let mut state = Follow::new(model, rule);
    off.0.iter().map(|(ms, snapshot)| state.step(*ms, snapshot)).collect()
}

struct Follow {
    rule: Rule,
    /// The direct dependencies of each module, those of its groups included.
    direct: Vec<Vec<NodeId>>,
    /// Since when each faulty module is faulty.
    since: BTreeMap<ModuleId, u64>,
    /// Before the present window nothing was faulty, and from then on.
    window: Option<(ModuleId, u64)>,
    before: BTreeSet<NodeId>,
    alarms: u64,
}

impl Follow {
    fn new(model: &Model, rule: Rule) -> Follow {
        let direct = (0..model.modules.len()).map(|index| {
            let module = NodeId::Module(ModuleId(index as u32));
            let holders = std::iter::once(module).chain(model.around(module).map(NodeId::Group));
            holders.flat_map(|it| model.depends_on(it)).flat_map(|it| it.on.nodes()).copied().collect()
        });
        let direct = direct.collect();
        Follow { rule, direct, since: BTreeMap::new(), window: None, before: BTreeSet::new(), alarms: 0 }
    }

    fn step(&mut self, ms: u64, snapshot: &Snapshot) -> Said {
        let faulty = |id: &ModuleId| {
            let node = NodeId::Module(*id);
            is_bad(snapshot.shown(node).0) && counts(snapshot, node)
        };
        let now: BTreeSet<ModuleId> = snapshot.module_ids().filter(faulty).collect();
        self.since.retain(|id, _| now.contains(id));
        for id in &now {
            self.since.entry(*id).or_insert(ms);
        }
        let mut order: Vec<ModuleId> = now.iter().copied().collect();
        order.sort_by_key(|id| (std::cmp::Reverse(snapshot.module(*id).1.state), self.since[id]));
        let shown: Vec<NodeId> = match self.rule {
            Rule::Aggregator => {
                let mut groups: Vec<NodeId> = Vec::new();
                for id in &order {
                    let group = NodeId::Group(snapshot.layout.outermost(NodeId::Module(*id)));
                    if !groups.contains(&group) {
                        groups.push(group);
                    }
                }
                groups
            }
            Rule::Dependent => {
                let explained = |id: &ModuleId| {
                    let direct = self.direct.get(id.0 as usize);
                    direct.is_some_and(|all| all.iter().any(|on| snapshot.own(*on) == State::Error))
                };
                order.into_iter().filter(|id| !explained(id)).map(NodeId::Module).collect()
            }
            Rule::Window => {
                let is_over = |(first, at): &(ModuleId, u64)| ms > at + WINDOW_MS && !now.contains(first);
                if self.window.as_ref().is_some_and(is_over) {
                    self.window = None;
                }
                let first = order.iter().min_by_key(|id| self.since[id]);
                if let (None, Some(first)) = (self.window, first) {
                    self.window = Some((*first, self.since[first]));
                }
                let window = self.window;
                let belongs = |id: &ModuleId| {
                    window.is_some_and(|(first, at)| *id != first && self.since[id] <= at + WINDOW_MS)
                };
                order.into_iter().filter(|id| !belongs(id)).map(NodeId::Module).collect()
            }
            Rule::Modules | Rule::Always | Rule::Off => order.into_iter().map(NodeId::Module).collect(),
        };
        let faulty: BTreeSet<NodeId> = shown.iter().copied().collect();
        self.alarms += faulty.difference(&self.before).count() as u64;
        self.before.clone_from(&faulty);
        Said { ms, causes: shown, faulty, alarms: self.alarms }
    }
}
