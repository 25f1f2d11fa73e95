//! The writers of a status. If several writers report one name, the worst of their last reports counts
//! (`ENGINE.md` 1), so that no OK of a stranger covers an ERROR.

use crate::engine::discovery::{NodeOf, WriterId, WriterList};

use super::contradictions::Dispute;
use crate::engine::Engine;
use crate::engine::input::Status;
use crate::engine::model::{ModuleId, Policy};
use crate::engine::state::State;
use crate::engine::text::say;
use crate::engine::time::{Span, Timestamp};

/// Writers of one name that are kept apart. Of more the worst are kept: then what counts is never
/// better than what was said.
pub(in crate::engine) const VOICES_MAX: usize = 8;

/// Whether a policy lets a writer say a status.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Admission {
    Counts,
    /// Its node is not known yet: what is worse than OK counts, an OK does not.
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

/// What one writer said last of a name.
#[derive(Debug, Clone, Copy)]
pub(in crate::engine) struct Voice {
    pub(in crate::engine) writer: WriterId,
    pub(in crate::engine) state: State,
    pub(in crate::engine) at: Timestamp,
}

/// What was said of one name, by whom. Nearly always there is one writer.
#[derive(Debug, Clone, Default)]
pub(in crate::engine) struct Voices {
    one: Option<Voice>,
    several: Option<Box<Several>>,
}

#[derive(Debug, Clone)]
pub(in crate::engine) struct Several {
    voices: Vec<Voice>,
    /// Whose words are shown.
    shown: WriterId,
    /// Since when they differ, but for moments.
    differ_since: Option<Timestamp>,
    /// When they differed last.
    differed: Timestamp,
}

impl Voices {
    /// Takes what a writer says. Returns false where others say the same name: then more is to be
    /// asked than what it says.
    pub(in crate::engine) fn hear_alone(&mut self, voice: Voice) -> bool {
        let alone = self.several.is_none() && self.one.is_none_or(|one| one.writer == voice.writer);
        if alone {
            self.one = Some(voice);
        }
        alone
    }

    /// Takes what one of several writers says. Those that left, and those that were silent for
    /// `timeout`, count no more. Returns who is left beside the speaker, and whether more spoke than
    /// are kept.
    fn hear(&mut self, voice: Voice, timeout: Span, list: &WriterList) -> (Option<&mut Several>, bool) {
        let mut several = self.several.take().unwrap_or_else(|| {
            let first = self.one.unwrap_or(voice);
            Box::new(Several {
                voices: vec![first],
                shown: first.writer,
                differ_since: None,
                differed: voice.at,
            })
        });
        several
            .voices
            .retain(|it| it.writer != voice.writer && it.at + timeout > voice.at && !has_left(list, it));
        let crowded = several.voices.len() >= VOICES_MAX;
        several.voices.push(voice);
        if crowded {
            let best = several.voices.iter().enumerate().min_by_key(|(_, it)| (it.state, it.at));
            let best = best.map_or(0, |(index, _)| index);
            several.voices.remove(best);
        }
        self.one = Some(voice);
        if several.voices.iter().any(|it| it.writer != voice.writer) {
            self.several = Some(several);
        }
        (self.several.as_deref_mut(), crowded)
    }
}

/// How long writers have to contradict each other: one that measures a moment later is no contradiction.
const DIFFER_MIN: Span = Span::from_secs(2);

impl Several {
    /// Who contradicts whom now, the worse first. Both must have spoken since they differ: one that was
    /// started again contradicts nobody.
    fn dispute(&mut self, now: Timestamp) -> Option<(Voice, Voice)> {
        let worst = self.voices.iter().map(|it| it.state).max()?;
        if self.voices.iter().all(|it| it.state == worst) {
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
        let spoke = || self.voices.iter().filter(|it| it.at >= since);
        let (best, worst) = (spoke().min_by_key(|it| it.state)?, spoke().max_by_key(|it| it.state)?);
        (best.state != worst.state).then_some((*worst, *best))
    }
}

/// Whether discovery lost the writer after it spoke.
fn has_left(list: &WriterList, voice: &Voice) -> bool {
    list.complete && voice.at < list.as_of && !list.writers.contains_key(&voice.writer)
}

impl Engine {
    /// Whether a name may not be said by everybody.
    pub(in crate::engine) fn restricts(&self, route: u32) -> bool {
        self.restricted && self.names.modules(route).any(|id| self.net.policy(id).writers.is_some())
    }

    /// Takes a status of a name that several writers say, or that only some may say.
    pub(in crate::engine) fn take_disputed(
        &mut self,
        route: u32,
        status: Status<'_>,
        voice: Voice,
        array: u64,
    ) {
        let (now, list) = (self.now, &self.writers);
        let node = list.node(voice.writer);
        let names = &mut self.names.routes[route as usize];
        let policies = names.modules().map(|id| self.net.policy(id));
        let longest = policies.clone().map(|policy| policy.timeout).max().unwrap_or(Span::ZERO);
        // Values are neither better nor worse: those of a node that is not known yet wait until it is.
        let unknown = *node == NodeOf::Pending && policies.clone().any(|it| it.writers.is_some());
        let admissions: Vec<Admission> = policies.map(|it| it.admits(node, voice.state)).collect();
        let refused = admissions.contains(&Admission::Refused);
        names.overruled = array;
        if !admissions.contains(&Admission::Counts) {
            let pending = admissions.iter().zip(names.modules()).find(|(it, _)| **it == Admission::Pending);
            if let Some(id) = pending.map(|(_, id)| id).filter(|&id| self.views.says_nothing(id)) {
                self.views.set_message(id, pending_node());
            }
            if refused {
                self.note_stranger(route, voice.writer);
            }
            return;
        }
        let (several, crowded) = match names.voices.hear_alone(voice) {
            true => (None, false),
            false => names.voices.hear(voice, longest, list),
        };
        let dispute = several.and_then(|several| several.dispute(now));
        if refused {
            self.note_stranger(route, voice.writer);
        }
        if crowded {
            self.note_dispute(route, Dispute::Crowd);
        }
        if let Some((worse, better)) = dispute {
            let one = |voice: Voice| (self.writers.label(voice.writer), voice.state);
            self.note_dispute(route, Dispute::Contradiction { worse: one(worse), better: one(better) });
        }
        for (position, admission) in admissions.into_iter().enumerate() {
            if admission != Admission::Counts {
                continue;
            }
            let Some(id) = self.names.routes[route as usize].module(position) else { continue };
            let shown = self.report_worst(route, id, voice, status);
            if shown && !refused && !unknown {
                // Its KeyValues count as well.
                self.names.routes[route as usize].overruled = 0;
            }
        }
    }

    /// Reports to a module the worst of what those say that count. Returns whether that is what the
    /// speaker says.
    fn report_worst(&mut self, route: u32, id: ModuleId, voice: Voice, status: Status<'_>) -> bool {
        let (list, policy) = (&self.writers, self.net.policy(id));
        let names = &mut self.names.routes[route as usize];
        let counts = |it: &&Voice| {
            it.at + policy.timeout > voice.at
                && policy.admits(list.node(it.writer), it.state) == Admission::Counts
        };
        let others = names.voices.several.iter().flat_map(|several| &several.voices).filter(counts);
        let others = others.filter(|it| it.writer != voice.writer);
        let worst = others.clone().map(|it| it.state).max();
        let state = worst.map_or(voice.state, |worst| worst.max(voice.state));
        let speaks = state == voice.state;
        // Of several that say the same, one is shown: words that change back and forth help nobody.
        let shown = names.voices.several.as_ref().map(|several| several.shown);
        let held = others.clone().any(|it| Some(it.writer) == shown && it.state == state);
        if speaks
            && !held
            && let Some(several) = &mut names.voices.several
        {
            several.shown = voice.writer;
        }
        if self.net.report(id, state, self.now) {
            self.net.mark_module(id);
        }
        if speaks && !held {
            self.views.take_report(id, status, voice.writer, &self.model.limits);
        } else {
            self.views.note_heard(id);
        }
        speaks
    }

    fn note_stranger(&mut self, route: u32, writer: WriterId) {
        let label = self.writers.label(writer);
        self.note_dispute(route, Dispute::Stranger { who: label, count: 1 });
    }
}

fn pending_node() -> crate::engine::text::Text {
    say!(
        "the node that says OK is not known yet: it does not count until it is",
        "der Knoten, der OK meldet, ist noch nicht bekannt: bis dahin zählt das nicht"
    )
}
