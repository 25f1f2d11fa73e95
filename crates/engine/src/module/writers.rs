//! The writers of a status. If several writers report one name, the worst of their last reports counts, so an
//! OK of another writer never covers an ERROR.

use crate::discovery::{NodeOf, WriterId, WriterList};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

use super::contradictions::Dispute;
use crate::Engine;
use crate::input::Status;
use crate::model::{ModuleId, Policy};
use crate::state::State;
use crate::text::say;
use crate::time::{Span, Timestamp};

/// Writers of one name that are kept apart. Beyond it the worst are kept, so the state that counts is never
/// better than a report.
pub(crate) const WRITERS_MAX: usize = 8;

/// Whether a policy admits a writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Admission {
    Counts,
    /// The writer's node is not known yet: its report counts unless it is OK.
    Pending,
    Refused,
}

impl Policy {
    fn admits(&self, node: &NodeOf, state: State) -> Admission {
        match (&self.writers, node) {
            (None, _) => Admission::Counts,
            (Some(writers), NodeOf::Named(name)) if writers.contains(name) => Admission::Counts,
            (Some(_), NodeOf::Pending) if state > State::Ok => Admission::Counts,
            (Some(_), NodeOf::Pending) => Admission::Pending,
            (Some(_), _) => Admission::Refused,
        }
    }
}

/// A report of a name that has no module in some groups, and whether its node may make one there.
#[derive(Debug, Clone, Default)]
pub(crate) struct Heard {
    report: Option<(WriterReport, NodeOf)>,
    refused: bool,
    pending: bool,
    unproven: bool,
}

impl Heard {
    pub(crate) fn new(report: WriterReport, list: &WriterList) -> Heard {
        Heard { report: Some((report, list.node(report.writer).clone())), ..Heard::default() }
    }

    /// Whether the report makes a module with this policy.
    pub(crate) fn admits(&mut self, policy: &Policy) -> bool {
        let Some((report, node)) = &self.report else { return true };
        let admission = policy.admits(node, report.state);
        self.refused |= admission == Admission::Refused;
        self.pending |= admission == Admission::Pending;
        let makes = admission == Admission::Counts;
        self.unproven |= makes && policy.writers.is_some() && *node == NodeOf::Pending;
        makes
    }

    /// Whether some group takes the name only from another node, or from a known one.
    pub(crate) fn is_held_back(&self) -> bool {
        self.refused || self.pending
    }

    /// Whether a module was made at the word of a node that is not known yet.
    pub(crate) fn is_unproven(&self) -> bool {
        self.unproven
    }
}

/// The last report of one writer about a name.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct WriterReport {
    pub(crate) writer: WriterId,
    pub(crate) state: State,
    pub(crate) at: Timestamp,
}

/// The reports of one name by writer. Nearly always there is one writer.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct WriterReports {
    one: Option<WriterReport>,
    several: Option<Box<Several>>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Several {
    writer_reports: Vec<WriterReport>,
    /// The writer whose texts are shown.
    shown: WriterId,
    /// Since when they differ, apart from moments.
    differ_since: Option<Timestamp>,
    /// The last time at which they differed.
    differed: Timestamp,
}

impl WriterReports {
    /// All writers that count.
    fn writers(&self) -> impl Iterator<Item = WriterId> {
        let several = self.several.iter().flat_map(|several| &several.writer_reports);
        self.one.iter().chain(several).map(|report| report.writer)
    }

    /// Whether no writer was heard.
    pub(crate) fn is_empty(&self) -> bool {
        self.one.is_none() && self.several.is_none()
    }

    /// Takes a report of the only writer. Returns false if the name has other writers: then [`WriterReports::take`]
    /// decides.
    pub(crate) fn take_alone(&mut self, report: WriterReport) -> bool {
        let alone = self.several.is_none() && self.one.is_none_or(|one| one.writer == report.writer);
        if alone {
            self.one = Some(report);
        }
        alone
    }

    /// Takes a report of one of several writers. Writers that left or were silent for `timeout` no longer
    /// count. Returns the remaining other writers, and whether there are more than are kept.
    fn take(
        &mut self,
        report: WriterReport,
        timeout: Span,
        list: &WriterList,
    ) -> (Option<&mut Several>, bool) {
        let mut several = self.several.take().unwrap_or_else(|| {
            let first = self.one.unwrap_or(report);
            Box::new(Several {
                writer_reports: vec![first],
                shown: first.writer,
                differ_since: None,
                differed: report.at,
            })
        });
        several
            .writer_reports
            .retain(|it| it.writer != report.writer && it.at + timeout > report.at && !has_left(list, it));
        let too_many = several.writer_reports.len() >= WRITERS_MAX;
        several.writer_reports.push(report);
        if too_many {
            let best = several.writer_reports.iter().enumerate().min_by_key(|(_, it)| (it.state, it.at));
            let best = best.map_or(0, |(index, _)| index);
            several.writer_reports.remove(best);
        }
        self.one = Some(report);
        if several.writer_reports.iter().any(|it| it.writer != report.writer) {
            self.several = Some(several);
        }
        (self.several.as_deref_mut(), too_many)
    }
}

/// The least time for which two writers must differ: a writer that measures a moment later is no contradiction.
const DIFFER_MIN: Span = Span::from_secs(2);

impl Several {
    /// The writers that contradict each other now, the worse first. Both must have reported since they differ:
    /// a restarted writer contradicts nobody.
    fn dispute(&mut self, now: Timestamp) -> Option<(WriterReport, WriterReport)> {
        let worst = self.writer_reports.iter().map(|it| it.state).max()?;
        if self.writer_reports.iter().all(|it| it.state == worst) {
            if now.since(self.differed) >= DIFFER_MIN {
                self.differ_since = None;
            }
            return None;
        }
        self.differed = now;
        let since = *self.differ_since.get_or_insert(now);
        if now.since(since) < DIFFER_MIN {
            return None;
        }
        let spoke = || self.writer_reports.iter().filter(|it| it.at >= since);
        let (best, worst) = (spoke().min_by_key(|it| it.state)?, spoke().max_by_key(|it| it.state)?);
        (best.state != worst.state).then_some((*worst, *best))
    }
}

/// Whether discovery lost the writer after its last report.
fn has_left(list: &WriterList, report: &WriterReport) -> bool {
    list.complete && report.at < list.as_of && !list.writers.contains_key(&report.writer)
}

impl Engine {
    /// Takes a newer list of writers. A module that was made at the word of a node that turns out to be a
    /// stranger goes again.
    pub(crate) fn take_writers(&mut self, newer: &WriterList) {
        self.writers.follow(newer);
        for route in self.names.unproven() {
            let writers: Vec<WriterId> = self.names.routes[route as usize].writer_reports.writers().collect();
            let nodes: Vec<&NodeOf> = writers.iter().map(|&writer| self.writers.node(writer)).collect();
            if nodes.contains(&&NodeOf::Pending) {
                continue;
            }
            let may_say = |id: ModuleId| {
                let policy = self.net.policy(id);
                nodes.iter().any(|node| policy.admits(node, State::Ok) == Admission::Counts)
            };
            let made = self.names.modules(route).filter(|&id| self.net.is_discovered(id));
            let strange: Vec<ModuleId> = made.filter(|&id| !may_say(id)).collect();
            self.names.trust(route);
            for id in strange {
                self.net.remove(id);
            }
        }
    }

    /// A name was said by a node that may not say it, or is not known yet: it made no module, and its KeyValues
    /// do not count.
    pub(crate) fn note_held_back(&mut self, name: &str, heard: &Heard) {
        let name: Arc<str> = name.into();
        let is_first = self.held_back.insert(name.clone());
        if let Some((report, _)) = heard.report.as_ref().filter(|_| heard.refused && is_first) {
            self.note_stranger(name, report.writer);
        }
    }

    /// Whether a module of the name admits only certain writers.
    pub(crate) fn restricts(&self, route: u32) -> bool {
        self.restricted && self.names.modules(route).any(|id| self.net.policy(id).writers.is_some())
    }

    /// Takes a status with several writers, or with a module that admits only certain writers.
    pub(crate) fn take_disputed(&mut self, route: u32, status: Status<'_>, report: WriterReport, array: u64) {
        let (now, list) = (self.now, &self.writers);
        let node = list.node(report.writer);
        let names = &mut self.names.routes[route as usize];
        let policies = names.modules().map(|id| self.net.policy(id));
        let longest = policies.clone().map(|policy| policy.timeout).max().unwrap_or(Span::ZERO);
        // Values are neither better nor worse: those of an unknown node wait until the node is known.
        let unknown = *node == NodeOf::Pending && policies.clone().any(|it| it.writers.is_some());
        let admissions: Vec<Admission> = policies.map(|it| it.admits(node, report.state)).collect();
        let refused = admissions.contains(&Admission::Refused);
        names.overruled = array;
        if !admissions.contains(&Admission::Counts) {
            let pending = admissions.iter().zip(names.modules()).find(|(it, _)| **it == Admission::Pending);
            if let Some(id) = pending.map(|(_, id)| id).filter(|&id| self.views.says_nothing(id)) {
                self.views.set_message(id, pending_node());
            }
            if refused {
                self.note_stranger_of(route, report.writer);
            }
            return;
        }
        let (several, too_many) = match names.writer_reports.take_alone(report) {
            true => (None, false),
            false => names.writer_reports.take(report, longest, list),
        };
        let dispute = several.and_then(|several| several.dispute(now));
        if refused {
            self.note_stranger_of(route, report.writer);
        }
        if too_many {
            self.note_dispute(self.names.name(route), Dispute::TooManyWriters);
        }
        if let Some((worse, better)) = dispute {
            let one = |report: WriterReport| (self.writers.label(report.writer), report.state);
            let dispute = Dispute::Contradiction { worse: one(worse), better: one(better) };
            self.note_dispute(self.names.name(route), dispute);
        }
        for (position, admission) in admissions.into_iter().enumerate() {
            if admission != Admission::Counts {
                continue;
            }
            let Some(id) = self.names.routes[route as usize].module(position) else { continue };
            let shown = self.report_worst(route, id, report, status);
            if shown && !refused && !unknown {
                // Its KeyValues count too.
                self.names.routes[route as usize].overruled = 0;
            }
        }
    }

    /// Reports the worst of the reports that count to a module. Returns whether that is the report of the
    /// present writer.
    fn report_worst(&mut self, route: u32, id: ModuleId, report: WriterReport, status: Status<'_>) -> bool {
        let (list, policy) = (&self.writers, self.net.policy(id));
        let names = &mut self.names.routes[route as usize];
        let counts = |it: &&WriterReport| {
            it.at + policy.timeout > report.at
                && policy.admits(list.node(it.writer), it.state) == Admission::Counts
        };
        let others =
            names.writer_reports.several.iter().flat_map(|several| &several.writer_reports).filter(counts);
        let others = others.filter(|it| it.writer != report.writer);
        let worst = others.clone().map(|it| it.state).max();
        let state = worst.map_or(report.state, |worst| worst.max(report.state));
        let speaks = state == report.state;
        // Among equal states the same writer stays shown: alternating texts are hard to read.
        let shown = names.writer_reports.several.as_ref().map(|several| several.shown);
        let held = others.clone().any(|it| Some(it.writer) == shown && it.state == state);
        if speaks
            && !held
            && let Some(several) = &mut names.writer_reports.several
        {
            several.shown = report.writer;
        }
        if self.net.report(id, state, self.now) {
            self.net.mark_module(id);
        }
        if speaks && !held {
            self.views.take_report(id, status, report.writer, &self.model.limits);
        } else {
            self.views.note_heard(id);
        }
        speaks
    }

    fn note_stranger_of(&mut self, route: u32, writer: WriterId) {
        let name = self.names.name(route);
        // It was noted where the name makes no module.
        if !self.held_back.contains(&name) {
            self.note_stranger(name, writer);
        }
    }

    fn note_stranger(&mut self, name: Arc<str>, writer: WriterId) {
        let label = self.writers.label(writer);
        self.note_dispute(name, Dispute::NotAdmitted { who: label, count: 1 });
    }
}

fn pending_node() -> crate::text::Text {
    say!(
        "the node that says OK is not known yet: it does not count until it is",
        "der Knoten, der OK meldet, ist noch nicht bekannt: bis dahin zählt das nicht"
    )
}
