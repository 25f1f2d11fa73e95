//! The events of an incident, in sentences.

use crate::texts::{IncidentWords, Lang, MESSAGE, NAME, clean};
use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::time::{Span, how_long};
use telltale_record::story::Happened;

pub(crate) fn stage_word(lang: Lang, stage: &str) -> &'static str {
    Stage::from_word(stage).map_or("", |stage| lang.stage(stage, true))
}

/// The word of a state. An unknown state is called a fault.
pub(crate) fn state_word(lang: Lang, state: &str) -> &'static str {
    State::from_word(state).map_or(IncidentWords::of(lang).root, |state| lang.state(state))
}

/// One sentence for what happened.
pub(super) fn sentence(lang: Lang, what: &Happened) -> String {
    let name = |name: &str| clean(name, 2 * NAME);
    let names = |nodes: &[String], more: usize| {
        let mut all: Vec<String> = nodes.iter().map(|node| name(node)).collect();
        if more > 0 {
            all.push(lang.and_more(more));
        }
        all.join(", ")
    };
    let quoted = |note: &str, before: &str| match clean(note, MESSAGE) {
        note if note.is_empty() => note,
        note => format!("{before}\u{201c}{note}\u{201d}"),
    };
    let of_deed = |action: &str| lang.deed(action).unwrap_or(action).to_owned();
    let (of, other) = match what {
        Happened::Fails { node, state, message, .. } => {
            (name(node), state_word(lang, state).to_owned() + &quoted(message, ", "))
        }
        Happened::FailsBehind { node } => (name(node), lang.state(State::Error).to_owned()),
        Happened::Masks { by, nodes, more } => (name(by), names(nodes, *more)),
        Happened::Recovers { nodes, more } => (String::new(), names(nodes, *more)),
        Happened::AlarmMoves { symptom, node } => (name(node), name(symptom)),
        Happened::Stage { stage } => (String::new(), stage_word(lang, stage).to_owned()),
        Happened::Signal { signal, value } => {
            (name(signal), value.map_or("unknown".to_owned(), |value| value.to_string()))
        }
        Happened::Request { request } => {
            (String::new(), lang.asked_to(request).map_or_else(|| name(request), str::to_owned))
        }
        Happened::Mark { by, note } => (name(by), quoted(note, ": ")),
        Happened::Operator { action, on } => (name(on), of_deed(action)),
        Happened::Refused { action, on, by, .. } => (name(by), format!("{} {}", of_deed(action), name(on))),
        Happened::ClockSet { by_ms } => (String::new(), how_long(Span::from_millis(by_ms.unsigned_abs()))),
        Happened::LostActive { .. } | Happened::Reload | Happened::Lost { .. } | Happened::Interrupted => {
            (String::new(), String::new())
        }
    };
    let said = lang.happened(what, &of, &other);
    match what {
        Happened::Refused { why, why_de, .. } => {
            lang.refused_deed(said.trim_end(), &clean(lang.choose(why, why_de), MESSAGE))
        }
        Happened::Operator { .. } => said.trim_end().to_owned(),
        _ => said,
    }
}
