//! The texts of a node's page.

use crate::view::Lang;
use crate::view::words::words;

words! {
    NodeWords;
    past: "States over time", "Zustände über die Zeit";
    numbers_none: "No number of this module has a past yet.", "Noch keine Zahl dieses Moduls hat eine Vergangenheit.";
    numbers_kept: "Numbers are kept for five minutes. Earlier ones are in the recordings of incidents.", "Zahlen bleiben fünf Minuten. Frühere stehen in den Aufzeichnungen von Vorfällen.";
    transitions: "Transitions", "Wechsel";
    no_transitions: "No state is recorded in this span.", "In dieser Spanne ist kein Zustand aufgezeichnet.";
    lasted: "For", "Dauer";
    still: "still", "noch";
    written: "Configuration", "Konfiguration";
    written_group: "Not written in the configuration: its group matched it.", "Steht nicht in der Konfiguration: Seine Gruppe hat es erfasst.";
    whole_file: "whole file", "ganze Datei";
    more_lines: "more lines", "weitere Zeilen";
    around: "What it depends on, and what depends on it", "Wovon es abhängt, und was von ihm abhängt";
    alone: "It depends on nothing, and nothing depends on it.", "Es hängt von nichts ab, und nichts hängt von ihm ab.";
    incidents: "Incidents that it caused", "Vorfälle, die es verursachte";
    incidents_none: "No incident had it as a root cause.", "Bei keinem Vorfall war es die Ursache.";
    incidents_all: "all", "alle";
    monitor: "Monitor", "Monitor";
    class: "Class", "Klasse";
    status: "Status", "Status";
    hardware: "Hardware", "Hardware";
}

impl NodeWords {
    pub fn of(lang: Lang) -> &'static NodeWords {
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
