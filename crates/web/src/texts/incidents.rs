//! The texts of the pages of incidents, their reports, replays and what-ifs.

use telltale_record::story::Happened;

texts! {
    words IncidentWords {
        incident: "Incident", "Vorfall";
        any: "any", "alle";
        yes: "yes", "ja";
        no: "no", "nein";
        show_all: "Show all", "Alle zeigen";
        older: "Older incidents", "Ältere Vorfälle";
        length: "Length", "Dauer";
        size: "Size", "Größe";
        lasts: "is being recorded", "wird aufgezeichnet";
        none: "Nothing has been recorded yet. A WARNING, an ERROR, a request to the vehicle, an end of autonomous driving on the way, or a mark is recorded by itself, with what came before it.", "Noch ist nichts aufgezeichnet. Eine Warnung, ein Fehler, eine Anforderung an das Fahrzeug, ein Ende des autonomen Fahrens unterwegs oder eine Markierung wird von selbst aufgezeichnet, samt der Zeit davor.";
        off: "Nothing is recorded: the configuration has `recording: false`. Remove that and start Telltale again.", "Nichts wird aufgezeichnet: In der Konfiguration steht `recording: false`. Entfernen Sie das und starten Sie Telltale neu.";
        fault: "Nothing can be recorded", "Nichts kann aufgezeichnet werden";
        marked: "marked", "markiert";
        and: " and ", " und ";
        kept: "kept", "aufbewahrt";
        storm: "storm", "Störungsflut";
        interrupted: "interrupted", "unterbrochen";
        gone: "recording lost", "Aufzeichnung verloren";
        unfinished: "not completed", "nicht abgeschlossen";
        why: "Why", "Anlass";
        severity: "State", "Zustand";
        ended_on_the_way: "autonomous driving ended on the way", "das autonome Fahren endete unterwegs";
        note: "Note", "Notiz";
        what_happened: "What happened", "Was geschah";
        states: "States", "Zustände";
        numbers: "Numbers", "Zahlen";
        vehicle_speed: "Speed, km/h", "Geschwindigkeit, km/h";
        freeze: "Values at that instant", "Werte in diesem Augenblick";
        recording: "Recording", "Aufzeichnung";
        report: "Report", "Bericht";
        replay: "Replay", "Wiedergabe";
        what_if: "What if\u{2026}", "Was wäre, wenn\u{2026}";
        edited: "Edited configuration", "Bearbeitete Konfiguration";
        as_recorded: "As recorded", "Wie aufgezeichnet";
        as_edited: "By the edited configuration", "Mit der bearbeiteten Konfiguration";
        leave_replay: "Leave the replay", "Wiedergabe verlassen";
        last_minutes: "The last minutes", "Die letzten Minuten";
        back_to_now: "Back to now", "Zurück zu jetzt";
        remember: "Remember this moment", "Diesen Augenblick merken";
        differs_from: "What differs from", "Was anders ist als um";
        differences: "What differs", "Was anders ist";
        no_differences: "Nothing differs between the two moments.", "Zwischen den beiden Augenblicken ist nichts anders.";
        only_values: "Only values differ of further modules:", "Nur Werte unterscheiden sich bei weiteren Modulen:";
        node_or_fact: "What", "Was";
        leave_differences: "Back to the replay", "Zurück zur Wiedergabe";
        unknown_then: "not known", "nicht bekannt";
        fact_overall: "State of the vehicle", "Zustand des Fahrzeugs";
        fact_roots: "Root causes", "Ursachen";
        fact_requests: "Requests to the vehicle", "Anforderungen an das Fahrzeug";
        screens: "The screens as they were", "Die Bildschirme von damals";
        controls: "Play", "Abspielen";
        play: "Play", "Abspielen";
        pause: "Pause", "Anhalten";
        previous: "Previous change", "Vorige Änderung";
        next: "Next change", "Nächste Änderung";
        speed: "Speed", "Tempo";
        space_key: "Space", "Leertaste";
        link: "Link to this moment", "Link zu diesem Augenblick";
        damaged: "Damaged recording", "Beschädigte Aufzeichnung";
        has_gaps: "Recording with gaps", "Lückenhafte Aufzeichnung";
        unheard: "The configuration reads these topics, the recording has no message of them", "Die Konfiguration liest diese Topics, die Aufzeichnung hat keine Nachricht davon";
        missing_are: "missing", "es fehlt";
        to_the_end: "the end", "Ende";
        may_differ: "may differ from what was shown", "kann von damals abweichen";
        may_differ_after: "What is shown from there on may differ from what was shown then", "Was ab dort zu sehen ist, kann von dem abweichen, was damals zu sehen war";
        up_to: "up to", "bis";
        ends_at: "The recording does not hold the moment that was asked for. It ends here:", "Die Aufzeichnung hat den verlangten Augenblick nicht. Sie endet hier:";
        begins_at: "The recording does not hold the moment that was asked for. It begins here:", "Die Aufzeichnung hat den verlangten Augenblick nicht. Sie beginnt hier:";
        no_answer: "The server does not answer. What is shown stands still.", "Der Server antwortet nicht. Die Anzeige steht still.";
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
        numbers_pending: "The numbers are still being found. Make the report again in a moment to have them in it.", "Die Zahlen werden noch ermittelt. Erstellen Sie den Bericht gleich noch einmal, dann stehen sie darin.";
        only_known: "What follows is what the database knows.", "Was folgt, weiß die Datenbank.";
        not_shown: "not shown here: the recording has all of it", "hier nicht gezeigt: Die Aufzeichnung enthält alles";
        look_attributed: "Error that is owed to a cause", "Fehler als Folge einer Ursache";
        look_masked: "Ignored, because its cause is shown", "Ignoriert, weil die Ursache gezeigt ist";
        look_not_relevant: "Ignored, because it does not matter then", "Ignoriert, weil es dann nicht zählt";
        first_trigger: "First trigger", "Erster Anlass";
        look_own: "Line at the foot: what it says itself", "Linie am Fuß: was es selbst sagt";
        busy: "Other recordings are being read. Load the page again.", "Gerade werden andere Aufzeichnungen gelesen. Laden Sie die Seite neu.";
        nothing_told: "The recording tells no change.", "Die Aufzeichnung zeigt keine Änderung.";
        sizes_only: "times and sizes only", "nur Zeiten und Größen";
        no_topics: "The recording has no messages.", "Die Aufzeichnung enthält keine Nachrichten.";
        no_values: "Nothing had failed at the first trigger.", "Beim ersten Anlass war nichts ausgefallen.";
        version: "Telltale", "Telltale";
        configuration: "Configuration", "Konfiguration";
        root: "fault", "Störung";
        mark_now: "Mark this moment", "Diesen Moment markieren";
        report_of: "Incident report", "Vorfallbericht";
        vehicle: "Vehicle", "Fahrzeug";
        began: "Began", "Beginn";
        stage: "Stage", "Phase";
        causes: "Causes", "Ursachen";
        times: "All times are UTC.", "Alle Zeiten in UTC.";
        written: "Report written", "Bericht vom";
        verify: "How to verify the recording", "So wird die Aufzeichnung geprüft";
        verify_why: "This report was made from the recording and can be changed by anybody. What can be verified is the recording.", "Dieser Bericht ist aus der Aufzeichnung gemacht, und jeder kann ihn ändern. Geprüft werden kann die Aufzeichnung.";
        verify_file: "The recording was completed with this hash, which every copy of it must have.", "Die Aufzeichnung wurde mit diesem Hash abgeschlossen; jede Kopie muss ihn haben.";
        verify_vehicle: "On the vehicle's computer: compares the file with its hash in the database and in the audit log, and verifies the log. DIR is the data folder of Telltale.", "Auf dem Rechner des Fahrzeugs: vergleicht die Datei mit ihrem Hash in der Datenbank und im Protokoll und prüft das Protokoll. DIR ist der Datenordner von Telltale.";
        verify_chain: "Every record of the audit log carries a hash, made with the vehicle's key, of itself and of the record before it. A record that was changed, removed or inserted later breaks this chain, so the hash of this recording and the time of its record cannot be replaced unseen. Only somebody who can read and write the whole data folder with its key could forge all of it together; that shows against a head of the log that was noted elsewhere:", "Jeder Eintrag des Protokolls trägt einen Hash, gebildet mit dem Schlüssel des Fahrzeugs, über sich selbst und den Eintrag davor. Ein später geänderter, entfernter oder eingefügter Eintrag zerreißt diese Kette; so können der Hash dieser Aufzeichnung und die Zeit seines Eintrags nicht unbemerkt ersetzt werden. Nur wer den ganzen Datenordner mit seinem Schlüssel lesen und schreiben kann, könnte alles zusammen fälschen; das zeigt sich an einem Kopf des Protokolls, der anderswo notiert ist:";
        is_as_recorded: "The file on the vehicle still had it when this report was written.", "Die Datei auf dem Fahrzeug hatte ihn noch, als dieser Bericht geschrieben wurde.";
        is_other: "The recording is not as it was recorded: the file was changed, and what follows was read from it. Its hash is", "Die Aufzeichnung ist nicht, wie sie aufgezeichnet wurde: Die Datei wurde verändert, und was folgt, ist aus ihr gelesen. Ihr Hash ist";
        is_other_row: "What the database says of this incident was changed later: it is not what the audit log proves. The story is read from the recording; the other lines are from the database.", "Was die Datenbank über diesen Vorfall sagt, wurde später geändert: Das Protokoll belegt etwas anderes. Der Ablauf ist aus der Aufzeichnung gelesen, die übrigen Zeilen sind aus der Datenbank.";
        not_compared: "The file is too large to be compared with its hash here. `telltale incident verify` compares it.", "Die Datei ist zu groß, um sie hier mit ihrem Hash zu vergleichen. `telltale incident verify` vergleicht sie.";
        interrupted_at: "Telltale ended in the middle of this recording. From the first trigger it ends at", "Telltale endete mitten in dieser Aufzeichnung. Gerechnet vom ersten Auslöser endet sie bei";
        ends_before: "What was to be recorded from then on, the first trigger among it, is missing.", "Alles danach, auch der erste Auslöser, fehlt.";
        ends_after: "What came later is missing.", "Was danach kam, fehlt.";
        no_hash: "The recording was not completed, so it has no hash, and nothing proves it.", "Die Aufzeichnung wurde nicht abgeschlossen. Sie hat keinen Hash, und nichts beweist sie.";

        title: "What if: incident", "Was wäre, wenn: Vorfall";
        other_configuration: "Another configuration", "Eine andere Konfiguration";
        about: "Edit the configuration. The recording then runs by the recorded one and by yours. Nothing of this touches the vehicle.", "Ändern Sie die Konfiguration. Die Aufzeichnung läuft dann mit der aufgezeichneten und mit Ihrer. Nichts davon berührt das Fahrzeug.";
        by_click: "Change by a click", "Mit einem Klick ändern";
        by_click_about: "A click switches a dependency off or on, and a field changes a limit. Both write into the text.", "Ein Klick schaltet eine Abhängigkeit aus oder ein, ein Feld ändert eine Grenze. Beides schreibt in den Text.";
        depends_on: "depends on", "hängt ab von";
        switch_off: "Switch off or on", "Aus- oder einschalten";
        recorded_one: "Recorded text", "Aufgezeichneter Text";
        running_one: "Text in force", "Geltender Text";
        over_this: "this incident", "dieser Vorfall";
        over_all: "all kept incidents too", "auch alle aufbewahrten Vorfälle";
        run: "Run", "Durchspielen";
        waiting: "Waiting: another what-if is running.", "Wartet: Ein anderes Was-wäre-wenn läuft noch.";
        running: "Running", "Läuft";
        again: "Load again", "Neu laden";
        wrong: "The configuration has mistakes. Nothing was run.", "Die Konfiguration hat Fehler. Nichts wurde durchgespielt.";
        nothing_differs: "Nothing differs: states, causes, phases, alarms, countermeasures and the urgency of the instruction are the same at every instant.", "Kein Unterschied: Zustände, Ursachen, Phasen, Alarme, Gegenmaßnahmen und die Dringlichkeit der Anweisung sind in jedem Augenblick gleich.";
        differs: "What would have been different", "Was anders gewesen wäre";
        means: "What both configurations mean differently", "Was beide Konfigurationen verschieden meinen";
        means_same: "Both configurations mean the same.", "Beide Konfigurationen bedeuten dasselbe.";
        first: "First difference", "Erster Unterschied";
        same: "no difference", "kein Unterschied";
        recorded: "Recorded", "Aufgezeichnet";
        new: "New", "Neu";
        alarms: "Alarms", "Alarme";
        masked: "Masked nodes", "Maskierte Knoten";
        requests: "Requests to the vehicle", "Anforderungen ans Fahrzeug";
        instruction: "Urgency of the instruction", "Dringlichkeit der Anweisung";
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
        replay_there: "Replay from there", "Wiedergabe ab dort";
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

    /// A kind of trigger.
    known trigger(kind: &str) {
        "root" => "fault", "Störung";
        "own_error" => "hidden fault", "verdeckte Störung";
        "lost_active" => "autonomous driving ended", "autonomes Fahren endete";
        "countermeasure" => "request to the vehicle", "Anforderung an das Fahrzeug";
        "mark" => "mark", "Markierung";
    }

    /// One sentence for what happened, of the node or person `name` and of `other`.
    text happened(what: &Happened; name: &str, other: &str) {
        Happened::Fails { .. } => "{name}: {other}", "{name}: {other}";
        Happened::FailsBehind { .. } => "{name}: {other}, hidden by its cause", "{name}: {other}, verdeckt von der Ursache";
        Happened::Masks { .. } => "{name} hides: {other}", "{name} verdeckt: {other}";
        Happened::Recovers { .. } => "OK again: {other}", "Wieder OK: {other}";
        Happened::AlarmMoves { .. } => "{other} was a symptom: the cause is {name}", "{other} war eine Folge: Die Ursache ist {name}";
        Happened::Stage { .. } => "The vehicle: {other}", "Das Fahrzeug: {other}";
        Happened::Signal { .. } => "Signal {name}: {other}", "Signal {name}: {other}";
        Happened::LostActive { .. } => "Autonomous driving ended while the vehicle was not known to stand", "Autonomes Fahren endete, ohne dass das Fahrzeug sicher stand";
        Happened::Request { .. } => "The vehicle is asked to {other}", "Das Fahrzeug soll {other}";
        Happened::Mark { .. } => "Marked by {name}{other}", "Markiert von {name}{other}";
        Happened::Operator { action: "shelve" | "unshelve", .. } => "A developer {other} {name}", "Entwicklung: {other} {name}";
        Happened::Operator { .. } => "The operator {other} {name}", "Fahrbegleitung: {other} {name}";
        Happened::Refused { .. } => "The operator {name} {other}", "Fahrbegleitung {name}: {other}";
        Happened::ClockSet { by_ms: ..0 } => "The clock was set back by {other}, which the times here do not follow", "Die Uhr wurde um {other} zurückgestellt; die Zeiten hier laufen gleichmäßig weiter";
        Happened::ClockSet { .. } => "The clock was set forward by {other}, which the times here do not follow", "Die Uhr wurde um {other} vorgestellt; die Zeiten hier laufen gleichmäßig weiter";
        Happened::Reload => "The configuration was replaced", "Die Konfiguration wurde ersetzt";
        Happened::Lost { count } => "{count} changes before this are missing", "{count} Änderungen davor fehlen";
        Happened::Interrupted => "The recording ends here, because Telltale ended. What came later is not in it", "Hier endet die Aufzeichnung, weil Telltale endete. Was danach kam, steht nicht darin";
    }

    /// A fault with an estimated beginning, and the time until its notice.
    text noticed_later(fault: &str, later: &str) {
        "{fault}; noticed {later} later", "{fault}; {later} später bemerkt"
    }

    /// An action of the operator, done or refused.
    known deed(action: &str) {
        "login" => "logs in:", "Anmeldung:";
        "logout" => "logs out", "Abmeldung";
        "shutdown" => "ends the work", "Dienstende";
        "localize" => "says where the vehicle is", "Positionsangabe";
        "clearance" => "presses: give clearance", "drückt: Freigabe";
        "stop" => "presses STOP", "drückt STOP";
        "withdraw" => "withdraws the clearance", "widerruft die Freigabe";
        "release" => "presses: continue driving", "drückt: Weiterfahrt";
        "acknowledge" => "acknowledges", "quittiert";
        "reset" => "resets", "setzt zurück:";
        "shelve" => "shelves", "in Wartung:";
        "unshelve" => "ends the maintenance of", "Wartung beendet:";
    }

    text refused_deed(deed: &str, why: &str) { "{deed}. Refused: {why}", "{deed}. Abgelehnt: {why}" }

    /// The request to the vehicle.
    known asked_to(request: &str) {
        "decelerate" => "slow down", "abbremsen";
        "maneuver_stop" => "stop safely", "sicher anhalten";
    }

    /// The request of a countermeasure to the vehicle.
    text was_asked_to(what: &str) { "the vehicle was asked to {what}", "das Fahrzeug sollte {what}" }

    text marked_by(who: &str) { "marked by {who}", "markiert von {who}" }

    /// The messages that the recording lacks because it had reached its size.
    text no_room(count: u64, bytes: &str) {
        "There was no room for {count} messages ({bytes}), most of them of large topics: the recording has only their times and sizes. `recording.disk` and the disk bound it.",
        "Für {count} Nachrichten ({bytes}), die meisten von großen Topics, war kein Platz: Die Aufzeichnung enthält nur ihre Zeiten und Größen. `recording.disk` und die Platte begrenzen sie."
    }

    /// The size of the recordings, beside their share of the disk.
    text on_disk(disk: Option<&str>; count: u64, all: &str) {
        Some(disk) => "{count} recorded: {all} of {disk} on the disk.", "{count} aufgezeichnet: {all} von {disk} auf der Platte.";
        None => "{count} recorded: {all} on the disk.", "{count} aufgezeichnet: {all} auf der Platte.";
    }

    /// How long their share of the disk lasts if every day is as this one.
    text disk_lasts(days: Option<u64>, keep_days: u64; today: &str) {
        None, _ => "Nothing in the last 24 hours.", "Nichts in den letzten 24 Stunden.";
        Some(0), _ => "{today} in the last 24 hours: at this rate the oldest go within a day.", "{today} in den letzten 24 Stunden: So gehen die ältesten binnen eines Tages.";
        Some(days), _ if days >= keep_days => "{today} in the last 24 hours: at this rate there is room for all {keep_days} days that recordings are kept.", "{today} in den letzten 24 Stunden: So reicht der Platz für alle {keep_days} Tage, die Aufzeichnungen bleiben.";
        Some(days), _ => "{today} in the last 24 hours: at this rate there is room for {days} more days.", "{today} in den letzten 24 Stunden: So reicht der Platz für weitere {days} Tage.";
    }
}
