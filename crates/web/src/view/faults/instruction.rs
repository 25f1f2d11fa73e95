//! The instruction: what the operator has to do now, and below it what the vehicle does and because of what.

use askama::Template;

use super::entries::{FaultEntry, is_of_localization};
use crate::view::node_names::icon;
use crate::view::{Fragment, View, html, requests};
use telltale_engine::input::Refusal;
use telltale_engine::model::wording;
use telltale_engine::model::{LOCALIZATION_GROUP, NodeId, Stage};
use telltale_engine::snapshot::{Moving, Reason};
use telltale_engine::state::State;

/// A longer text is too long for one line of large type: its later sentences stand beside the fault.
const TITLE_LETTERS: usize = 44;

/// How soon the operator has to act. The last one is the most urgent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Priority {
    /// Nothing to do.
    #[default]
    None,
    /// The next step of the stage, or a fault at a stop.
    Act,
    BeReady,
    TakeOver,
}

impl Priority {
    /// The word of the `data-urgency` attribute.
    const fn as_str(self) -> &'static str {
        match self {
            Priority::None => "none",
            Priority::Act => "act",
            Priority::BeReady => "be_ready",
            Priority::TakeOver => "take_over",
        }
    }
}

impl From<wording::Urgency> for Priority {
    fn from(urgency: wording::Urgency) -> Priority {
        match urgency {
            wording::Urgency::BeReady => Priority::BeReady,
            wording::Urgency::TakeOver => Priority::TakeOver,
        }
    }
}

#[derive(Template)]
#[template(path = "partials/instruction.html")]
struct InstructionHtml {
    swap: bool,
    urgency: &'static str,
    /// The step cannot be taken now.
    blocked: bool,
    icon: &'static str,
    title: String,
    /// The title for somebody who may not act.
    reader: String,
    line: String,
    sentences: Vec<requests::Sentence>,
    /// The strongest request to the vehicle and its state.
    request: Option<(&'static str, &'static str)>,
}

/// The words of the instruction. An empty title is none.
#[derive(Debug, Default)]
struct Instruction {
    urgency: Priority,
    blocked: bool,
    icon: &'static str,
    title: String,
    /// The words for a reader who may not act.
    reader: Option<&'static str>,
    /// Sentences before those about the requests.
    line: String,
    /// The fault that it tells of.
    node: Option<NodeId>,
}

pub fn instruction(view: &View<'_>, entries: &[FaultEntry]) -> Fragment {
    let it = of_stage(view, entries);
    let sentences = requests::sentences(view);
    // Without a request the second line names the fault, where it has no words of its own.
    let fault = it.node.filter(|_| sentences.is_empty() && it.line.is_empty());
    let fault = fault.and_then(|node| entries.iter().find(|entry| entry.node == node));
    let fault = fault.map(|entry| format!("{}.", entry.title));
    // Only the advice on a fault has another place for its later sentences.
    let title = if it.node.is_some() { split(&it.title).0 } else { it.title.as_str() };
    let reader = for_reader(view, &it, title);
    let line = [it.line.as_str()].into_iter().chain(fault.as_deref());
    let html = html(&InstructionHtml {
        swap: view.swap,
        urgency: it.urgency.as_str(),
        blocked: it.blocked,
        icon: it.icon,
        title: title.to_owned(),
        reader,
        line: line.filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" "),
        sentences,
        request: view.snapshot.countermeasure().map(|it| (it.request.as_str(), it.state.as_str())),
    });
    Fragment { id: "instruction".to_owned(), html }
}

/// What the list beside the instruction has to know of it.
pub struct Told {
    urgency: Priority,
    title: String,
    node: Option<NodeId>,
}

pub fn told(view: &View<'_>, entries: &[FaultEntry]) -> Told {
    let it = of_stage(view, entries);
    Told { urgency: it.urgency, title: it.title, node: it.node }
}

impl Told {
    /// The advice that a row of the list still gives, and whether that is the rest of the instruction's own. Nobody
    /// follows two instructions at once: while the vehicle drives, the instruction is the only advice; at a stop a row
    /// is silent where the instruction is about something worse, or says the same.
    pub fn left_for(&self, entry: &FaultEntry, help: String) -> (String, bool) {
        if self.node == Some(entry.node) && !entry.over {
            return (split(&self.title).1.to_owned(), true);
        }
        let is_milder = match self.urgency {
            Priority::TakeOver | Priority::BeReady => true,
            Priority::Act => self.node.is_some() && entry.state == State::Warning,
            Priority::None => false,
        };
        let is_silent = is_milder || help == self.title;
        (if is_silent { String::new() } else { help }, false)
    }
}

fn of_stage(view: &View<'_>, entries: &[FaultEntry]) -> Instruction {
    let snapshot = view.snapshot;
    let act = |icon, title: &str| Instruction {
        urgency: Priority::Act,
        icon,
        title: title.to_owned(),
        ..Instruction::default()
    };
    match snapshot.stage {
        Stage::Locked => Instruction::default(),
        Stage::Localizing if is_wrong_stop(view) => Instruction {
            blocked: true,
            reader: Some(view.words.operator_chooses),
            line: wrong_stop(view),
            // Its own advice is this one, or gives way to it.
            node: entries.iter().map(|entry| entry.node).find(|&node| is_of_localization(view, node)),
            ..act("stage-localizing", view.words.choose_again)
        },
        Stage::Localizing if snapshot.localization.given.is_some() => at_a_stop(view, entries)
            .unwrap_or_else(|| Instruction {
                urgency: Priority::None,
                ..act("locating", view.words.locating)
            }),
        Stage::Localizing => {
            let reader = Some(view.words.operator_chooses);
            Instruction { reader, ..act("stage-localizing", view.words.where_is_it) }
        }
        Stage::Standby if snapshot.clearance_refusals.is_empty() => Instruction {
            reader: Some(view.words.operator_clears),
            ..act("drive", view.words.clear_to_drive)
        },
        Stage::Standby => at_a_stop(view, entries).unwrap_or_else(|| {
            if requests::waits_for_release(view) {
                let reader = Some(view.words.operator_continues);
                return Instruction { reader, ..act("idle", view.words.held_end) };
            }
            let no_goal = snapshot.clearance_refusals.iter().any(|it| matches!(it, Refusal::NoGoal));
            let title = if no_goal { view.words.wait_for_goal } else { view.words.wait };
            Instruction { urgency: Priority::None, ..act("ready", title) }
        }),
        Stage::Cleared | Stage::Active => driving(view, entries),
    }
}

/// Whether the localization finds that the vehicle does not stand at the stop that was chosen. What waits for another
/// fault finds nothing.
pub fn is_wrong_stop(view: &View<'_>) -> bool {
    let snapshot = view.snapshot;
    let (Some(NodeId::Group(id)), Some(given)) =
        (snapshot.node(LOCALIZATION_GROUP), snapshot.localization.given)
    else {
        return false;
    };
    let group = snapshot.group(id).1;
    // An ERROR from before the choice may be that of the choice before.
    let is_of_choice = group.since >= given || snapshot.localization.late;
    snapshot.stage == Stage::Localizing && group.state == State::Error && is_of_choice
}

/// Which stop was chosen, and that it is not the right one.
fn wrong_stop(view: &View<'_>) -> String {
    let chosen = view.chosen_stop().map(|name| format!("{}: {name}. ", view.words.chosen));
    format!("{}{}", chosen.unwrap_or_default(), view.words.stop_is_wrong)
}

/// The words for a reader who may not act: only the operator is told to act.
fn for_reader(view: &View<'_>, it: &Instruction, title: &str) -> String {
    match it.reader {
        Some(words) => words.to_owned(),
        None if it.urgency == Priority::None => title.to_owned(),
        None => format!("{} {title}", view.words.for_operator),
    }
}

/// The advice on the first fault that keeps the vehicle at its stop.
fn at_a_stop(view: &View<'_>, entries: &[FaultEntry]) -> Option<Instruction> {
    let mut faults = entries.iter().filter(|entry| !entry.over && !entry.help.is_empty());
    // A WARNING keeps it there where it has to be accepted before a clearance.
    let is_open = |entry: &FaultEntry| {
        view.stage_of_advice() == Stage::Standby && !view.snapshot.accepted.contains_key(&entry.node)
    };
    let entry = faults.find(|entry| entry.state != State::Warning || is_open(entry))?;
    Some(Instruction {
        urgency: Priority::Act,
        blocked: true,
        icon: icon(entry.state, None),
        title: entry.help.clone(),
        node: Some(entry.node),
        ..Instruction::default()
    })
}

fn driving(view: &View<'_>, entries: &[FaultEntry]) -> Instruction {
    let request = requests::moving(view).next();
    let stands = view.snapshot.motion.moving == Moving::No;
    let say = |urgency, icon, title: &str| Instruction {
        urgency,
        icon,
        title: title.to_owned(),
        ..Instruction::default()
    };
    if let Some(it) = request.filter(|it| requests::fails(it) && view.has_stages() && !stands) {
        let how = requests::progress(view, it).to_owned();
        return Instruction { line: how, ..say(Priority::TakeOver, "error", view.words.take_over_stop) };
    }
    let advice = match request {
        Some(_) if stands && requests::waits_for_release(view) => None,
        Some(_) if stands => at_a_stop(view, entries),
        _ => advice(view, entries),
    };
    if let Some(advice) = advice {
        return advice;
    }
    // The operator's own stop holds until the operator ends it, whatever became of a fault.
    let stopped = view.snapshot.stop_requested();
    let title = match (request, stands) {
        (None, _) if view.snapshot.stage == Stage::Cleared => {
            return say(Priority::None, "ready", view.words.may_start);
        }
        (None, _) => return Instruction::default(),
        (Some(_), _) if !requests::waits_for_release(view) => {
            return say(Priority::None, "slow", view.words.held_back);
        }
        // The operator's own stop needs no other step before the vehicle stands.
        (Some(it), false) if it.causes.is_empty() => {
            return say(Priority::None, "stop", view.words.stop_requested);
        }
        (Some(it), true) if it.causes.is_empty() || stopped || !requests::causes_are_gone(view) => {
            view.words.stopped_continue
        }
        (Some(_), true) => view.words.stopped_cause_gone,
        (Some(_), false) if stopped || !requests::causes_are_gone(view) => view.words.continue_driving,
        (Some(_), false) => view.words.cause_gone,
    };
    let reader = stands.then_some(view.words.operator_continues);
    Instruction { reader, ..say(Priority::Act, "idle", title) }
}

/// The most urgent advice among the present faults; the first of them if several are alike. If none in sight asks for
/// as much as one that waits for its cause, or as was asked before, it is the advice of that one, with the cause in sight.
fn advice(view: &View<'_>, entries: &[FaultEntry]) -> Option<Instruction> {
    let present = entries.iter().filter(|entry| !entry.over && !entry.help.is_empty());
    let rated =
        present.map(|entry| (urgency(view, entry), entry)).filter(|(urgency, _)| *urgency > Priority::None);
    // `max_by_key` gives the last of those that are alike.
    let first = rated.rev().max_by_key(|(urgency, _)| *urgency);
    let (urgency, node, state, title) = match (first, view.asked()) {
        (first, Some(asked)) if first.is_none_or(|(urgency, _)| urgency < asked.urgency.into()) => {
            let node = in_sight(view, entries, asked.node);
            (asked.urgency.into(), node, State::Error, view.advice_of(asked))
        }
        (Some((urgency, entry)), _) => (urgency, entry.node, entry.state, entry.help.clone()),
        (None, _) => return None,
    };
    Some(Instruction {
        urgency,
        blocked: urgency == Priority::Act,
        icon: match urgency {
            Priority::TakeOver => "error",
            Priority::BeReady => "warning",
            Priority::Act | Priority::None => icon(state, None),
        },
        title,
        node: Some(node),
        ..Instruction::default()
    })
}

/// The node of the entry that stands for a fault: its own, or that of its first cause.
fn in_sight(view: &View<'_>, entries: &[FaultEntry], node: NodeId) -> NodeId {
    let causes = match view.snapshot.shown(node).1 {
        Some(Reason::Masked { by }) => by,
        Some(Reason::NotRelevant(_)) | None => &[node][..],
    };
    let entry = |cause: &NodeId| {
        let places = view.snapshot.places_of(*cause);
        entries.iter().find(|entry| !entry.over && places.contains(&entry.node))
    };
    causes.iter().find_map(entry).map_or(node, |entry| entry.node)
}

/// The urgency of a fault in sight. A machine without stages never drives: there a fault is to be seen to.
fn urgency(view: &View<'_>, entry: &FaultEntry) -> Priority {
    match entry.urgency {
        Some(urgency) => urgency.into(),
        None if !view.has_stages() && entry.state > State::Warning => Priority::Act,
        None => Priority::None,
    }
}

/// The sentences that have room in the first line, and the others.
fn split(text: &str) -> (&str, &str) {
    let ends = text.match_indices(". ").map(|(at, _)| at + 1);
    let fitting = ends.filter(|&end| text[..end].chars().count() <= TITLE_LETTERS).last();
    match fitting {
        Some(end) if text.chars().count() > TITLE_LETTERS => (&text[..end], text[end..].trim_start()),
        _ => (text, ""),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_advice_is_cut_between_sentences() {
        assert_eq!(split("Take over. Stop."), ("Take over. Stop.", ""));
        let long = "Take over. Use the emergency brake. Call the control room.";
        assert_eq!(split(long), ("Take over. Use the emergency brake.", "Call the control room."));
        let one = "Am nächsten sicheren Ort in der Umgebung anhalten.";
        assert_eq!(split(one), (one, ""));
    }
}
