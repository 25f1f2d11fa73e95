//! The texts of the page of learned dependencies.

use telltale_learn::Direction;

texts! {
    words LearnWords {
        about: "Compares the configured dependencies with when the modules failed, over the whole history. A proposal is never in force by itself.", "Vergleicht die eingetragenen Abhängigkeiten damit, wann die Module ausgefallen sind, über den ganzen Verlauf. Kein Vorschlag gilt von selbst.";
        run: "Evaluate the history", "Verlauf auswerten";
        never: "The history has not been evaluated since the start.", "Seit dem Start wurde der Verlauf noch nicht ausgewertet.";
        running: "The history is being evaluated.", "Der Verlauf wird ausgewertet.";
        again: "Show how far it is", "Zeigen, wie weit es ist";
        evaluated: "Evaluated", "Ausgewertet";
        nothing: "The history has nothing of the modules of this configuration.", "Der Verlauf enthält nichts von den Modulen dieser Konfiguration.";
        too_much: "The history is too large to be evaluated on the vehicle. Copy the data folder to another computer and use `telltale learn` there.", "Der Verlauf ist zu groß, um ihn auf dem Fahrzeug auszuwerten. Kopieren Sie den Datenordner auf einen anderen Rechner und nehmen Sie dort `telltale learn`.";
        failed: "The history cannot be evaluated", "Der Verlauf kann nicht ausgewertet werden";
        changed: "The configuration is another one now. Evaluate the history again.", "Die Konfiguration ist inzwischen eine andere. Werten Sie den Verlauf neu aus.";
        none: "The history suggests no change.", "Der Verlauf legt keine Änderung nahe.";
        proposals: "Proposals", "Vorschläge";
        add: "Add", "Eintragen";
        remove: "Remove", "Streichen";
        narrow: "Narrow", "Eingrenzen";
        depends_on: "depends on", "hängt ab von";
        narrowed: "narrowed to", "eingegrenzt auf";
        how_often: "How often", "Wie oft";
        noticed: "Noticed", "Bemerkt";
        why: "Why this is the cause", "Warum das die Ursache ist";
        examples: "Failed together", "Zusammen ausgefallen";
        counterexamples: "Counterexamples", "Gegenbeispiele";
        no_counterexample: "none", "keine";
        incident: "incident", "Vorfall";
        undecided: "Undecided", "Unentschieden";
        undecided_about: "These fail together, and nothing tells which one is the cause. So nothing is proposed.", "Diese fallen zusammen aus, und nichts verrät, was die Ursache ist. Darum wird nichts vorgeschlagen.";
        silences: "Silent in some states", "In manchen Zuständen stumm";
        silences_about: "With this `when` in the configuration, the module does not matter there. It is not in the patch.", "Mit diesem `when` in der Konfiguration zählt das Modul dort nicht. Im Patch steht es nicht.";
        patch: "Patch for the configuration", "Patch für die Konfiguration";
        by_hand: "Not in the patch, because it is written in another form or file. Change by hand the dependencies of", "Nicht im Patch, weil es anders oder in einer anderen Datei geschrieben ist. Ändern Sie von Hand die Abhängigkeiten von";
        accepted: "`check` accepts the changed configuration without a warning.", "`check` nimmt die geänderte Konfiguration ohne Warnung an.";
        warned: "`check` accepts the changed configuration and warns:", "`check` nimmt die geänderte Konfiguration an und warnt:";
        refused: "`check` refuses the changed configuration:", "`check` lehnt die geänderte Konfiguration ab:";
        try_it: "Try it on incidents", "An Vorfällen erproben";
        in_graph: "Show in the graph", "Im Graphen zeigen";
        not_in_graph: "Without proposals", "Ohne Vorschläge";
        legend: "proposed", "vorgeschlagen";
    }

    text failed_together(part: usize, whole: u64, low: &str, high: &str) {
        "in {part} of {whole} failures of the cause ({low} % to {high} %)", "bei {part} von {whole} Ausfällen der Ursache ({low} % bis {high} %)"
    }

    text than_by_chance(times: &str, p: &str) {
        "{times} times as often as by chance (p {p})", "{times}-mal so oft wie durch Zufall (p {p})"
    }

    /// The dependent, sooner and later.
    text noticed(is_before: bool, is_after: bool; first: &str, last: &str) {
        _, false => "{last} s to {first} s before the cause", "{last} s bis {first} s vor der Ursache";
        true, _ => "{first} s before to {last} s after the cause", "{first} s vor bis {last} s nach der Ursache";
        _, _ if first == last => "{first} s after the cause", "{first} s nach der Ursache";
        _, _ => "{first} s to {last} s after the cause", "{first} s bis {last} s nach der Ursache";
    }

    text without_effect(is_one_of_many: bool; cause: &str, dependent: &str, part: usize, whole: u64, high: &str) {
        true => "{cause} failed {whole} times, {dependent} in {part} of them (at most {high} %), and no other module there more often.", "{cause} ist {whole}-mal ausgefallen, {dependent} dabei {part}-mal (höchstens {high} %) und kein anderes Modul dort öfter.";
        false => "{cause} failed {whole} times, and {dependent} in {part} of them (at most {high} %).", "{cause} ist {whole}-mal ausgefallen, {dependent} dabei {part}-mal (höchstens {high} %).";
    }

    text silent_times(part: usize, whole: u64, low: &str, high: &str) {
        "silent {part} of {whole} times ({low} % to {high} %)", "{part} von {whole} Mal stumm ({low} % bis {high} %)"
    }

    /// Why the one is the cause, and not the other way round.
    text direction(is: Direction; cause: &str, dependent: &str, seconds: &str) {
        Direction::Feeds => "{cause} counts the messages that {dependent} reads.", "{cause} zählt die Nachrichten, die {dependent} liest.";
        Direction::Alone(times) => "{dependent} also failed while {cause} stayed well, {times} times.", "{dependent} ist auch ausgefallen, während {cause} in Ordnung blieb, {times}-mal.";
        Direction::Earlier(_) => "{cause} began to fail earlier, by about {seconds} s, as the delays of the monitors let it be estimated.", "{cause} ist früher ausgefallen, um etwa {seconds} s, soweit es sich aus den Verzögerungen der Monitore schätzen lässt.";
    }

    text learned_in_all(learned: usize, failed: usize, modules: usize) {
        "{failed} of {modules} modules ever failed. {learned} dependencies show in the history.", "{failed} von {modules} Modulen sind je ausgefallen. {learned} Abhängigkeiten zeigen sich im Verlauf."
    }
}
