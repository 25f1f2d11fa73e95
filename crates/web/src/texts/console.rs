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
    }

    text off_count(count: usize) { "{count} not in service", "{count} außer Dienst" }

    text ago(age: &str) { "{age} ago", "vor {age}" }

    text clock_ahead(seconds: u64) { "its clock is {seconds} s ahead", "seine Uhr geht {seconds} s vor" }

    text clock_behind(seconds: u64) { "its clock is {seconds} s behind", "seine Uhr geht {seconds} s nach" }

    text refused_messages(count: u64; why: &str) {
        1 => "one message was not taken: {why}", "eine Nachricht nicht angenommen: {why}";
        _ => "{count} messages were not taken: {why}", "{count} Nachrichten nicht angenommen: {why}";
    }
}
