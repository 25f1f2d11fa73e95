//! The texts of a fleet's console.

texts! {
    words ConsoleWords {
        title: "Fleet", "Flotte";
        password: "Password", "Passwort";
        no_users: "No user exists yet. Where the console runs: telltale user add NAME --role control_room --data DIR", "Noch kein Benutzer. Wo die Konsole läuft: telltale user add NAME --role control_room --data DIR";
        login_wrong: "Name or password is wrong.", "Name oder Passwort ist falsch.";
        login_wait: "Too many tries. Wait a moment.", "Zu viele Versuche. Kurz warten.";
        login_role: "This user is one of a vehicle. Log in there.", "Dieser Benutzer gehört zu einem Fahrzeug. Dort anmelden.";
        login_unavailable: "Logins cannot be checked now. Try again.", "Anmeldung zurzeit nicht prüfbar. Noch einmal versuchen.";
        issuer_away: "The login service does not answer. Try again, or log in with a password.", "Der Anmeldedienst antwortet nicht. Noch einmal versuchen oder mit Passwort anmelden.";
        issuer_unbelieved: "The answer of the login service is not valid. Try again; the console's log says more.", "Die Antwort des Anmeldedienstes ist nicht gültig. Noch einmal versuchen; das Protokoll der Konsole sagt mehr.";
        login_stale: "This login is over, or was begun in another browser. Begin again.", "Diese Anmeldung ist vorbei oder begann in einem anderen Browser. Noch einmal beginnen.";
        logged_in: "Logged in", "Angemeldet";
        to_the_fleet: "To the fleet", "Zur Flotte";

        lost_contact: "Lost contact", "Kontakt verloren";
        never_heard: "Never heard", "Nie gehört";
        late: "Late", "Verspätet";
        link_lost: "Link lost", "Verbindung weg";
        hub_down: "Hub down", "Zentrale weg";
        vehicle_off: "Vehicle off", "Fahrzeug aus";
        telltale_ended: "Telltale ended", "Telltale beendet";
        drove: "while driving", "in Fahrt";
        last: "last:", "zuletzt:";
        no_vehicles: "No vehicle was heard yet.", "Noch kein Fahrzeug gehört.";
        hub_text: "The hub is not reached. The states below are old.", "Die Zentrale ist nicht erreichbar. Die Zustände unten sind alt.";
        console_text: "The console does not answer. Nothing on this page is live.", "Die Konsole antwortet nicht. Nichts auf dieser Seite ist aktuell.";
        two_vehicles: "Two vehicles tell by this name", "Zwei Fahrzeuge melden sich unter diesem Namen";
        unacknowledged: "unacknowledged", "unquittiert";
        state: "State", "Zustand";
        vehicle: "Vehicle", "Fahrzeug";
        cause: "Cause", "Ursache";
        since: "Since", "Seit";
        motion: "Stage", "Stufe";
        age: "Data", "Daten";
        version: "Version", "Version";
        search: "Search vehicle, cause, version", "Fahrzeug, Ursache, Version suchen";
        all_vehicles: "All vehicles", "Alle Fahrzeuge";
        by_cause: "By cause", "Nach Ursache";
        worst: "The ten worst", "Die zehn dringendsten";
        only: "only", "nur";
        back: "Back to the fleet", "Zurück zur Flotte";

        faults: "Faults", "Störungen";
        no_faults: "Nothing is wrong", "Keine Störung";
        seen: "acknowledged", "quittiert";
        acknowledged: "Acknowledged", "Quittiert";
        components: "Components", "Komponenten";
        no_components: "The hub has no states of this vehicle.", "Die Zentrale hat keine Zustände dieses Fahrzeugs.";
        not_whole: "Messages are missing, so some states below may be older. The next full picture comes within ten minutes.", "Es fehlen Nachrichten, daher können einige Zustände unten älter sein. Das nächste vollständige Bild kommt binnen zehn Minuten.";

        no_keyframe: "The hub has no full picture of this vehicle from this time before the moment. Choose a longer time at the log, or another moment.", "Die Zentrale hat aus dieser Zeit vor dem Augenblick kein vollständiges Bild dieses Fahrzeugs. Beim Verlauf einen längeren Zeitraum wählen oder einen anderen Augenblick.";
        not_proven: "Messages about this moment are missing. These states were told before it, and may have been others by then.", "Zu diesem Augenblick fehlen Nachrichten. Diese Zustände wurden davor gemeldet und können inzwischen andere gewesen sein.";
        until_moment: "until this moment", "bis zu diesem Augenblick";

        incidents: "Incidents", "Vorfälle";
        no_incidents: "The vehicle told of none.", "Das Fahrzeug hat keine gemeldet.";
        lasts: "lasts", "dauert an";
        fetch: "Fetch recording", "Aufzeichnung holen";
        replay: "Replay", "Wiedergabe";
        download: "Download recording", "Aufzeichnung herunterladen";
        asked_for: "Asked for; the vehicle has not answered yet.", "Angefordert; das Fahrzeug hat noch nicht geantwortet.";
        sent_never: "The vehicle sends no recordings.", "Das Fahrzeug sendet keine Aufzeichnungen.";
        sent_gone: "The vehicle does not have it any more.", "Das Fahrzeug hat sie nicht mehr.";
        sent_not_finished: "It is still recorded. Ask again later.", "Sie wird noch aufgezeichnet. Später noch einmal anfordern.";
        sent_too_large: "It is too large to be sent.", "Sie ist zu groß zum Senden.";
        sent_unknown: "The vehicle does not send it.", "Das Fahrzeug sendet sie nicht.";
        recording_bad: "The pieces were wrong and were removed:", "Die Teile waren falsch und wurden entfernt:";
        recording_gone: "It is not here any more.", "Sie ist nicht mehr hier.";
        recording_here: "The recording is here.", "Die Aufzeichnung ist hier.";

        by_version: "By version", "Nach Version";
        by_config: "By configuration", "Nach Konfiguration";
        no_incidents_at_all: "No vehicle told of an incident.", "Kein Fahrzeug hat einen Vorfall gemeldet.";
        no_cause: "without a cause", "ohne Ursache";
        newest: "newest:", "neuester:";
        what_if: "What-if", "Was-wäre-wenn";
        what_ifs: "What-ifs", "Was-wäre-wenn";
        what_if_about: "All fetched recordings of this group are judged once more, by the configuration below, one after the other. No vehicle takes notice of it. Change the text, or paste another.", "Alle geholten Aufzeichnungen dieser Gruppe werden noch einmal beurteilt, nach der Konfiguration unten, eine nach der anderen. Kein Fahrzeug erfährt davon. Den Text ändern oder einen anderen einfügen.";
        not_fetched: "Not fetched yet:", "Noch nicht geholt:";
        none_fetched: "No recording of this group is here. Fetch some at their vehicles first.", "Von dieser Gruppe ist keine Aufzeichnung hier. Zuerst welche bei den Fahrzeugen holen.";
        cancel: "Cancel", "Abbrechen";
        cancelled: "It was cancelled.", "Es wurde abgebrochen.";
        ended: "The console ended before all were judged. Run it again.", "Die Konsole endete, bevor alle beurteilt waren. Noch einmal durchspielen.";
        run_again: "Change and run again", "Ändern und noch einmal durchspielen";
        judging: "Judging", "Wird beurteilt";
        new_configuration: "The new configuration", "Die neue Konfiguration";
        after_the_beginning: "after the beginning of the recording", "nach Beginn der Aufzeichnung";

        log: "Log", "Verlauf";
        last_hour: "1 hour", "1 Stunde";
        last_day: "24 hours", "24 Stunden";
        last_14_days: "14 days", "14 Tage";
        log_empty: "Nothing happened in this time.", "In dieser Zeit ist nichts geschehen.";
        log_none: "The hub has no message of this vehicle from this time.", "Die Zentrale hat aus dieser Zeit keine Nachricht dieses Fahrzeugs.";
        log_unread: "The log cannot be read now: the hub does not answer.", "Der Verlauf ist gerade nicht lesbar: Die Zentrale antwortet nicht.";
        log_cut: "There is more than is read at once: the newest is missing here. Choose a shorter time.", "Es gibt mehr, als auf einmal gelesen wird: Das Neueste fehlt hier. Einen kürzeren Zeitraum wählen.";
        log_more: "there is more than is read at once; go on from here", "es gibt mehr, als auf einmal gelesen wird; von hier aus weiterlesen";
        log_contradicts: "The vehicle told some of it twice, with different content. The first one counts here.", "Das Fahrzeug hat einiges zweimal gemeldet, mit verschiedenem Inhalt. Hier gilt das Erste.";
        alarm: "Alarm", "Alarm";
        alarm_over: "Over", "Vorbei";
        not_known: "Not known", "Nicht bekannt";
        gap_overflow: "the vehicle had no room for more", "das Fahrzeug hatte keinen Platz mehr";
        gap_too_old: "they waited too long for the hub", "sie haben zu lange auf die Zentrale gewartet";
        gap_lost: "the hub lost them", "die Zentrale hat sie verloren";
        gap_disk: "the vehicle's disk failed", "der Speicher des Fahrzeugs hat versagt";
        gap_too_large: "too large to be sent", "zu groß zum Senden";
    }

    text log_in_with(issuer: &str) { "Log in with {issuer}", "Anmelden mit {issuer}" }

    text issuer_refused(issuer: &str) { "{issuer} did not log you in. Try again.", "{issuer} hat Sie nicht angemeldet. Noch einmal versuchen." }

    text no_role_here(name: &str) { "You are logged in as {name}, but have no role here. Ask the administrator of this console for one.", "Sie sind als {name} angemeldet, haben hier aber keine Rolle. Bitte beim Betreiber der Konsole erfragen." }

    text so_many_found(count: usize) {
        1 => "One vehicle found.", "Ein Fahrzeug gefunden.";
        _ => "{count} vehicles found.", "{count} Fahrzeuge gefunden.";
    }

    text so_many_fetched(fetched: usize, count: usize) {
        0, 1 => "it is not fetched", "er ist nicht geholt";
        1, 1 => "it is fetched", "er ist geholt";
        _, _ => "{fetched} of {count} are fetched", "{fetched} von {count} sind geholt";
    }

    text so_many_not_fetched(missing: usize, count: usize) {
        0, _ => "All {count} are fetched.", "Alle {count} sind geholt.";
        1, 1 => "It is not fetched.", "Er ist nicht geholt.";
        1, _ => "1 of {count} is not fetched.", "1 von {count} ist nicht geholt.";
        _, _ => "{missing} of {count} are not fetched.", "{missing} von {count} sind nicht geholt.";
    }

    text newest_judged(chosen: usize, fetched: usize) { "Only the newest {chosen} of {fetched} are judged.", "Nur die neuesten {chosen} von {fetched} werden beurteilt." }

    text judged_so_far(judged: usize, of: usize) { "{judged} of {of} judged.", "{judged} von {of} beurteilt." }

    text so_many_differ(count: usize) {
        1 => "1 would have been different", "1 wäre anders gewesen";
        _ => "{count} would have been different", "{count} wären anders gewesen";
    }

    text so_many_same(count: usize) {
        1 => "1 without a difference", "1 ohne Unterschied";
        _ => "{count} without a difference", "{count} ohne Unterschied";
    }

    text so_many_unread(count: usize) {
        1 => "1 could not be judged", "1 war nicht zu beurteilen";
        _ => "{count} could not be judged", "{count} waren nicht zu beurteilen";
    }

    text so_many_wait(count: usize) {
        1 => "one waits for it:", "eine wartet darauf:";
        _ => "{count} wait for it:", "{count} warten darauf:";
    }

    text so_many_more(count: usize) { "{count} more", "{count} weitere" }

    text missing_messages(count: u64) {
        1 => "one message is missing", "eine Nachricht fehlt";
        _ => "{count} messages are missing", "{count} Nachrichten fehlen";
    }

    text unread_batches(count: usize) {
        1 => "One part of the log cannot be read.", "Ein Teil des Verlaufs ist nicht lesbar.";
        _ => "{count} parts of the log cannot be read.", "{count} Teile des Verlaufs sind nicht lesbar.";
    }

    text off_count(count: usize) { "{count} not in service", "{count} außer Dienst" }

    text recording_comes(percent: u64; of: &str) { "{percent} % of {of} are here.", "{percent} % von {of} sind hier." }

    text ago(age: &str) { "{age} ago", "vor {age}" }

    text before_that(age: &str) { "{age} before", "{age} davor" }

    text clock_ahead(seconds: u64) { "its clock is {seconds} s ahead", "seine Uhr geht {seconds} s vor" }

    text clock_behind(seconds: u64) { "its clock is {seconds} s behind", "seine Uhr geht {seconds} s nach" }

    text refused_messages(count: u64; why: &str) {
        1 => "one message was not taken: {why}", "eine Nachricht nicht angenommen: {why}";
        _ => "{count} messages were not taken: {why}", "{count} Nachrichten nicht angenommen: {why}";
    }
}
