//! The texts of the developer's pages.

use telltale_engine::view::why::WhyStep;

texts! {
    words DevWords {
        statuses: "Statuses", "Status";
        graph: "Graph", "Graph";
        learned: "Learned dependencies", "Gelernte Abhängigkeiten";
        timeline: "Timeline", "Zeitverlauf";
        incidents: "Incidents", "Vorfälle";
        masking: "Masking", "Maskierung";
        coverage: "Coverage", "Abdeckung";
        topics: "Topics", "Topics";
        configuration: "Configuration", "Konfiguration";
        audit: "Audit log", "Protokoll";
        statistics: "Statistics", "Statistik";
        node: "Node", "Knoten";
        recorded_time: "Recorded", "Aufgezeichnet";
        alarms: "Alarms", "Alarme";
        alarms_an_hour: "an hour", "je Stunde";
        alarms_per_hour: "Alarms an hour", "Alarme je Stunde";
        one_day: "1 day", "1 Tag";
        seven_days: "7 days", "7 Tage";
        thirty_days: "30 days", "30 Tage";
        one_year: "1 year", "1 Jahr";
        most_in_10_min: "Most alarms in 10 min", "Meiste Alarme in 10 min";
        to_acknowledge: "Half were acknowledged within", "Zur Hälfte quittiert nach";
        on_100_km: "on 100 km", "auf 100 km";
        between_failures: "time between failures", "Zeit zwischen Ausfällen";
        driven: "Driven", "Gefahren";
        versions: "By version of Telltale", "Nach Version von Telltale";
        version: "Version", "Version";
        version_unknown: "not known", "nicht bekannt";
        in_all: "in all", "insgesamt";
        longest: "longest", "längster";
        chatters: "chatters", "flattert";
        no_alarm: "No alarm in this time.", "Kein Alarm in dieser Zeit.";
        nothing_recorded: "Nothing is recorded in this time.", "In dieser Zeit ist nichts aufgezeichnet.";
        shelved: "Shelved", "In Wartung";
        drawn_with: "Compare with", "Vergleichen mit";
        own_scale: "own scale", "eigene Skala";
        shelve: "Shelve", "In Wartung nehmen";
        shelve_about: "Its faults raise no alarm for so long, while the vehicle stands. All else stays as it is.", "So lange lösen seine Fehler keinen Alarm aus, solange das Fahrzeug steht. Alles andere bleibt, wie es ist.";
        shelve_for: "for", "für";
        unshelve: "End the maintenance", "Wartung beenden";
        api: "Interface for programs", "Schnittstelle für Programme";
        api_get: "The whole description as OpenAPI:", "Die ganze Beschreibung als OpenAPI:";
        api_schemas: "JSON Schemas:", "JSON-Schemas:";
        api_parameter: "Parameter", "Parameter";
        api_values: "Values", "Werte";
        api_needed: "needed", "nötig";
        api_answer: "Answer", "Antwort";
        pages: "Pages", "Seiten";

        locked: "Locked: no diagnosis is shown before an operator logs in.", "Gesperrt: Keine Diagnose, bevor sich jemand anmeldet.";
        late: "Delayed: what stands here may be old.", "Verzögert: Was hier steht, kann veraltet sein.";
        dead: "Not live: the server does not answer. What stands here is old.", "Nicht live: Der Server antwortet nicht. Was hier steht, ist veraltet.";
        stage: "Stage", "Phase";
        vehicle_page: "Vehicle", "Fahrzeug";
        help: "Keys", "Tasten";
        close: "Close", "Schließen";
        copy: "Copy", "Kopieren";
        copied: "Copied", "Kopiert";
        not_copied: "Not copied", "Nicht kopiert";
        search: "Search", "Suchen";
        search_hint: "Id, title, status, message, topic, node, incident", "Id, Titel, Status, Meldung, Topic, Knoten, Vorfall";
        search_how: "opens the first one", "öffnet das erste";
        found_none: "Nothing has such a name or says that.", "Nichts heißt so oder sagt das.";
        found_all: "all", "alle";
        groups_and_modules: "Groups and modules", "Gruppen und Module";
        help_search: "search everywhere", "überall suchen";
        help_filter: "to the filter", "zum Filter";
        help_move: "next, previous row", "nächste, vorige Zeile";
        help_open: "open the row", "Zeile öffnen";
        help_pin: "pin the row", "Zeile anheften";
        help_zoom: "larger, smaller, as it was", "größer, kleiner, wie zuvor";
        help_turn: "next, previous page; later, earlier", "nächste, vorige Seite; später, früher";
        help_moment: "the moment on the timeline, finer with Shift", "der Zeitpunkt im Zeitverlauf, feiner mit Umschalt";
        help_help: "this help", "diese Hilfe";
        help_leave: "leave a field, close", "Feld verlassen, schließen";

        filter: "Filter", "Filter";
        filter_hint: "Name, message, value", "Name, Meldung, Wert";
        group: "Group", "Gruppe";
        all_groups: "All groups", "Alle Gruppen";
        all_states: "All states", "Alle Zustände";
        abnormal: "Not OK", "Nicht OK";
        apply: "Apply", "Anwenden";
        shown: "Shown", "Gezeigt";
        own: "Own", "Selbst";
        module: "Module", "Modul";
        since: "Since", "Seit";
        began: "began about", "begann etwa";
        age: "Age", "Alter";
        message: "Message", "Meldung";
        values: "Values", "Werte";
        never: "never", "nie";
        silent: "silent", "stumm";
        pin: "Pin", "Anheften";
        unpin: "Unpin", "Lösen";
        pinned: "Pinned", "Angeheftet";
        nothing_matches: "Nothing matches the filter.", "Nichts passt zum Filter.";
        previous: "Previous", "Zurück";
        next: "Next", "Weiter";
        of: "of", "von";
        reception: "Reception troubles", "Störungen des Empfangs";
        reception_none: "None since the start.", "Keine seit dem Start.";
        counters: "Counters", "Zähler";
        signals: "Signals", "Signale";
        signal: "Signal", "Signal";
        topic: "Topic", "Topic";
        kind: "Kind", "Art";
        count: "Count", "Anzahl";
        last: "Last", "Zuletzt";
        text: "Text", "Text";
        malformed: "malformed", "fehlerhaft";
        wrong_type: "wrong type", "falscher Typ";
        lost: "lost", "verloren";
        arrays: "arrays", "Arrays";
        received: "statuses", "Status";
        dropped: "dropped names", "verworfene Namen";
        shortened: "shortened statuses", "gekürzte Status";
        merged_alarms: "repeated alarms", "wiederholte Alarme";
        dropped_alarms: "dropped alarms", "verworfene Alarme";
        unknown_signals: "unknown signals", "unbekannte Signale";
        samples: "watched messages", "beobachtete Nachrichten";
        dropped_samples: "of another configuration", "einer anderen Konfiguration";

        why: "Why", "Warum";
        minutes: "Last 5 minutes", "Letzte 5 Minuten";
        members: "Members", "Teile";

        hidden: "Hidden", "Verborgen";
        hidden_by: "By", "Durch";
        masked: "Masked: what they need fails", "Maskiert: Was sie brauchen, fällt aus";
        not_relevant: "Not relevant now", "Zurzeit nicht wichtig";
        own_report: "Says itself", "Sagt selbst";
        because: "Because", "Weil";
        nothing_masked: "Nothing is masked now.", "Zurzeit ist nichts maskiert.";
        nothing_irrelevant: "Everything matters now.", "Zurzeit ist alles wichtig.";
        behind: "with an error of their own", "mit eigenem Fehler";

        isolated: "Isolated", "Isoliert";
        contextual: "Contextual", "Kontextuell";
        content: "Content", "Inhalt";
        meta: "Meta", "Meta";
        sequential: "sequential", "sequenziell";
        parallel: "parallel", "parallel";
        unstated: "no such class", "keine Klasse";
        components: "Components", "Komponenten";
        data_streams: "Data streams", "Datenströme";
        sum: "All", "Alle";
        no_modules: "none", "keine";
        coverage_text: "How many modules diagnose each group in which way, and below with which techniques: of components or of data streams. A way that nobody takes is hatched.", "Wie viele Module jede Gruppe auf welche Weise diagnostizieren, und darunter mit welchen Verfahren: für Komponenten oder für Datenströme. Was niemand abdeckt, ist schraffiert.";

        zoom_in: "Larger", "Größer";
        zoom_out: "Smaller", "Kleiner";
        zoom_none: "The span of the beginning", "Die Spanne des Anfangs";
        zoom_whole: "Whole", "Ganz";
        open_all: "Open all", "Alle öffnen";
        close_all: "Close all", "Alle schließen";
        legend_edge: "leads from what fails to what it masks", "führt von dem, was ausfällt, zu dem, was es maskiert";
        legend_any: "only if every member of the set fails", "nur wenn alle der Menge ausfallen";
        legend_hot: "path from a root cause", "Weg von einer Ursache";
        graph_of: "Dependencies of groups and modules", "Abhängigkeiten der Gruppen und Module";
        more_groups: "Groups that are not drawn", "Gruppen, die nicht gezeichnet sind";

        span: "Span", "Spanne";
        until: "Until", "Bis";
        live_now: "Live", "Live";
        earlier: "Earlier", "Früher";
        later: "Later", "Später";
        moment: "Moment", "Zeitpunkt";
        add_node: "Add a node", "Knoten hinzufügen";
        add: "Add", "Hinzufügen";
        remove: "Remove", "Entfernen";
        time: "Time", "Zeit";
        event: "Event", "Ereignis";
        event_of: "Of what", "Wovon";
        events: "What happened", "Was geschah";
        no_events: "Nothing happened in this span.", "In dieser Spanne geschah nichts.";
        no_record: "no record", "nicht aufgezeichnet";
        from_recording: "Before the instant that is shown.", "Vor dem gezeigten Augenblick.";
        shown_instant: "Up to the shown instant", "Bis zum gezeigten Augenblick";
        from_history: "From history: this is not the present.", "Aus dem Verlauf: Das ist nicht die Gegenwart.";
        outside: "not shown", "nicht im Bild";
        to_moment: "Show the moment", "Zum Zeitpunkt";
        pages_then: "The other pages show this moment.", "Die anderen Seiten zeigen diesen Moment.";
        nowhere: "Nothing holds this moment: no recording has it, and neither has the history.", "Nichts kennt diesen Moment: keine Aufzeichnung, und auch der Verlauf nicht.";
        unrecorded: "No recording has this moment. The history knows states and alarms, no values or messages.", "Keine Aufzeichnung hat diesen Moment. Der Verlauf kennt Zustände und Alarme, keine Werte oder Nachrichten.";
        show_moment: "Every page at this moment", "Alle Seiten in diesem Moment";
        no_history: "The history cannot be read now; the log says why. States and alarms work without it.", "Der Verlauf ist zurzeit nicht lesbar; das Protokoll sagt warum. Zustände und Alarme kommen ohne ihn aus.";
        history_lost: "transitions were lost because the disk was too slow", "Wechsel gingen verloren, weil der Speicher zu langsam war";
        cut: "There is more than can be drawn: choose a shorter span.", "Es gibt mehr, als gezeichnet werden kann: kürzere Spanne wählen.";
        ev_stage: "stage", "Phase";
        ev_signal: "signal", "Signal";
        ev_raised: "alarm raised", "Alarm ausgelöst";
        ev_moved: "alarm moved to its cause", "Alarm zur Ursache gewandert";
        ev_acknowledged: "alarm acknowledged", "Alarm quittiert";
        ev_cleared: "alarm cleared", "Alarm beendet";
        ev_left: "silent for too long, forgotten", "zu lange still, vergessen";
        ev_reloaded: "configuration replaced", "Konfiguration ersetzt";
        ev_started: "Telltale started", "Telltale gestartet";
        cause: "Cause", "Ursache";
        attributed: "owed to the cause", "Folge der Ursache";

        topic_type: "Type", "Typ";
        publishers: "Publishers", "Publisher";
        subscribers: "Subscribers", "Subscriber";
        rate: "Rate", "Rate";
        rate_title: "Over the last 5 s, or as many more as hold ten messages", "Über die letzten 5 s, oder so viele mehr, bis es zehn Nachrichten sind";
        wanted: "Wanted", "Soll";
        wanted_title: "What the frequency monitors allow", "Was die Monitore der Frequenz zulassen";
        jitter: "Jitter", "Jitter";
        jitter_title: "Standard deviation of the time from one message to the next, as they arrived", "Standardabweichung der Zeit von einer Nachricht zur nächsten, wie sie ankamen";
        too_slow: "too slow", "zu langsam";
        too_fast: "too fast", "zu schnell";
        monitors: "Monitors", "Monitore";
        add_monitor: "Add a monitor", "Monitor hinzufügen";
        draft_of_rate: "For the modules of a group. A WARNING below 70 % of the rate, an ERROR below 40 %: set them to what the component needs.", "Für die Module einer Gruppe. WARNUNG unter 70 % der Rate, FEHLER unter 40 %: Tragen Sie ein, was die Komponente braucht.";
        draft_of_unread: "For the modules of a group. Telltale does not read this topic yet, so its rate is not known. This monitor is in ERROR when nothing comes for 10 s. Once it runs, this page shows the rate and limits that fit.", "Für die Module einer Gruppe. Telltale liest dieses Topic noch nicht, seine Rate ist also nicht bekannt. Dieser Monitor meldet FEHLER, wenn 10 s lang nichts kommt. Sobald er läuft, zeigt diese Seite die Rate und passende Grenzen.";
        draft_of_kept: "Its publishers keep the last message for those that come later: it is sent when it changes, and has no rate.", "Seine Publisher behalten die letzte Nachricht für alle, die später kommen: Sie kommt, wenn sich etwas ändert, und hat keine Rate.";
        mismatch_type: "Types differ", "Typen verschieden";
        mismatch_reliability: "Reliability asked for, not offered", "Zuverlässigkeit verlangt, nicht geboten";
        mismatch_durability: "Last value asked for, not kept", "Letzter Wert verlangt, nicht behalten";
        mismatch_deadline: "Deadline asked for, not offered", "Frist verlangt, nicht geboten";
        mismatch_liveliness: "Liveliness asked for, not offered", "Lebenszeichen verlangt, nicht geboten";
        held: "Recorder", "Rekorder";
        held_title: "What the memory for recordings holds. A recording needs", "Was der Speicher für Aufzeichnungen hält. Eine Aufzeichnung braucht";
        sizes_only: "times and sizes only", "nur Zeiten und Größen";
        made_room: "made room for newer ones: raise `recording.memory`", "wichen neueren: `recording.memory` erhöhen";
        published_twice: "Published by another too", "Auch von anderen veröffentlicht";
        nodes: "ROS nodes", "ROS-Knoten";
        participants: "Other participants", "Andere Teilnehmer";
        topics_then: "Up to the instant that is shown. A recording holds messages: who published and subscribed then is not known.", "Bis zum gezeigten Augenblick. Eine Aufzeichnung enthält Nachrichten: Wer dann veröffentlicht und abonniert hat, ist nicht bekannt.";
        rate_over: "Over the last 5 s", "Über die letzten 5 s";
        messages: "Messages", "Nachrichten";
        last_message: "Last message", "Letzte Nachricht";
        before_then: "before", "zuvor";
        none_yet: "no message yet", "noch keine Nachricht";
        no_topics: "Discovery has seen nothing yet.", "Die Erkennung hat noch nichts gesehen.";

        config_same: "The file means the same as what runs.", "Die Datei bedeutet dasselbe wie das, was läuft.";
        config_differs: "The file differs from what runs", "Die Datei weicht von dem ab, was läuft";
        config_taken: "The file was taken. This has changed", "Die Datei wurde übernommen. Das hat sich geändert";
        config_other: "Not taken: the files are no longer what was shown before. This is what they are now.", "Nicht übernommen: Die Dateien sind nicht mehr, was zuvor gezeigt wurde. Das sind sie jetzt.";
        config_refused: "The file cannot be used; what runs stays", "Die Datei ist unbrauchbar; was läuft, bleibt";
        config_warnings: "What can happen with it and should not", "Was damit geschehen kann und nicht sollte";
        config_take: "Take it", "Übernehmen";
        config_judging: "Every situation is being looked at ...", "Jede Situation wird betrachtet ...";
        config_sound: "Every situation was looked at: nothing can happen that should not.", "Jede Situation wurde betrachtet: Nichts kann geschehen, das nicht sollte.";
        config_running: "What runs, as it was read", "Was läuft, wie es gelesen wurde";

        past: "States over time", "Zustände über die Zeit";
        numbers_none: "No number of this module has a past yet.", "Noch keine Zahl dieses Moduls hat eine Vergangenheit.";
        numbers_kept: "Numbers are kept every two seconds for five minutes.", "Zahlen bleiben fünf Minuten lang alle zwei Sekunden.";
        numbers_minutes: "Drawn is the mean of each minute, within its least and greatest number.", "Gezeichnet ist das Mittel jeder Minute zwischen ihrer kleinsten und größten Zahl.";
        numbers_hours: "Drawn is the mean of each hour, within its least and greatest number.", "Gezeichnet ist das Mittel jeder Stunde zwischen ihrer kleinsten und größten Zahl.";
        minutes_since: "Minutes are kept since", "Minuten gibt es seit";
        hours_since: "hours since", "Stunden seit";
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
        incidents_caused: "Incidents that it caused", "Vorfälle, die es verursachte";
        incidents_none: "No incident had it as a root cause.", "Bei keinem Vorfall war es die Ursache.";
        incidents_all: "all", "alle";
        monitor: "Monitor", "Monitor";
        class: "Class", "Klasse";
        status: "Status", "Status";
        hardware: "Hardware", "Hardware";
        log_number: "No.", "Nr.";
        log_who: "Who", "Wer";
        log_from: "From", "Woher";
        log_what: "What", "Was";
        log_on: "On what", "Woran";
        log_outcome: "Outcome", "Ergebnis";
        log_older: "Older records", "Ältere Einträge";
    }

    /// One step of the explanation of a state, about `what`.
    text why_step(step: &WhyStep; what: &str) {
        WhyStep::OnlyFrom(_) => "It counts only from {what}.", "Es zählt nur von {what}.";
        WhyStep::NeverReported => "It has never reported.", "Es hat sich nie gemeldet.";
        WhyStep::Reported(_) => "It reports: {what}", "Es meldet: {what}";
        WhyStep::Silent(_) => "Nothing came for its timeout; it counts as: {what}", "Nichts kam innerhalb der Frist; es gilt als: {what}";
        WhyStep::Debounced(_) => "The change is too fresh; it still counts as: {what}", "Der Wechsel ist zu frisch; es gilt noch als: {what}";
        WhyStep::Latched => "An error is held until it is reset.", "Ein Fehler wird bis zum Zurücksetzen festgehalten.";
        WhyStep::Grace => "It is given time to report.", "Es hat noch Zeit, sich zu melden.";
        WhyStep::Members { .. } => "Its members make it, by themselves, {what}", "Seine Teile ergeben, für sich genommen, {what}";
        WhyStep::NotRelevant(_) => "It does not matter now: {what}", "Es ist jetzt nicht wichtig: {what}";
        WhyStep::Waits { .. } => "{what} needs what fails or waits itself", "{what} braucht, was ausfällt oder selbst wartet";
        WhyStep::Masked { .. } => "It is put aside because of", "Es wird zurückgestellt wegen";
        WhyStep::SecondFault => "A fault of its own: none of these began near it.", "Eine eigene Störung: Keine davon begann zur gleichen Zeit.";
        WhyStep::Shown(_) => "It shows: {what}", "Es zeigt: {what}";
    }

    /// A number that is to be drawn is not there.
    text no_number(name: &str) {
        "There is no module with a number called {name}.", "Es gibt kein Modul mit einer Zahl namens {name}."
    }

    /// A number that is to be drawn, or the one that it is to be drawn with, is not known in this span.
    text nothing_drawn(name: &str) {
        "{name} is not drawn: there are no numbers in this span.", "{name} ist nicht gezeichnet: In dieser Spanne fehlen Zahlen."
    }

    /// A word of the audit log.
    known of_audit(written: &str) {
        "operator" => "operator", "Fahrbegleitung";
        "developer" => "developer", "Entwicklung";
        "control_room" => "control_room", "Leitstelle";
        "engineer" => "engineer", "Flottentechnik";
        "authority" => "authority", "Aufsicht";
        "command line" => "command line", "Kommandozeile";
        "locked" => "locked", "gesperrt";
        "localizing" => "localizing", "Lokalisierung";
        "standby" => "standby", "Bereitschaft";
        "cleared" => "cleared", "freigegeben";
        "active" => "active", "autonom";
        "done" => "done", "ausgeführt";
        "start" => "start", "Start";
        "end" => "end", "Ende";
        "login" => "login", "Anmeldung";
        "logout" => "logout", "Abmeldung";
        "session ended" => "session ended", "Sitzung beendet";
        "hand-over" => "hand-over", "Ablösung";
        "request" => "request", "Anfrage";
        "localize" => "localize", "Positionsangabe";
        "clearance asked" => "clearance asked", "Freigabe angefragt";
        "clearance" => "clearance", "Freigabe";
        "clearance withdrawn" => "clearance withdrawn", "Freigabe widerrufen";
        "release asked" => "release asked", "Weiterfahrt angefragt";
        "release" => "release", "Weiterfahrt";
        "stop" => "stop", "Anhalten";
        "acknowledge" => "acknowledge", "Quittierung";
        "acknowledge over" => "acknowledge over", "Quittierung aller behobenen";
        "reset" => "reset", "Zurücksetzen";
        "shelved" => "shelved", "in Wartung genommen";
        "shelving ended" => "shelving ended", "Wartung beendet";
        "stage" => "stage", "Phase";
        "countermeasure" => "countermeasure", "Gegenmaßnahme";
        "configuration" => "configuration", "Konfiguration";
        "demo fault" => "demo fault", "Demo-Fehler";
        "session elsewhere" => "session elsewhere", "Sitzung von anderer Adresse";
        "user added" => "user added", "Benutzer angelegt";
        "user secret" => "user secret", "Zugangsgeheimnis geändert";
        "user role" => "user role", "Rolle geändert";
        "user removed" => "user removed", "Benutzer entfernt";
        "user kept" => "user kept", "Benutzer übernommen";
        "foreign users" => "foreign users", "Fremde Benutzer gefunden";
        "token added" => "token added", "Token angelegt";
        "token revoked" => "token revoked", "Token entzogen";
        "token kept" => "token kept", "Token übernommen";
        "mark" => "mark", "Markierung";
        "incident recorded" => "incident recorded", "Vorfall aufgezeichnet";
        "incident found" => "incident found", "Vorfall wiedergefunden";
        "incident note" => "incident note", "Notiz zu einem Vorfall";
        "incident kept" => "incident kept", "Vorfall aufbewahrt";
        "incident removed" => "incident removed", "Vorfall entfernt";
        "recording asked for" => "recording asked for", "Aufzeichnung angefordert";
        "recording stored" => "recording stored", "Aufzeichnung abgelegt";
        "recording exported" => "recording exported", "Aufzeichnung heruntergeladen";
        "what-if started" => "what-if started", "Was-wäre-wenn gestartet";
        "what-if cancelled" => "what-if cancelled", "Was-wäre-wenn abgebrochen";
        "omitted" => "omitted", "ausgelassen";
        "pruned" => "pruned", "Älteste entfernt";
        "breach acknowledged" => "breach acknowledged", "Bruch zur Kenntnis genommen";
        "chain broken" => "chain broken", "Kette beschädigt";
        "data repaired" => "data repaired", "Datenbank repariert";
        "data restored" => "data restored", "Sicherung eingespielt";
        "head missing" => "head missing", "Kettenende fehlt";
        "decelerate" => "decelerate", "Abbremsen";
        "maneuver_stop" => "maneuver_stop", "Sicher anhalten";
        "notify" => "notify", "Melden";
        "requested" => "requested", "verlangt";
        "engaged" => "engaged", "wirkt";
        "unconfirmed" => "unconfirmed", "unbestätigt";
        "ended" => "ended", "beendet";
        "the operator" => "the operator", "Fahrbegleitung";
    }

    text because_of(names: &str) { ", because of {names}", ", wegen {names}" }

    text refused_because(why: &str) { "refused: {why}", "abgelehnt: {why}" }

    text whole_chain(records: u64) {
        1 => "The one record is as it was written.", "Der eine Eintrag ist unverändert.";
        _ => "All {records} records are as they were written.", "Alle {records} Einträge sind unverändert.";
    }

    text broken_chain(number: u64, what: &str) { "Record {number} {what}.", "Die Kette ist beschädigt. Eintrag {number}: {what}." }

    text more_breaches(more: u64) { " There are {more} more such places.", " Es gibt {more} weitere solche Stellen." }

    text acknowledged_breaches(by: &str, count: u64, number: u64) {
        " {by} has acknowledged {count} earlier ones, in record {number}.", " {by} hat {count} frühere zur Kenntnis genommen, in Eintrag {number}."
    }
}
