//! An incident in one sentence, in the words of the operator's page, and how bad it was.

use crate::texts::{IncidentWords, NAME, clean};
use crate::view::{View, past_fault};
use telltale_engine::state::State;
use telltale_record::summary::{Summary, kind};

pub struct Told {
    /// The worst state of its causes; empty if nothing failed.
    pub state: &'static str,
    pub word: &'static str,
    pub sentence: String,
}

pub fn told(view: &View<'_>, summary: &Summary) -> Told {
    let lang = view.lang;
    let mut causes: Vec<(&str, State)> =
        summary.causes().into_iter().map(|node| (node, state(summary, node))).collect();
    // The first one of the worst is named.
    causes.sort_by_key(|(_, state)| std::cmp::Reverse(*state));
    let mut parts = Vec::new();
    if let Some((node, state)) = causes.first() {
        let (title, place) = past_fault(view, node, *state);
        let what = if place.is_empty() { title } else { format!("{title} ({place})") };
        parts.push(match causes.len() - 1 {
            0 => what,
            more => format!("{what} {}", lang.and_more_faults(more)),
        });
    }
    let of = |kind: &'static str| summary.triggers.iter().filter(move |trigger| trigger.kind == kind);
    let mut asked: Vec<&str> = of(kind::COUNTERMEASURE).map(|trigger| &*trigger.what).collect();
    asked.sort_unstable();
    asked.dedup();
    let asked: Vec<String> = asked
        .into_iter()
        .map(|request| lang.asked_to(request).map_or_else(|| clean(request, NAME), str::to_owned))
        .collect();
    parts.extend((!asked.is_empty()).then(|| lang.was_asked_to(&asked.join(IncidentWords::of(lang).and))));
    let ended = of(kind::LOST_ACTIVE).next().map(|_| IncidentWords::of(lang).ended_on_the_way.to_owned());
    parts.extend(ended);
    let mut by: Vec<String> = of(kind::MARK).map(|mark| clean(&mark.what, NAME)).collect();
    by.dedup();
    parts.extend((!by.is_empty()).then(|| lang.marked_by(&by.join(", "))));
    let failed = causes.first().map(|(_, state)| *state);
    let failed = failed.or(of(kind::LOST_ACTIVE).next().map(|_| State::Error));
    let failed = failed.or(of(kind::COUNTERMEASURE).next().map(|_| State::Warning));
    Told {
        state: failed.map_or("", State::as_str),
        word: failed.map_or(IncidentWords::of(lang).marked, |state| lang.state(state)),
        sentence: sentence(&parts, causes.is_empty()),
    }
}

/// The state of a cause when it failed. A fault whose state is not known counts as an ERROR.
fn state(summary: &Summary, node: &str) -> State {
    let frozen = summary.freeze.iter().filter(|frozen| frozen.node == node);
    let faults = frozen.filter_map(|frozen| State::from_word(&frozen.state));
    faults.filter(|state| *state > State::Ok).max().unwrap_or(State::Error)
}

/// A title begins as it is written: it may be an id.
fn sentence(parts: &[String], begins_with_words: bool) -> String {
    let joined = parts.join("; ");
    let mut letters = joined.chars();
    let text = match letters.next() {
        None => return joined,
        Some(first) if begins_with_words => first.to_uppercase().chain(letters).collect(),
        Some(_) => joined,
    };
    if text.ends_with(['.', '!', '?']) { text } else { format!("{text}.") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texts::Lang;
    use crate::view::tests::jump;
    use telltale_record::summary::{FrozenNode, TriggerLine};

    fn trigger(kind: &str, what: &str) -> TriggerLine {
        let note = String::new();
        TriggerLine { at_ms: 0, kind: kind.to_owned(), what: what.to_owned(), alarm: None, note }
    }

    fn frozen(node: &str, state: State) -> FrozenNode {
        FrozenNode {
            node: node.to_owned(),
            state: state.as_str().to_owned(),
            message: String::new(),
            values: Vec::new(),
            at_ms: None,
        }
    }

    #[test]
    fn an_incident_is_told_in_the_words_of_the_operators_page() {
        let published = jump().published();
        let told = |lang, triggers: &[TriggerLine], freeze: &[FrozenNode]| {
            let summary =
                Summary { triggers: triggers.to_vec(), freeze: freeze.to_vec(), ..Summary::default() };
            let Told { state, word, sentence } = told(&View::new(&published, lang, false), &summary);
            (state, word, sentence)
        };
        let jumped = [
            trigger(kind::ROOT, "sensors/imu"),
            trigger(kind::ROOT, "localization/tf_quality"),
            trigger(kind::COUNTERMEASURE, "decelerate"),
            trigger(kind::COUNTERMEASURE, "maneuver_stop"),
            trigger(kind::COUNTERMEASURE, "decelerate"),
            trigger(kind::LOST_ACTIVE, "standby"),
        ];
        let freeze = [frozen("sensors/imu", State::Warning), frozen("localization/tf_quality", State::Error)];
        for (lang, expect) in [
            (
                Lang::En,
                "Position jumped (Localization) and 1 more; the vehicle was asked to slow down and stop safely; autonomous driving ended on the way.",
            ),
            (
                Lang::De,
                "Position ist gesprungen (Lokalisierung) und 1 weitere Störung; das Fahrzeug sollte abbremsen und sicher anhalten; das autonome Fahren endete unterwegs.",
            ),
        ] {
            assert_eq!(told(lang, &jumped, &freeze), ("error", lang.state(State::Error), expect.to_owned()));
        }
        // Of equally bad ones the first is named, and a WARNING in between does not matter.
        let three = ["perception/costmap_delay", "sensors/imu", "localization/tf_quality"];
        let freeze = [State::Warning, State::Error, State::Error];
        let freeze: Vec<FrozenNode> =
            three.iter().zip(freeze).map(|(node, state)| frozen(node, state)).collect();
        let (state, _, sentence) = told(Lang::En, &three.map(|node| trigger(kind::ROOT, node)), &freeze);
        assert!(state == "error" && sentence.starts_with("Motion sensor"), "{state}: {sentence}");
        let gone = [trigger(kind::ROOT, "gone/module")];
        assert_eq!(told(Lang::En, &gone, &[]), ("error", "Error", "gone/module.".to_owned()));
        let marked = [trigger(kind::MARK, "anna"), trigger(kind::MARK, "anna")];
        assert_eq!(told(Lang::En, &marked, &[]), ("", "marked", "Marked by anna.".to_owned()));
        assert_eq!(told(Lang::En, &[], &[]).2, "");
    }
}
