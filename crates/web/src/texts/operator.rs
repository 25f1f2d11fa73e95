//! The texts of the operator's page, of the login and of the demo.

use std::net::IpAddr;

use telltale_engine::model::countermeasure::RequestKind;
use telltale_engine::state::State;

/// Why a session ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SessionEnd {
    /// Its time was over.
    Expired,
    /// Its holder did nothing.
    Idle,
    /// Another operator took the vehicle over.
    TakenOver,
    /// The same operator logged out at another display.
    LoggedOut,
    /// Its holder logged out at this display.
    LoggedOutHere,
    /// The user was removed.
    Removed,
    /// Another role or secret, too many sessions, or a session that the store does not know.
    Ended,
}

texts! {
    words Words {
        ok: "OK", "OK";
        warning: "Warning", "Warnung";
        error: "Error", "Fehler";
        ignore: "Ignored", "Ignoriert";
        unknown: "Unknown", "Unbekannt";
        waiting: "Waiting for", "Wartet auf";
        not_active: "Not active", "Nicht aktiv";

        locked: "Locked", "Gesperrt";
        localizing: "Localizing", "Lokalisierung";
        ready: "Ready", "Bereit";
        not_ready: "Not ready", "Nicht bereit";
        cleared: "Cleared", "Freigegeben";
        driving: "Autonomous", "Autonom";

        log_in_to_start: "Log in to start.", "Zum Starten anmelden.";

        not_locked: "locked", "gesperrt";
        not_localized: "not yet localized", "noch nicht lokalisiert";
        not_driving: "not driving", "fährt nicht";
        not_driving_yet: "not driving yet", "fährt noch nicht";
        not_while_driving: "not while driving", "nicht während der Fahrt";

        operator: "Operator", "Fahrbegleitung";
        logged_in: "Logged in", "Angemeldet";
        nobody: "No operator", "Keine Fahrbegleitung";
        looks_only: "View only", "Nur Ansicht";
        to_day: "Switch to day colours", "Zu Tagfarben wechseln";
        to_night: "Switch to night colours", "Zu Nachtfarben wechseln";
        other_language: "Auf Deutsch umschalten", "Switch to English";
        other_language_short: "DE", "EN";
        demo: "Demo", "Demo";

        wrong: "Faults", "Störungen";
        nothing_diagnosed: "Nothing is diagnosed now", "Zurzeit wird nichts überwacht";
        since_for: "for", "seit";
        no_news: "not reporting", "keine Meldung";
        no_member: "nothing to watch", "nichts zu überwachen";
        none_undeclared: "none there", "keine da";
        last_words: "last:", "zuletzt:";
        no_report: "has not reported yet", "hat sich noch nicht gemeldet";
        masked_by: "Cause", "Ursache";
        itself: "itself", "selbst";
        close: "Close", "Schließen";
        why: "Why", "Warum";
        second_fault: "second fault", "weitere Störung";
        minutes: "last 5 minutes", "letzte 5 Minuten";
        more: "more", "weitere";

        live: "Live", "Live";
        live_stale: "Delayed", "Verzögert";
        live_dead: "Not live", "Nicht live";
        replay: "Replay", "Wiedergabe";
        stale_banner: "Display is late", "Anzeige verzögert";
        frozen: "Display frozen.", "Anzeige eingefroren.";
        frozen_take_over: "Take over.", "Übernehmen.";
        frozen_text: "Out of date since", "Veraltet seit";
        menu: "More", "Mehr";
        seen: "seen", "gesehen";

        unfit: "This browser is too old for a live display. Use another one, such as a new Chromium or Firefox.", "Dieser Browser ist zu alt für eine Live-Anzeige. Anderen verwenden, etwa ein neues Chromium oder Firefox.";

        log_in: "Log in", "Anmelden";
        log_out: "Log out", "Abmelden";
        name: "Name", "Name";
        secret: "PIN or password", "PIN oder Passwort";
        login_title: "Log in", "Anmelden";
        login_text: "The vehicle is shown after that.", "Danach ist das Fahrzeug zu sehen.";
        name_missing: "The name is missing.", "Der Name fehlt.";
        secret_missing: "The PIN or password is missing.", "PIN oder Passwort fehlt.";
        login_wrong: "Name or PIN is wrong.", "Name oder PIN ist falsch.";
        login_unavailable: "Logins cannot be checked now. Try again.", "Anmeldung zurzeit nicht prüfbar. Noch einmal versuchen.";
        login_storage: "The disk is full or broken, so nothing was changed. Call the control room.", "Speicher voll oder defekt, daher nichts geändert. Leitstelle rufen.";
        login_drives: "The vehicle drives. Take the operator's place at a display in the vehicle, or after it has arrived.", "Das Fahrzeug fährt. Ablösen nur an einer Anzeige im Fahrzeug oder nach der Ankunft.";
        login_pin_elsewhere: "A PIN works at the displays in the vehicle only. Here a password is needed.", "Eine PIN gilt nur an den Anzeigen im Fahrzeug. Hier ist ein Passwort nötig.";
        login_late: "That took too long. Enter the PIN or password again.", "Das hat zu lange gedauert. PIN oder Passwort noch einmal eingeben.";
        login_no_users: "No user exists yet. On the vehicle: telltale user add NAME --role operator", "Noch kein Benutzer. Auf dem Fahrzeug: telltale user add NAME --role operator";
        display: "Display", "Anzeige";
        pad_digits: "Digits", "Ziffern";
        pad_letters: "Letters", "Buchstaben";
        pad_erase: "Delete the last one", "Letztes löschen";
        login_demo: "Demo: operator with PIN 246810", "Demo: operator mit PIN 246810";
        back: "Back to the vehicle", "Zurück zum Fahrzeug";
        not_now: "Cancel", "Abbrechen";

        demo_title: "Faults to try", "Fehler zum Ausprobieren";
        demo_text: "Each button switches one fault. The page of the vehicle shows what becomes of it, after at least 1.5 s: this computer does other work too, which must not look like a fault.", "Jeder Knopf schaltet einen Fehler. Die Seite des Fahrzeugs zeigt, was daraus wird, frühestens nach 1,5 s: Dieser Rechner tut auch anderes, und das darf nicht wie ein Fehler aussehen.";
        demo_on: "on", "an";
        demo_off: "off", "aus";

        refused_title: "Refused", "Abgelehnt";
        where_is_it: "Where is the vehicle?", "Wo steht das Fahrzeug?";
        no_stops: "The configuration names no stops.", "Die Konfiguration nennt keine Haltestellen.";
        locating: "Checking the position", "Position wird geprüft";
        locating_long: "Nothing yet? Choose the stop again.", "Noch nichts? Haltestelle erneut wählen.";
        other_stop: "Choose again", "Neu wählen";
        choose_again: "Choose the stop again.", "Haltestelle erneut wählen.";
        stop_is_wrong: "The position does not fit.", "Die Position passt nicht.";
        chosen: "Chosen", "Gewählt";
        driven_here: "Destination of the last drive", "Ziel der letzten Fahrt";
        chosen_here: "Chosen here last", "Zuletzt hier gewählt";
        for_operator: "For the operator:", "Für die Fahrbegleitung:";
        operator_chooses: "The operator chooses the stop.", "Die Fahrbegleitung wählt die Haltestelle.";
        operator_clears: "The operator may give clearance.", "Die Fahrbegleitung darf die Freigabe erteilen.";
        operator_continues: "Stopped. The operator may continue.", "Steht. Die Fahrbegleitung darf weiterfahren.";
        more_stops: "More stops", "Weitere Haltestellen";
        position: "Position", "Position";
        clearance: "Give clearance", "Freigabe erteilen";
        confirm_title: "Start driving?", "Losfahren?";
        confirm_text: "A tone, then it drives.", "Erst ein Ton, dann fährt es.";
        drive: "Drive", "Losfahren";
        cancel: "Cancel", "Abbrechen";
        shutdown: "Lock the display", "Anzeige sperren";
        shutdown_title: "Lock the display?", "Anzeige sperren?";
        shutdown_text: "The vehicle is locked and you are logged out. Its computers stay on.", "Das Fahrzeug wird gesperrt, Sie werden abgemeldet. Die Rechner bleiben an.";
        shutdown_confirm: "Lock", "Sperren";
        hand_over: "Hand over", "Ablösung";
        stop: "STOP", "STOP";
        stop_vehicle: "Stop vehicle", "Fahrzeug anhalten";
        stop_requested: "Stop requested", "Anhalten angefordert";
        stop_asked: "STOP pressed", "STOP gedrückt";
        stop_since: "asked", "gedrückt";
        stop_sending: "Sending", "Wird gesendet";
        stop_missed: "Not arrived", "Nicht angekommen";
        stop_sent: "Arrived", "Angekommen";
        no_listener: "No vehicle listens: it cannot be stopped from here. Be ready to take over.", "Kein Fahrzeug hört zu: Von hier lässt es sich nicht anhalten. Zum Übernehmen bereithalten.";
        not_stoppable: "It cannot be stopped from here. Be ready to take over.", "Von hier lässt es sich nicht anhalten. Zum Übernehmen bereithalten.";
        go_on: "Continue driving", "Weiterfahren";
        let_go: "Release vehicle", "Fahrzeug freigeben";
        withdraw: "Withdraw clearance", "Freigabe widerrufen";
        stop_not_sent: "The stop has not arrived and is sent again. Take over.", "Das Anhalten ist nicht angekommen und wird erneut gesendet. Übernehmen.";
        looking: "Looking for the vehicle", "Verbindung wird gesucht";
        stop_again: "A stop is sent again until it is answered.", "Ein Anhalten wird gesendet, bis es beantwortet ist.";
        acknowledge: "Acknowledge", "Quittieren";
        all_over: "more, over", "weitere, vorbei";
        acknowledge_over: "over: acknowledge", "vorbei: quittieren";
        over: "Over", "Vorbei";
        shelved: "In maintenance", "In Wartung";
        until: "until", "bis";
        held_error: "Held until reset", "Gehalten bis zum Zurücksetzen";
        reset: "Reset", "Zurücksetzen";
        reset_here: "Over. Held until reset: touch here.", "Vorbei. Gehalten bis zum Zurücksetzen: hier berühren.";
        refused: "Not done", "Nicht ausgeführt";
        not_sent: "Not sent: this display is not live.", "Nicht gesendet: Diese Anzeige ist nicht live.";
        no_answer: "The server did not answer. Look at what is shown.", "Der Server hat nicht geantwortet. Anzeige beachten.";
        not_answered: "Not sent: the server has not answered the last tap yet.", "Nicht gesendet: Der letzte Tipp ist noch unbeantwortet.";
        second_tap: "Only the first tap counted.", "Nur der erste Tipp hat gezählt.";
        just_changed: "Not sent: the button has just changed.", "Nicht gesendet: Die Taste hat gerade gewechselt.";
        dismiss: "Close", "Schließen";
        all_checks: "Checks before the clearance", "Prüfungen vor der Freigabe";
        open_checks: "to check", "prüfen";
        all_causes: "All faults", "Alle Störungen";
        last_alarms: "Last alarms", "Letzte Alarme";
        no_alarms: "No alarm yet.", "Noch kein Alarm.";
        lasts: "not over", "nicht vorbei";
        mark: "Mark", "Merken";
        mark_long: " this moment in the recording", ": diesen Moment in der Aufzeichnung";
        marked: "Marked in the recording.", "In der Aufzeichnung gemerkt.";
        not_marked: "Not marked: the server did not answer. Note the time.", "Nicht gemerkt: Der Server hat nicht geantwortet. Bitte die Uhrzeit notieren.";
        recording_short: "REC", "REC";
        recording_long: "An incident is being recorded.", "Ein Vorfall wird aufgezeichnet.";
        sound_on: "Sound on", "Ton an";
        sound_off: "Sound off", "Ton aus";

        clear_to_drive: "Give clearance to drive.", "Freigabe erteilen.";
        wait_for_goal: "Wait for a destination.", "Auf ein Ziel warten.";
        wait: "Wait.", "Warten.";
        take_over_stop: "Take over. Stop.", "Übernehmen. Anhalten.";
        stopped_continue: "Stopped. Continue?", "Steht. Weiterfahren?";
        held_end: "Held. Release the vehicle?", "Gehalten. Fahrzeug freigeben?";
        stopped_cause_gone: "Stopped. Cause gone. Continue?", "Steht. Störung vorbei. Weiterfahren?";

        no_pose: "no position yet", "noch keine Position";
        no_goal: "No destination", "Kein Ziel";
        not_confirmed: "The position is not confirmed", "Position nicht bestätigt";
        still_held: "The vehicle is still held", "Das Fahrzeug wird noch gehalten";
        goal_set: "Destination set", "Ziel gesetzt";
        all_fit: "All components ready", "Alle Komponenten bereit";
        nothing_holds: "Nothing holds the vehicle", "Nichts hält das Fahrzeug";

        drives: "On the way", "Unterwegs";
        runs: "Running", "In Betrieb";
        no_data: "No data yet", "Noch keine Daten";
        may_start: "It may start at any moment.", "Fährt jeden Moment an.";
        nothing_wrong: "Nothing is wrong", "Keine Störung";
        cause_gone: "Cause gone. Continue?", "Störung vorbei. Weiterfahren?";
        continue_driving: "Continue?", "Weiterfahren?";
        held: "Held", "Gehalten";
        until_gone: "until the cause is gone", "bis die Störung vorbei ist";
        since: "since", "seit";
        not_heard_again: "not heard again yet", "noch nicht wieder gehört";
        held_back: "Held until the cause is gone", "Gehalten, bis die Störung vorbei ist";
        no_sight: "Something is unknown", "Etwas ist unbekannt";
        take_over_ready: "Be ready to take over.", "Zum Übernehmen bereithalten.";
        go_on_alert: "You may go on. Stay alert.", "Weiterfahren möglich. Aufmerksam bleiben.";
        stay: "Do not drive off. If it lasts, call the control room.", "Nicht losfahren. Bleibt es so, Leitstelle rufen.";
        wait_for_report: "Wait for its report. If none comes, call the control room.", "Auf die Meldung warten. Kommt keine, Leitstelle rufen.";
        acknowledge_first: "Acknowledge it before driving off.", "Vor dem Losfahren quittieren.";
        nothing_to_do: "Nothing to do for now.", "Vorerst ist nichts zu tun.";
        check_machine: "Check the machine.", "Maschine prüfen.";
        keep_an_eye: "Keep an eye on it.", "Im Blick behalten.";

        asked: "Sent to the vehicle", "An das Fahrzeug gesendet";
        not_received_yet: "Not received yet", "Noch nicht empfangen";
        engaged: "The vehicle responds", "Das Fahrzeug reagiert";
        unconfirmed: "The vehicle does not respond.", "Das Fahrzeug reagiert nicht.";
        unheard: "No vehicle listens.", "Kein Fahrzeug hört zu.";

        moves_itself: "Driving", "Fährt";
        slowing: "Slowing down", "Bremst";
        stopping: "Stopping", "Hält an";
        standing: "Standing", "Steht";
        moving: "Moving", "In Bewegung";
        no_speed: "Speed unknown", "Geschwindigkeit unbekannt";
        no_signal: "No speed signal", "Kein Tempo-Signal";
        next: "next", "Ziel";
    }

    /// The request of a countermeasure to the vehicle, or what it has confirmed: `Slowing down`. A stop may be
    /// the operator's own alone.
    word countermeasure(request: RequestKind, done: bool, for_a_fault: bool) {
        RequestKind::Decelerate, true, _ => "Slowing down", "Bremst";
        RequestKind::Decelerate, false, _ => "Asked to slow down", "Soll abbremsen";
        RequestKind::ManeuverStop, true, true => "Stopping for a fault", "Hält wegen einer Störung an";
        RequestKind::ManeuverStop, false, true => "Asked to stop for a fault", "Soll wegen einer Störung anhalten";
        RequestKind::ManeuverStop, true, false => "Stopping safely", "Hält sicher an";
        RequestKind::ManeuverStop, false, false => "Asked to stop safely", "Soll sicher anhalten";
        RequestKind::Notify, _, _ => "Told to the operator", "Der Fahrbegleitung gemeldet";
    }

    text silent_for(long: &str) { "silent for {long}", "seit {long} still" }

    word unheard_request(request: RequestKind) {
        RequestKind::Decelerate => "Request to slow down not received", "Abbremsen ist nicht angekommen";
        _ => "Request to stop not received", "Anhalten ist nicht angekommen";
    }

    /// `Sensors, CAN: error`: components that forbid a clearance.
    text not_fit(state: State; names: &str) {
        State::Error => "{names}: error", "{names}: Fehler";
        State::Unknown => "{names}: state unknown", "{names}: Zustand unbekannt";
        State::Ignore => "{names}: waiting for others", "{names}: wartet auf andere";
        _ => "{names}: warning", "{names}: Warnung";
    }

    text waiting_for(count: usize; names: &str, cause: &str) {
        1 => "{names}: waits for {cause}", "{names}: wartet auf {cause}";
        _ => "{names}: wait for {cause}", "{names}: warten auf {cause}";
    }

    text reports_briefly(state: &str) { "Reports {state}, not for long enough yet:", "Meldet {state}, noch nicht lange genug:" }

    /// A WARNING that has to be accepted before a clearance.
    text not_accepted(name: &str) { "Acknowledge first: {name}", "Zuerst quittieren: {name}" }

    text lasted_so_long(long: &str) {
        "0\u{a0}s" => "lasted under 1\u{a0}s", "dauerte unter 1\u{a0}s";
        _ => "lasted {long}", "dauerte {long}";
    }

    /// `3 times`, of an alarm that came and went.
    text so_often(count: usize) {
        0 | 1 => "", "";
        _ => "{count} times", "{count}-mal";
    }

    /// `4 parts wait`: components that a root cause masks, or modules where no whole component is masked.
    text parts_wait(count: usize) {
        1 => "1 part waits", "1 Teil wartet";
        _ => "{count} parts wait", "{count} Teile warten";
    }

    /// How far the stop is in a straight line.
    text stop_away(far: &str) { "About {far} to go", "Noch etwa {far}" }

    /// The same with the minutes of a drive there.
    text stop_away_in(far: &str, min: u32) { "About {far}, {min}\u{a0}min to go", "Noch etwa {far}, {min}\u{a0}min" }

    /// `1 in maintenance`: modules whose faults call nobody for now.
    text so_many_shelved(count: usize) { "{count} in maintenance", "{count} in Wartung" }

    /// The user who shelved a module.
    text shelved_by(by: &str) { "by {by}", "durch {by}" }

    /// `2 faults of its own`: behind a component that waits.
    text own_faults(count: usize) {
        1 => "1 fault of its own", "1 eigene Störung";
        _ => "{count} faults of its own", "{count} eigene Störungen";
    }

    /// `All 8 components OK`, or `All 6 active components OK` where others are not active.
    text all_ok(count: usize, all: bool) {
        1, true => "The component is OK", "Die Komponente ist OK";
        1, false => "The active component is OK", "Die aktive Komponente ist OK";
        2, true => "Both components OK", "Beide Komponenten OK";
        2, false => "Both active components OK", "Beide aktiven Komponenten OK";
        _, true => "All {count} components OK", "Alle {count} Komponenten OK";
        _, false => "All {count} active components OK", "Alle {count} aktiven Komponenten OK";
    }

    /// Statuses outside of the configuration, by the worst state among them.
    text undeclared(state: State, count: usize) {
        State::Error, 1 => "1 error outside of the configuration", "1 Fehler außerhalb der Konfiguration";
        State::Error, _ => "{count} errors outside of the configuration", "{count} Fehler außerhalb der Konfiguration";
        State::Warning, 1 => "1 warning outside of the configuration", "1 Warnung außerhalb der Konfiguration";
        State::Warning, _ => "{count} warnings outside of the configuration", "{count} Warnungen außerhalb der Konfiguration";
        _, _ => "{count} unknown outside of the configuration", "{count} unbekannt außerhalb der Konfiguration";
    }

    /// `and 3 more`.
    text and_more(count: usize) {
        1 => "and 1 more", "und 1 weitere";
        _ => "and {count} more", "und {count} weitere";
    }

    /// The same of faults.
    text and_more_faults(count: usize) {
        1 => "and 1 more", "und 1 weitere Störung";
        _ => "and {count} more", "und {count} weitere Störungen";
    }

    /// `Mission not reporting`: the fault of a component that is silent.
    text not_reporting(name: &str) { "{name} not reporting", "{name} ohne Meldung" }

    /// `State unknown: Mission`: the fault of a component that reports that it does not know.
    text state_unknown(name: &str) { "State unknown: {name}", "Zustand unbekannt: {name}" }

    /// A signal that the configuration gives a title.
    /// Where the vehicle drives to, in the line of its motion.
    text drives_to(stop: &str) { "to {stop}", "Ziel: {stop}" }

    text titled_signal(value: bool; title: &str) {
        true => "{title}", "{title}";
        false => "not {title}", "nicht {title}";
    }

    text plain_signal(value: bool; name: &str) {
        true => "{name} is on", "{name} ist an";
        false => "{name} is off", "{name} ist aus";
    }

    /// Another operator has the vehicle: the question above the button `take_place`.
    text login_other_operator(by: &str) { "{by} is the operator. Take their place?", "{by} ist im Dienst. Ablösen?" }

    /// The button that makes the reader the operator. To take over is to steer.
    text take_place(of: &str) { "Take the place of {of}", "{of} ablösen" }

    /// Above the login of another operator at the display of the present one.
    text login_change(from: &str) { "On duty: {from}. Who is next?", "Im Dienst: {from}. Wer löst ab?" }

    text login_wait(seconds: u64) { "Too many tries. Wait {seconds} s.", "Zu viele Versuche. {seconds} s warten." }

    /// The notice on every page while a hand-over is due.
    text hand_over(to: &str) {
        "{to} takes your place in 5 s. Until then both of you can stop the vehicle.", "{to} löst Sie in 5 s ab. Bis dahin können beide das Fahrzeug anhalten."
    }

    /// That the session of a page is used from another address, too.
    text elsewhere(address: IpAddr) {
        "Your login is also used from {address}. If that is not you, log out and have your secret changed.",
        "Ihre Anmeldung wird auch von {address} aus benutzt. Wenn Sie das nicht sind, melden Sie sich ab und lassen Sie Ihr Zugangsgeheimnis ändern."
    }

    /// Why the login page is shown again.
    word session_end(why: SessionEnd) {
        SessionEnd::Expired => "Your login is over after 12 hours. Log in again.", "Ihre Anmeldung ist nach 12 Stunden abgelaufen. Neu anmelden.";
        SessionEnd::Idle => "Logged out: nothing was done for 15 minutes.", "Abgemeldet: 15 Minuten lang nichts getan.";
        SessionEnd::TakenOver => "Another operator has taken your place.", "Jemand anderes hat Sie abgelöst.";
        SessionEnd::LoggedOut => "You logged out at another display.", "Sie haben sich an einer anderen Anzeige abgemeldet.";
        SessionEnd::LoggedOutHere => "Logged out.", "Abgemeldet.";
        SessionEnd::Removed => "This user was removed. Call the control room.", "Dieser Benutzer wurde entfernt. Leitstelle rufen.";
        SessionEnd::Ended => "Your login has ended. Log in again.", "Ihre Anmeldung wurde beendet. Neu anmelden.";
    }

    /// The name of a monitor's measured value.
    known measured(key: &str) {
        "rate_hz" => "rate", "Rate";
        "input_hz" => "inputs", "Eingaben";
        "output_hz" => "outputs", "Ausgaben";
        "ratio" => "ratio", "Verhältnis";
        "latency_s" => "late", "Verspätung";
        "value" => "value", "Wert";
        "difference" => "difference", "Abweichung";
        "earlier" => "earlier", "früher";
        "later" => "later", "später";
        "translation_m" => "shift", "Verschiebung";
        "rotation_deg" => "rotation", "Drehung";
        "count_difference" => "difference in number", "Abweichung der Anzahl";
        "nearest_m" => "apart", "Abstand";
        "answer_ms" => "answer", "Antwort";
        "misses" => "misses", "ohne Antwort";
    }
}

/// The unit of a monitor's measured value.
pub fn unit(key: &str) -> &'static str {
    match key {
        "rate_hz" | "input_hz" | "output_hz" => "Hz",
        "latency_s" => "s",
        "translation_m" | "nearest_m" => "m",
        "rotation_deg" => "°",
        "answer_ms" => "ms",
        _ => "",
    }
}
