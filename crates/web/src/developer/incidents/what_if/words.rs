//! The texts of the page of a what-if.

use crate::view::Lang;
use crate::view::words::words;

words! {
    WhatIfWords;
    title: "What if: incident", "Was wäre, wenn: Vorfall";
    configuration: "Another configuration", "Eine andere Konfiguration";
    about: "Edit the configuration. The recording then runs by the recorded one and by yours. Nothing of this touches the vehicle.", "Ändern Sie die Konfiguration. Die Aufzeichnung läuft dann mit der aufgezeichneten und mit Ihrer. Nichts davon berührt das Fahrzeug.";
    recorded_one: "Recorded text", "Aufgezeichneter Text";
    running_one: "Text in force", "Geltender Text";
    over_this: "this incident", "dieser Vorfall";
    over_all: "all kept incidents too", "auch alle aufbewahrten Vorfälle";
    run: "Run", "Durchspielen";
    waiting: "Waiting: another what-if is running.", "Wartet: Ein anderes Was-wäre-wenn läuft noch.";
    running: "Running", "Läuft";
    again: "Load again", "Neu laden";
    wrong: "The configuration has mistakes. Nothing was run.", "Die Konfiguration hat Fehler. Nichts wurde durchgespielt.";
    nothing_differs: "Nothing differs: both show the same at every instant.", "Kein Unterschied: Beide zeigen in jedem Augenblick dasselbe.";
    differs: "What would have been different", "Was anders gewesen wäre";
    means: "What both configurations mean differently", "Was beide Konfigurationen verschieden meinen";
    means_same: "Both configurations mean the same.", "Beide Konfigurationen bedeuten dasselbe.";
    incident: "Incident", "Vorfall";
    first: "First difference", "Erster Unterschied";
    same: "no difference", "kein Unterschied";
    recorded: "Recorded", "Aufgezeichnet";
    new: "New", "Neu";
    alarms: "Alarms", "Alarme";
    masked: "Masked nodes", "Maskierte Knoten";
    requests: "Requests to the vehicle", "Anforderungen ans Fahrzeug";
    transitions: "Changes", "Änderungen";
    to_root: "Time to the root", "Zeit bis zur Ursache";
    sides: "In each cell: recorded \u{2192} new.", "In jeder Zelle: aufgezeichnet \u{2192} neu.";
    alarms_new: "New alarms", "Neue Alarme";
    alarms_gone: "Alarms that are gone", "Alarme, die wegfallen";
    strips: "Nodes that differ", "Knoten mit Unterschied";
    strips_of: "of incident", "von Vorfall";
    show: "Show its strips", "Verlauf zeigen";
    replay_edited: "Replay by the edited configuration", "Wiedergabe mit der bearbeiteten Konfiguration";
    replay_recorded: "Replay as recorded", "Wiedergabe wie aufgezeichnet";
    replay: "Replay from there", "Wiedergabe ab dort";
    stage: "Stage", "Phase";
    nothing: "nothing", "nichts";
    not_there: "not there", "nicht da";
    because_of: "because of", "wegen";
    own: "own state:", "eigener Zustand:";
    only_recorded: "Only in the recorded configuration", "Nur in der aufgezeichneten Konfiguration";
    only_new: "Only in the new configuration", "Nur in der neuen Konfiguration";
    alike: "Nodes that show the same state for another cause, or another state behind it", "Knoten, die denselben Zustand aus anderer Ursache zeigen oder dahinter einen anderen haben";
    more_nodes: "more nodes differ", "weitere Knoten mit Unterschied";
    more: "more", "weitere";
    notes: "What could not be used", "Was nicht verwendet werden konnte";
    missing: "The recording is missing.", "Die Aufzeichnung fehlt.";
    too_large: "The recording is too large: run it with `telltale replay --what-if`.", "Die Aufzeichnung ist zu groß: Spielen Sie sie mit `telltale replay --what-if` durch.";
    over_time: "It takes too long here: run it with `telltale replay --what-if`.", "Das dauert hier zu lange: Spielen Sie sie mit `telltale replay --what-if` durch.";
}

impl WhatIfWords {
    pub fn of(lang: Lang) -> &'static WhatIfWords {
        match lang {
            Lang::En => &EN,
            Lang::De => &DE,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::ALL;

    #[test]
    fn every_word_is_there_in_both_languages() {
        for (key, en, de) in ALL {
            assert!(!en.trim().is_empty() && !de.trim().is_empty(), "{key}");
        }
    }
}
