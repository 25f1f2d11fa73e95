//! Why a vehicle cannot be cleared, and why an action was refused, by the names that people know.

use crate::engine::input::Refusal;
use crate::engine::model::{ModuleId, NodeId};
use crate::engine::state::State;

use super::View;
use super::clean::{NAME, clean};

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
        let refusals = &self.snapshot.clearance_refusals;
        for state in [State::Error, State::Unknown, State::Ignore, State::Warning] {
            let of_state = refusals.iter().filter_map(|refusal| match refusal {
                Refusal::Group { group, state: of } if *of == state => Some(&**group),
                _ => None,
            });
            let ids: Vec<&str> = of_state.collect();
            if !ids.is_empty() {
                let names: Vec<String> = ids.iter().map(|id| self.called(id)).collect();
                checks.push(self.fails(self.lang.not_fit(&names.join(", "), state), &ids));
            }
        }
        for refusal in refusals.iter() {
            let steps = self.lang.steps();
            match refusal {
                Refusal::Group { .. } => {}
                Refusal::Warning { module } => {
                    checks.push(self.fails(self.lang.not_accepted(&self.called(module)), &[module]));
                }
                Refusal::NoGoal => checks.push(self.fails(steps.no_goal.to_owned(), &[])),
                Refusal::NotLocalized => checks.push(self.fails(steps.not_localized.to_owned(), &[])),
                Refusal::Countermeasure(_) => checks.push(self.fails(steps.measure_holds.to_owned(), &[])),
                other => checks.push(self.fails(self.sentence(other), &[])),
            }
        }
        checks.extend(self.what_holds());
        checks
    }

    fn fails(&self, text: String, nodes: &[&str]) -> Check {
        Check { holds: false, text, nodes: nodes.join(" ") }
    }

    fn what_holds(&self) -> Vec<Check> {
        let steps = self.lang.steps();
        let refusals = &self.snapshot.clearance_refusals;
        let holds = |fails: fn(&Refusal) -> bool| !refusals.iter().any(fails);
        let unfit = |it: &Refusal| matches!(it, Refusal::Group { .. } | Refusal::Warning { .. });
        let all = [
            (holds(unfit), steps.all_fit),
            (holds(|it| matches!(it, Refusal::NoGoal)), steps.goal_set),
            (holds(|it| matches!(it, Refusal::Countermeasure(_))), steps.no_measure),
        ];
        let check =
            |(_, text): (bool, &str)| Check { holds: true, text: text.to_owned(), nodes: String::new() };
        all.into_iter().filter(|(holds, _)| *holds).map(check).collect()
    }

    /// Why something was refused, with what to do.
    pub(super) fn sentence(&self, refusal: &Refusal) -> String {
        match refusal {
            Refusal::Group { group, state } => {
                self.lang.refusal(&Refusal::Group { group: self.called(group).into(), state: *state })
            }
            Refusal::Warning { module } => {
                self.lang.refusal(&Refusal::Warning { module: self.called(module).into() })
            }
            other => self.lang.refusal(other),
        }
    }

    /// A node by the name that the operator knows; a module by what its fault is called.
    pub(super) fn called(&self, name: &str) -> String {
        match self.snapshot.node(name) {
            Some(NodeId::Group(id)) => self.group_name(id),
            Some(NodeId::Module(id)) => self.module_name(id),
            None => clean(name, NAME),
        }
    }

    fn module_name(&self, id: ModuleId) -> String {
        let (info, _) = self.snapshot.module(id);
        match &info.name {
            Some(name) => self.lang.pick(name, NAME),
            None => format!("{}, {}", self.tile_name(NodeId::Module(id)), self.label(info)),
        }
    }
}
