//! The texts of the pages of incidents.

use crate::web::view::Lang;
use crate::web::view::words::words;

words! {
    IncidentWords;
    incident: "Incident", "Vorfall";
    any: "any", "alle";
    yes: "yes", "ja";
    no: "no", "nein";
    show_all: "Show all", "Alle zeigen";
    older: "Older incidents", "Ältere Vorfälle";
    length: "Length", "Dauer";
    size: "Size", "Größe";
    lasts: "is being recorded", "wird aufgezeichnet";
    none: "Nothing has been recorded yet. A WARNING, an ERROR, a request to the vehicle, an end of autonomous driving on the way, or a mark is recorded by itself, with what came before it.", "Noch ist nichts aufgezeichnet. Eine WARNING, ein ERROR, eine Anforderung an das Fahrzeug, ein Ende des autonomen Fahrens unterwegs oder eine Markierung wird von selbst aufgezeichnet, samt der Zeit davor.";
    off: "Nothing is recorded: the configuration has `recording: false`. Remove that and start Telltale again.", "Nichts wird aufgezeichnet: In der Konfiguration steht `recording: false`. Entfernen Sie das und starten Sie Telltale neu.";
    fault: "Nothing can be recorded", "Nichts kann aufgezeichnet werden";
    marked: "marked", "markiert";
    kept: "kept", "aufbewahrt";
    storm: "storm", "Störungsflut";
    interrupted: "interrupted", "unterbrochen";
    unfinished: "not completed", "nicht abgeschlossen";
    why: "Why", "Anlass";
    note: "Note", "Notiz";
    what_happened: "What happened", "Was geschah";
    states: "States", "Zustände";
    freeze: "Values at the first instant", "Werte im ersten Augenblick";
    recording: "Recording", "Aufzeichnung";
    download: "Download the recording", "Aufzeichnung herunterladen";
    keep: "Keep it", "Aufbewahren";
    release: "Keep it no longer", "Nicht länger aufbewahren";
    save: "Save the note", "Notiz speichern";
    messages: "Messages", "Nachrichten";
    seconds: "Seconds", "Sekunden";
    lost: "Missing", "Es fehlen";
    before: "before the first trigger", "vor dem ersten Anlass";
    no_file: "The recording is not there any more: its file is missing in the folder of the recordings. What follows is what the database knows.", "Die Aufzeichnung ist nicht mehr da: Ihre Datei fehlt im Ordner der Aufzeichnungen. Was folgt, weiß die Datenbank.";
    bad_file: "The recording cannot be read", "Die Aufzeichnung ist nicht lesbar";
    incomplete: "The file is not completed: what was written so far is shown.", "Die Datei ist nicht abgeschlossen: Gezeigt ist, was bisher geschrieben ist.";
    cut: "The file is longer than what is read for this page: its end is not shown.", "Die Datei ist länger, als für diese Seite gelesen wird: Ihr Ende fehlt hier.";
    left_out: "Parts of the file cannot be used", "Teile der Datei sind unbrauchbar";
    busy: "Other recordings are being read. Load the page again.", "Gerade werden andere Aufzeichnungen gelesen. Laden Sie die Seite neu.";
    nothing_told: "The recording tells no change.", "Die Aufzeichnung zeigt keine Änderung.";
    no_topics: "The recording has no messages.", "Die Aufzeichnung enthält keine Nachrichten.";
    no_values: "Nothing had failed at the first trigger.", "Beim ersten Anlass war nichts ausgefallen.";
    version: "Telltale", "Telltale";
    configuration: "Configuration", "Konfiguration";
    root: "fault", "Störung";
    lost_active: "autonomous driving ended", "autonomes Fahren endete";
    countermeasure: "request to the vehicle", "Anforderung an das Fahrzeug";
    mark: "mark", "Markierung";
    reloaded: "The configuration was replaced", "Die Konfiguration wurde ersetzt";
}

impl IncidentWords {
    pub fn of(lang: Lang) -> &'static IncidentWords {
        match lang {
            Lang::En => &EN,
            Lang::De => &DE,
        }
    }

    /// A kind of trigger.
    pub fn kind<'a>(&self, kind: &'a str) -> &'a str {
        match kind {
            "root" => self.root,
            "lost_active" => self.lost_active,
            "countermeasure" => self.countermeasure,
            "mark" => self.mark,
            other => other,
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
