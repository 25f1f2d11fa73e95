//! Finds situations that should not occur with a configuration, each with a counterexample.
//!
//! It examines every situation that the conditions can distinguish: with all modules OK, with all in ERROR,
//! with each in ERROR alone, and with the fewest failures that make each dependency block, as ERROR and, where
//! that masks, as UNKNOWN. By the rules of masking no node can be masked without a visible cause; this verifies
//! it for the given model. The other findings are conditions, dependencies and groups that cannot have their
//! intended effect.

mod alike;
mod conditions;
mod earlier;
mod finding;
mod fractions;
mod globs;
pub mod judge;
mod late;
mod shared;
mod silence;
pub mod situation;
pub mod urgency;
mod windows;
mod words;

use std::collections::BTreeSet;

use judge::{Judge, Picture};
use situation::Situation;

use telltale_engine::model::output::Output;
use telltale_engine::model::{
    ACTIVE_SIGNAL, Combine, Dependency, GroupId, Model, ModuleId, NodeId, StageModel,
};
use telltale_engine::state::State;

pub use finding::{Example, Finding, FindingKind, NoEffect, Soundness};
pub use words::behind;
pub(super) use words::problem;

/// More situations than this are not examined; conditions use a handful of signals.
const SITUATIONS_MAX: usize = 4096;
/// Facts of nodes that are kept at once, over all situations: about 200 MB.
const FACTS_MAX: usize = 10_000_000;
/// The number of examined ways to make one dependency block.
const CUTS_MAX: usize = 256;
/// Judgements of one node, in total: a few seconds. The result tells whether this was enough.
const WORK_MAX: usize = 100_000_000;

/// Examines a model.
pub fn look(model: &Model) -> Soundness {
    let judge = Judge::new(model);
    let mut look =
        Look { named: situation::named_in(model), judge, pictures: 0, complete: true, findings: Vec::new() };
    let situations = look.situations();
    look.explanations(&situations);
    look.hidden_causes(&situations);
    look.possibilities(&situations);
    look.conditions();
    look.rules();
    look.findings.extend(earlier::look(&look.judge));
    look.findings.extend(silence::look(&look.judge));
    look.findings.extend(conditions::look(model));
    look.findings.extend(fractions::look(model));
    look.findings.extend(globs::look(model));
    look.findings.extend(alike::look(model));
    look.findings.extend(shared::look(&look.judge));
    look.findings.extend(late::look(model));
    look.findings.extend(windows::look(model));
    look.findings.extend(urgency::look(model));
    if model.stages == StageModel::Shuttle {
        let no_stop = model.driving.unpublished.contains(&Output::ManeuverStop);
        let no_drive = !model.signals.iter().any(|signal| &*signal.name == ACTIVE_SIGNAL);
        let kinds = [(no_stop, FindingKind::NoStop), (no_drive, FindingKind::NoDrive)];
        let node = NodeId::Group(GroupId(0));
        let there = kinds.into_iter().filter(|(is_there, _)| *is_there);
        look.findings.extend(there.map(|(_, what)| Finding { node, what, example: None }));
    }
    let Look { pictures, complete, mut findings, .. } = look;
    // Findings with the same reason are reported once.
    findings.dedup();
    Soundness { situations: situations.len(), pictures, complete, findings }
}

struct Look<'m> {
    judge: Judge<'m>,
    named: BTreeSet<usize>,
    pictures: usize,
    complete: bool,
    findings: Vec<Finding>,
}

impl Look<'_> {
    /// All situations, or those with known signals, or only those in which all are unknown.
    fn situations(&mut self) -> Vec<Situation> {
        let model = self.judge.model;
        let most = (FACTS_MAX / self.judge.model.nodes().count().max(1)).clamp(8, SITUATIONS_MAX);
        let all = situation::all(model, &self.named, true, most);
        self.complete = all.is_some();
        let known = || situation::all(model, &self.named, false, most);
        let unknown = || situation::all(model, &BTreeSet::new(), true, most);
        all.or_else(known).or_else(unknown).unwrap_or_default()
    }

    /// The picture with these modules in this state and all others OK.
    fn failing(&mut self, situation: &Situation, failing: &[ModuleId], state: State) -> Picture {
        self.pictures += 1;
        let report = |id| if failing.contains(&id) { state } else { State::Ok };
        self.judge.picture(situation, report, Some(State::Ok))
    }

    fn all(&mut self, situation: &Situation, state: State) -> Picture {
        self.pictures += 1;
        self.judge.picture(situation, |_| state, Some(state))
    }

    fn example(situation: &Situation, failing: &[ModuleId], state: State) -> Option<Example> {
        Some(Example { situation: situation.clone(), failing: failing.to_vec(), state })
    }

    /// Every masked node has a visible cause.
    fn explanations(&mut self, situations: &[Situation]) {
        let modules = self.judge.model.modules.len();
        let nodes = self.judge.model.nodes().count();
        let all: Vec<ModuleId> = (0..modules as u32).map(ModuleId).collect();
        for (situation, state) in situations.iter().flat_map(|it| [(it, State::Error), (it, State::Unknown)])
        {
            let picture = self.all(situation, state);
            self.unexplained(situation, &picture, (&all, state));
            for &module in &all {
                if self.pictures.saturating_mul(nodes) > WORK_MAX {
                    self.complete = false;
                    return;
                }
                let picture = self.failing(situation, &[module], state);
                self.unexplained(situation, &picture, (&[module], state));
            }
        }
    }

    fn unexplained(
        &mut self,
        situation: &Situation,
        picture: &Picture,
        (failing, state): (&[ModuleId], State),
    ) {
        let hidden = self.judge.model.nodes().find(|&node| {
            let facts = picture.of(node);
            facts.masked() && !facts.block_explained
        });
        if let Some(node) = hidden {
            let example = Look::example(situation, failing, state);
            self.findings.push(Finding { node, what: FindingKind::Unexplained, example });
        }
    }

    /// A cause inside a redundant group: it is named as a cause, but its tile is not affected.
    fn hidden_causes(&mut self, situations: &[Situation]) {
        for holder in self.judge.model.nodes() {
            for (index, dependency) in self.judge.model.depends_on(holder).iter().enumerate() {
                let redundant =
                    |target: &NodeId| self.judge.model.around(*target).any(|group| self.combines_any(group));
                if !dependency.targets().iter().all(redundant) {
                    continue;
                }
                let found = situations.iter().find_map(|situation| self.hidden(situation, dependency));
                if let Some((masked, example)) = found {
                    let what = FindingKind::HiddenCause { dependency: index, masked };
                    self.findings.push(Finding { node: holder, what, example });
                }
            }
        }
    }

    fn combines_any(&self, group: GroupId) -> bool {
        self.judge.model.groups[group.0 as usize].combine == Combine::Any
    }

    fn hidden(
        &mut self,
        situation: &Situation,
        dependency: &Dependency,
    ) -> Option<(NodeId, Option<Example>)> {
        let relevant = self.all(situation, State::Ok);
        let cuts = self.all_of(&relevant, dependency.targets());
        // An ERROR may mask more than an UNKNOWN, and so be the one that a tile shows.
        let states: &[State] =
            if dependency.masks_unknown { &[State::Error, State::Unknown] } else { &[State::Error] };
        let mut tried = cuts.iter().flat_map(|failing| states.iter().map(move |&state| (failing, state)));
        tried.find_map(|(failing, state)| {
            let picture = self.failing(situation, failing, state);
            if !picture.is_blocked_by(dependency) || self.tile_gets_worse(&relevant, &picture) {
                return None;
            }
            let masked = self.judge.model.nodes().find(|&node| picture.of(node).masked())?;
            Some((masked, Look::example(situation, failing, state)))
        })
    }

    /// Whether a tile shows UNKNOWN or ERROR only after the failure.
    fn tile_gets_worse(&self, before: &Picture, after: &Picture) -> bool {
        let bad = |picture: &Picture, id| picture.of(NodeId::Group(id)).shown >= State::Unknown;
        let tiles = (0..).map(GroupId).zip(&self.judge.model.groups);
        let mut tiles = tiles.filter(|(_, group)| group.parent.is_none());
        tiles.any(|(id, _)| bad(after, id) && !bad(before, id))
    }

    /// Each smallest set of relevant modules whose failure makes a node fail.
    fn cuts(&mut self, relevant: &Picture, node: NodeId) -> Vec<Vec<ModuleId>> {
        if !relevant.of(node).relevant {
            return Vec::new();
        }
        let id = match node {
            NodeId::Module(id) => return vec![vec![id]],
            // Without members it is UNKNOWN, without any failure.
            NodeId::Group(id) if self.is_empty(id) => return vec![Vec::new()],
            NodeId::Group(id) => id,
        };
        let members = &self.judge.members[id.0 as usize];
        let counted: Vec<NodeId> =
            members.iter().copied().filter(|&member| relevant.of(member).relevant).collect();
        if self.combines_any(id) {
            return if counted.is_empty() { Vec::new() } else { self.all_of(relevant, &counted) };
        }
        let mut cuts = Vec::new();
        for member in counted {
            cuts.extend(self.cuts(relevant, member));
        }
        self.bounded(cuts)
    }

    /// Each smallest set whose failure makes all of these nodes fail.
    fn all_of(&mut self, relevant: &Picture, nodes: &[NodeId]) -> Vec<Vec<ModuleId>> {
        let mut sets: Vec<Vec<ModuleId>> = vec![Vec::new()];
        for &node in nodes {
            let cuts = self.cuts(relevant, node);
            let joined = sets.iter().flat_map(|set| {
                cuts.iter().map(move |cut| {
                    let mut joined = set.clone();
                    joined.extend(cut.iter().filter(|id| !set.contains(id)));
                    joined
                })
            });
            sets = joined.take(CUTS_MAX + 1).collect();
            sets = self.bounded(sets);
        }
        sets
    }

    fn bounded(&mut self, mut sets: Vec<Vec<ModuleId>>) -> Vec<Vec<ModuleId>> {
        self.complete &= sets.len() <= CUTS_MAX;
        sets.truncate(CUTS_MAX);
        sets
    }

    /// The best and the worst possible effect of dependencies and groups.
    fn possibilities(&mut self, situations: &[Situation]) {
        let pictures: Vec<(Picture, Picture)> = situations
            .iter()
            .map(|situation| {
                let best = self.all(situation, State::Ok);
                self.judge.pessimistic = true;
                let worst = self.all(situation, State::Error);
                self.judge.pessimistic = false;
                (best, worst)
            })
            .collect();
        let needed = self.needed();
        for holder in self.judge.model.nodes() {
            for (index, dependency) in self.judge.model.depends_on(holder).iter().enumerate() {
                self.dependency(
                    situations,
                    &pictures,
                    (holder, needed.contains(&holder)),
                    (index, dependency),
                );
            }
        }
        // Statements about every situation require a complete examination.
        if self.complete {
            for id in (0..self.judge.model.groups.len() as u32).map(GroupId) {
                self.never_ok(situations, &pictures, id);
            }
        }
    }

    fn dependency(
        &mut self,
        situations: &[Situation],
        pictures: &[(Picture, Picture)],
        (holder, passes_on): (NodeId, bool),
        (index, dependency): (usize, &Dependency),
    ) {
        let best = situations.iter().zip(pictures).find(|(_, (best, _))| {
            best.of(holder).relevant && best.is_blocked_by(dependency) && self.at_fault(best, dependency)
        });
        if let Some((situation, _)) = best {
            let example = Look::example(situation, &[], State::Ok);
            self.findings.push(Finding {
                node: holder,
                what: FindingKind::AlwaysMasked { dependency: index },
                example,
            });
            return;
        }
        let matters = |picture: &Picture| passes_on || picture.of(holder).relevant;
        let ever_matters = pictures.iter().any(|(_, worst)| matters(worst));
        let ever_blocks = pictures.iter().any(|(_, worst)| matters(worst) && worst.is_blocked_by(dependency));
        if self.complete && ever_matters && !ever_blocks {
            let why = self.why_dead(pictures, dependency, matters);
            let what = FindingKind::DeadDependency { dependency: index, why };
            self.findings.push(Finding { node: holder, what, example: None });
        }
    }

    /// The target of a dependency that fails by itself, not because of a cause behind it.
    fn at_fault(&self, picture: &Picture, dependency: &Dependency) -> bool {
        dependency.targets().iter().any(|&target| !picture.of(target).blocked)
    }

    /// The nodes that any dependency names, and the groups around them.
    fn needed(&self) -> BTreeSet<NodeId> {
        let model = self.judge.model;
        let targets = model.nodes().flat_map(|holder| model.depends_on(holder)).flat_map(Dependency::targets);
        let named: BTreeSet<NodeId> = targets.copied().collect();
        let around = named.iter().flat_map(|&node| model.around(node).map(NodeId::Group)).collect::<Vec<_>>();
        named.iter().copied().chain(around).collect()
    }

    fn why_dead(
        &self,
        pictures: &[(Picture, Picture)],
        dependency: &Dependency,
        matters: impl Fn(&Picture) -> bool,
    ) -> NoEffect {
        let ever_relevant =
            |node: NodeId| pictures.iter().any(|(_, worst)| matters(worst) && worst.of(node).relevant);
        let named = dependency.targets();
        let idle = named.iter().copied().find(|&target| !ever_relevant(target));
        let node = idle.or(named.first().copied()).unwrap_or(NodeId::Group(GroupId(0)));
        match node {
            NodeId::Group(id) if idle.is_none() && self.is_empty(id) => NoEffect::NoMembers(node),
            _ => NoEffect::NotRelevant(node),
        }
    }

    fn is_empty(&self, id: GroupId) -> bool {
        self.judge.members[id.0 as usize].is_empty() && !self.judge.discovers(id)
    }

    /// A group that is sometimes relevant and never OK, if none of its members has the same finding.
    fn never_ok(&mut self, situations: &[Situation], pictures: &[(Picture, Picture)], id: GroupId) {
        let node = NodeId::Group(id);
        let never = |node: NodeId| {
            pictures.iter().any(|(best, _)| best.of(node).relevant)
                && pictures.iter().all(|(best, _)| best.of(node).shown != State::Ok)
        };
        let open = situations.iter().zip(pictures).find(|(_, (best, _))| {
            let facts = best.of(node);
            facts.relevant && !facts.blocked
        });
        let (true, Some((situation, _))) = (never(node), open) else { return };
        let members = &self.judge.members[id.0 as usize];
        if members.iter().any(|&member| matches!(member, NodeId::Group(_)) && never(member)) {
            return;
        }
        let relevant = |&&member: &&NodeId| pictures.iter().any(|(best, _)| best.of(member).relevant);
        let why = match members.iter().find(relevant) {
            _ if self.is_empty(id) => NoEffect::NoMembers(node),
            Some(&member) => NoEffect::Waits(member),
            None => NoEffect::NotRelevant(node),
        };
        let example = Look::example(situation, &[], State::Ok);
        self.findings.push(Finding { node, what: FindingKind::NeverOk { why }, example });
    }

    /// Conditions against those of the enclosing groups, each with the signals of its own surroundings.
    fn conditions(&mut self) {
        let mut never: BTreeSet<GroupId> = BTreeSet::new();
        for node in self.judge.model.nodes() {
            let Some(when) = self.judge.model.when(node) else { continue };
            let around: Vec<GroupId> = self.judge.model.around(node).collect();
            if around.iter().any(|group| never.contains(group)) {
                continue;
            }
            let whens: Vec<_> =
                around.iter().filter_map(|&group| self.judge.model.when(NodeId::Group(group))).collect();
            let named = situation::named(whens.iter().copied().chain([when]));
            let known = situation::all(self.judge.model, &named, false, SITUATIONS_MAX);
            let Some(known) = known else {
                self.complete = false;
                continue;
            };
            let open = |it: &&Situation| {
                around.iter().all(|&group| it.meets(self.judge.model.when(NodeId::Group(group))))
            };
            let open: Vec<&Situation> = known.iter().filter(open).collect();
            if open.iter().all(|it| !it.meets(Some(when))) {
                self.findings.push(Finding { node, what: FindingKind::NeverHolds, example: None });
                if let NodeId::Group(id) = node {
                    never.insert(id);
                }
            } else if open.iter().all(|it| it.meets(Some(when)) == it.meets(None)) {
                self.findings.push(Finding { node, what: FindingKind::AlwaysHolds, example: None });
            }
        }
    }

    /// Countermeasures for nodes that are never relevant in their stages.
    fn rules(&mut self) {
        let model = self.judge.model;
        for (index, rule) in model.driving.countermeasures.iter().enumerate() {
            for &node in &rule.nodes {
                let around = self.judge.model.around(node).map(NodeId::Group);
                let whens: Vec<_> = around.chain([node]).map(|node| self.judge.model.when(node)).collect();
                let named = situation::named(whens.iter().copied().flatten());
                let Some(all) = situation::all(model, &named, false, SITUATIONS_MAX) else {
                    self.complete = false;
                    continue;
                };
                let counts = |it: &Situation| {
                    rule.stages.contains(&it.stage) && whens.iter().all(|&when| it.meets(when))
                };
                if !all.iter().any(counts) {
                    self.findings.push(Finding {
                        node,
                        what: FindingKind::DeadRule { rule: index },
                        example: None,
                    });
                }
            }
        }
    }
}
