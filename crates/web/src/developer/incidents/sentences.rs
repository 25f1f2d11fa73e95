//! What happened, in sentences.

use super::words::IncidentWords;
use crate::view::Lang;
use crate::view::text::{MESSAGE, NAME, clean};
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
    let text = |en: String, de: String| if lang == Lang::De { de } else { en };
    match what {
        Happened::Fails { node, state, message } => {
            let (node, word) = (name(node), state_word(lang, state));
            match clean(message, MESSAGE) {
                message if message.is_empty() => format!("{node}: {word}"),
                message => format!("{node}: {word}, \u{201c}{message}\u{201d}"),
            }
        }
        Happened::FailsBehind { node } => {
            let (node, word) = (name(node), lang.state(State::Error));
            text(
                format!("{node}: {word}, hidden by its cause"),
                format!("{node}: {word}, verdeckt von der Ursache"),
            )
        }
        Happened::Masks { by, nodes, more } => {
            let (by, nodes) = (name(by), names(nodes, *more));
            text(format!("{by} hides: {nodes}"), format!("{by} verdeckt: {nodes}"))
        }
        Happened::Recovers { nodes, more } => {
            let nodes = names(nodes, *more);
            text(format!("OK again: {nodes}"), format!("Wieder OK: {nodes}"))
        }
        Happened::AlarmMoves { symptom, node } => {
            let (symptom, node) = (name(symptom), name(node));
            text(
                format!("{symptom} was a symptom: the cause is {node}"),
                format!("{symptom} war eine Folge: Die Ursache ist {node}"),
            )
        }
        Happened::Stage { stage } => {
            let stage = stage_word(lang, stage);
            text(format!("The vehicle: {stage}"), format!("Das Fahrzeug: {stage}"))
        }
        Happened::Signal { signal, value } => {
            let value = value.map_or("unknown", |value| if value { "true" } else { "false" });
            text(format!("Signal {}: {value}", name(signal)), format!("Signal {}: {value}", name(signal)))
        }
        Happened::LostActive { .. } => text(
            "Autonomous driving ended while the vehicle was not known to stand".to_owned(),
            "Autonomes Fahren endete, ohne dass das Fahrzeug sicher stand".to_owned(),
        ),
        Happened::Request { request } => {
            let request = match (lang, &**request) {
                (Lang::En, "decelerate") => "slow down".to_owned(),
                (Lang::De, "decelerate") => "abbremsen".to_owned(),
                (Lang::En, "maneuver_stop") => "stop safely".to_owned(),
                (Lang::De, "maneuver_stop") => "sicher anhalten".to_owned(),
                (_, other) => name(other),
            };
            text(format!("The vehicle is asked to {request}"), format!("Das Fahrzeug soll {request}"))
        }
        Happened::Mark { by, note } => {
            let (by, note) = (name(by), clean(note, MESSAGE));
            let said = if note.is_empty() { note } else { format!(": \u{201c}{note}\u{201d}") };
            text(format!("Marked by {by}{said}"), format!("Markiert von {by}{said}"))
        }
        Happened::Operator { action, on } => {
            let (en, de) = operator(action);
            let on = name(on);
            text(format!("The operator {en} {on}"), format!("Fahrbegleitung: {de} {on}"))
                .trim_end()
                .to_owned()
        }
        Happened::Refused { action, on, by, why, why_de } => {
            let (en, de) = operator(action);
            let (on, by) = (name(on), name(by));
            let [why, why_de] = [why, why_de].map(|why| clean(why, MESSAGE));
            text(
                format!("The operator {by} {en} {on}").trim_end().to_owned() + &format!(". Refused: {why}"),
                format!("Fahrbegleitung {by}: {de} {on}").trim_end().to_owned()
                    + &format!(". Abgelehnt: {why_de}"),
            )
        }
        Happened::ClockSet { by_ms } => {
            let long = how_long(Span::from_millis(by_ms.unsigned_abs()));
            let (en, de) = if *by_ms < 0 { ("back", "zurück") } else { ("forward", "vor") };
            text(
                format!("The clock was set {en} by {long}, which the times here do not follow"),
                format!("Die Uhr wurde um {long} {de}gestellt; die Zeiten hier laufen gleichmäßig weiter"),
            )
        }
        Happened::Reload => IncidentWords::of(lang).reloaded.to_owned(),
        Happened::Lost { count } => text(
            format!("{count} changes before this are missing"),
            format!("{count} Änderungen davor fehlen"),
        ),
        Happened::Interrupted => IncidentWords::of(lang).interrupted_here.to_owned(),
    }
}

/// What the operator did, or tried to do.
fn operator(action: &str) -> (&str, &str) {
    match action {
        "login" => ("logs in:", "Anmeldung:"),
        "logout" => ("logs out", "Abmeldung"),
        "shutdown" => ("ends the work", "Dienstende"),
        "localize" => ("says where the vehicle is", "Positionsangabe"),
        "clearance" => ("presses: give clearance", "drückt: Freigabe"),
        "stop" => ("presses STOP", "drückt STOPP"),
        "withdraw" => ("withdraws the clearance", "widerruft die Freigabe"),
        "release" => ("presses: continue driving", "drückt: Weiterfahrt"),
        "acknowledge" => ("acknowledges", "quittiert"),
        "reset" => ("resets", "setzt zurück:"),
        other => (other, other),
    }
}
