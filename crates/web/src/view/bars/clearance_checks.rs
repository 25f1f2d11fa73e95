//! The checks before a clearance, and the reasons of a refusal, with the names that the page shows.

use std::collections::HashSet;

use telltale_engine::input::Refusal;
use telltale_engine::model::{ModuleId, NodeId};
use telltale_engine::snapshot::Reason;
use telltale_engine::state::State;

use crate::texts::{ID, NAME, clean};
use crate::view::View;

/// One line of the action bar's list.
pub struct Check {
    pub holds: bool,
    pub text: String,
    /// The nodes that it names, for programs.
    pub nodes: String,
}

impl View<'_> {
    /// All checks that fail, each kind on one line with every name, then those that hold.
    pub(super) fn checks(&self) -> Vec<Check> {
        let mut checks = Vec::new();
        let refusals = self.without_repeated_statuses(&self.snapshot.clearance_refusals);
        for state in [State::Error, State::Unknown, State::Ignore, State::Warning] {
            let of_state = refusals.iter().filter_map(|refusal| match *refusal {
                Refusal::Group { group, state: of } if *of == state => Some(&**group),
                _ => None,
            });
            let ids: Vec<&str> = of_state.collect();
            if state == State::Ignore {
                let waiting = self.by_cause(&ids);
                checks.extend(waiting.into_iter().map(|(cause, ids)| {
                    let names: Vec<String> = ids.iter().map(|id| self.name_of(id)).collect();
                    self.fails(self.lang.wait_for(&names, cause.as_deref()), &ids)
                }));
            } else if !ids.is_empty() {
                let names: Vec<String> = ids.iter().map(|id| self.name_of(id)).collect();
                checks.push(self.fails(self.lang.not_fit(state, &names.join(", ")), &ids));
            }
        }
        for refusal in refusals.iter() {
            match refusal {
                Refusal::Group { .. } => {}
                Refusal::Warning { module } => {
                    checks.push(self.fails(self.lang.not_accepted(&self.name_of(module)), &[module]));
                }
                Refusal::NoGoal => checks.push(self.fails(self.words.no_goal.to_owned(), &[])),
                Refusal::NotLocalized => checks.push(self.fails(self.words.not_confirmed.to_owned(), &[])),
                Refusal::Countermeasure(_) => {}
                other => checks.push(self.fails(self.sentence(other), &[])),
            }
        }
        // To slow down and to stop hold the vehicle alike: one line says so.
        if refusals.iter().any(|it| matches!(it, Refusal::Countermeasure(_))) {
            checks.push(self.fails(self.words.still_held.to_owned(), &[]));
        }
        checks.extend(self.passed_checks());
        checks
    }

    /// Masked groups by the component of their root cause.
    fn by_cause<'n>(&self, ids: &[&'n str]) -> Vec<(Option<String>, Vec<&'n str>)> {
        let mut found: Vec<(Option<String>, Vec<&str>)> = Vec::new();
        for id in ids {
            let reason = match self.snapshot.node(id) {
                Some(NodeId::Group(id)) => self.snapshot.group(id).1.reason.as_ref(),
                _ => None,
            };
            let cause = match reason {
                Some(Reason::Masked { by }) => by.first().map(|&root| self.tile_name(root)),
                _ => None,
            };
            match found.iter_mut().find(|(of, _)| *of == cause) {
                Some((_, ids)) => ids.push(id),
                None => found.push((cause, vec![id])),
            }
        }
        found
    }

    /// The reasons of a refusal, one sentence each. Groups that wait for one cause share a sentence.
    pub fn sentences(&self, refusals: &[Refusal]) -> Vec<String> {
        let waits = |it: &&Refusal| matches!(it, Refusal::Group { state: State::Ignore, .. });
        let ids = refusals.iter().filter(waits).filter_map(|refusal| match refusal {
            Refusal::Group { group, .. } => Some(&**group),
            _ => None,
        });
        let ids: Vec<&str> = ids.collect();
        let refusals = self.without_repeated_statuses(refusals);
        let said = refusals.iter().filter(|it| !waits(it)).map(|it| self.sentence(it));
        let waiting = self.by_cause(&ids).into_iter().map(|(cause, ids)| {
            let names: Vec<String> = ids.iter().map(|id| self.name_of(id)).collect();
            self.lang.wait_for(&names, cause.as_deref())
        });
        said.chain(waiting).collect()
    }

    /// One status in several components is one WARNING, which is accepted once.
    fn without_repeated_statuses<'r>(&self, refusals: &'r [Refusal]) -> Vec<&'r Refusal> {
        let mut seen: HashSet<&str> = HashSet::new();
        let is_first = |refusal: &&Refusal| {
            let Refusal::Warning { module } = refusal else { return true };
            let status = self.snapshot.node(module).and_then(|node| self.snapshot.status_of(node));
            status.is_none_or(|status| seen.insert(status))
        };
        refusals.iter().filter(is_first).collect()
    }

    fn fails(&self, text: String, nodes: &[&str]) -> Check {
        Check {
            holds: false,
            text,
            nodes: nodes.iter().map(|node| clean(node, ID)).collect::<Vec<_>>().join(" "),
        }
    }

    fn passed_checks(&self) -> Vec<Check> {
        let refusals = &self.snapshot.clearance_refusals;
        let holds = |fails: fn(&Refusal) -> bool| !refusals.iter().any(fails);
        let unfit = |it: &Refusal| matches!(it, Refusal::Group { .. } | Refusal::Warning { .. });
        let all = [
            (holds(unfit), self.words.all_fit),
            (holds(|it| matches!(it, Refusal::NoGoal)), self.words.goal_set),
            (holds(|it| matches!(it, Refusal::Countermeasure(_))), self.words.nothing_holds),
        ];
        let check =
            |(_, text): (bool, &str)| Check { holds: true, text: text.to_owned(), nodes: String::new() };
        all.into_iter().filter(|(holds, _)| *holds).map(check).collect()
    }

    /// One reason of a refusal, with what to do.
    fn sentence(&self, refusal: &Refusal) -> String {
        match refusal {
            Refusal::Group { group, state } => {
                self.lang.refusal(&Refusal::Group { group: self.name_of(group).into(), state: *state })
            }
            Refusal::Warning { module } => {
                self.lang.refusal(&Refusal::Warning { module: self.name_of(module).into() })
            }
            other => self.lang.refusal(other),
        }
    }

    /// A node by the name that the operator knows; a module by what its fault is called.
    fn name_of(&self, name: &str) -> String {
        match self.snapshot.node(name) {
            Some(NodeId::Group(id)) => self.group_name(id),
            Some(NodeId::Module(id)) => self.module_name(id),
            None => clean(name, NAME),
        }
    }

    /// The state of a module, or its report behind a mask.
    fn failing(&self, id: ModuleId) -> State {
        let (_, module) = self.snapshot.module(id);
        if module.state == State::Ignore { module.own } else { module.state }
    }

    fn module_name(&self, id: ModuleId) -> String {
        let (info, _) = self.snapshot.module(id);
        match self.name_of_fault(info, self.failing(id)) {
            Some(name) => name,
            None => format!("{}, {}", self.tile_name(NodeId::Module(id)), self.label(info)),
        }
    }
}
