//! The texts of the operator's actions: the next step of each stage, clearances, alarms, countermeasures.

use super::{Lang, words};
use telltale_engine::model::countermeasure::{Request, RequestKind};
use telltale_engine::state::State;
use telltale_engine::time::Span;
use telltale_engine::time::how_long;

words! {
    StepWords;
    where_is_it: "Where is the vehicle?", "Wo steht das Fahrzeug?";
    no_stops: "The configuration names no stops.", "Die Konfiguration nennt keine Haltestellen.";
    locating: "Checking the position", "Position wird geprüft";
    locating_long: "Nothing yet? Choose the stop again.", "Noch nichts? Haltestelle erneut wählen.";
    other_stop: "Choose again", "Neu wählen";
    choose_again: "Choose the stop again.", "Haltestelle erneut wählen.";
    stop_is_wrong: "The position does not fit", "Die Position passt nicht";
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
    confirm: "Confirm", "Bestätigen";
    cancel: "Cancel", "Abbrechen";
    shutdown: "Lock the display", "Anzeige sperren";
    shutdown_title: "Lock the display?", "Anzeige sperren?";
    shutdown_text: "The vehicle is locked and you are logged out. Its computers stay on.", "Das Fahrzeug wird gesperrt, Sie werden abgemeldet. Die Rechner bleiben an.";
    shutdown_confirm: "Lock", "Sperren";
    hand_over: "Hand over", "Ablösung";
    stop: "STOP", "STOP";
    stop_vehicle: "Stop vehicle", "Fahrzeug anhalten";
    stop_requested: "Stop requested", "Anhalten angefordert";
    stop_asked: "Stop asked", "Anhalten verlangt";
    stop_since: "asked", "verlangt";
    stop_sending: "Sending", "Wird gesendet";
    stop_missed: "Not arrived", "Nicht angekommen";
    stop_sent: "Arrived", "Angekommen";
    no_listener: "No vehicle listens: it cannot be stopped from here. Be ready to take over.", "Kein Fahrzeug hört zu: Von hier lässt es sich nicht anhalten. Zum Übernehmen bereithalten.";
    not_stoppable: "It cannot be stopped from here. Be ready to take over.", "Von hier lässt es sich nicht anhalten. Zum Übernehmen bereithalten.";
    go_on: "Continue driving", "Weiterfahren";
    let_go: "End the stop", "Anhalten aufheben";
    withdraw: "Withdraw clearance", "Freigabe widerrufen";
    stop_not_sent: "The stop has not arrived and is sent again. Take over.", "Das Anhalten ist nicht angekommen und wird erneut gesendet. Übernehmen.";
    looking: "Looking for the vehicle", "Verbindung wird gesucht";
    stop_again: "A stop is sent again until it is answered.", "Ein Anhalten wird gesendet, bis es beantwortet ist.";
    acknowledge: "Acknowledge", "Quittieren";
    acknowledge_over: "over: acknowledge", "vorbei: quittieren";
    over: "Over", "Vorbei";
    held_error: "Held until reset", "Gehalten bis zum Zurücksetzen";
    reset: "Reset", "Zurücksetzen";
    reset_here: "Over. Held until reset: touch here.", "Vorbei. Gehalten bis zum Zurücksetzen: hier berühren.";
    refused: "Not done", "Nicht ausgeführt";
    not_sent: "Not sent: this display is not live.", "Nicht gesendet: Diese Anzeige ist nicht live.";
    no_answer: "The server did not answer. Look at what is shown.", "Der Server hat nicht geantwortet. Anzeige beachten.";
    waiting: "Not sent: the server has not answered the last tap yet.", "Nicht gesendet: Der letzte Tipp ist noch unbeantwortet.";
    second_tap: "Only the first tap counted.", "Nur der erste Tipp hat gezählt.";
    just_changed: "Not sent: the button has just changed.", "Nicht gesendet: Die Taste hat gerade gewechselt.";
    dismiss: "Close", "Schließen";
    all_checks: "Checks before the clearance", "Prüfungen vor der Freigabe";
    open_checks: "open", "offen";
    all_causes: "All that is wrong", "Alle Störungen";
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
    held_end: "Held. End the stop?", "Gehalten. Anhalten aufheben?";
    stopped_cause_gone: "Stopped. Cause gone. Continue?", "Steht. Ursache behoben. Weiterfahren?";

    no_pose: "no position yet", "noch keine Position";
    no_goal: "No destination", "Kein Ziel";
    not_localized: "The position is not confirmed", "Position nicht bestätigt";
    still_held: "The vehicle is still held", "Das Fahrzeug wird noch gehalten";
    goal_set: "Destination set", "Ziel gesetzt";
    all_fit: "All components ready", "Alle Komponenten bereit";
    nothing_holds: "Nothing holds the vehicle", "Nichts hält das Fahrzeug";

    drives: "On the way", "Unterwegs";
    runs: "Running", "In Betrieb";
    no_data: "No data yet", "Noch keine Daten";
    may_start: "It may start at any moment.", "Fährt jeden Moment an.";
    nothing_wrong: "Nothing is wrong", "Keine Störung";
    cause_gone: "Cause gone. Continue?", "Ursache behoben. Weiterfahren?";
    held: "Held", "Gehalten";
    since: "since", "seit";
    not_heard_again: "not heard again yet", "noch nicht wieder gehört";
    held_until: "Held until you continue", "Gehalten, bis Sie weiterfahren";
    held_back: "Held until the cause is gone", "Gehalten, bis die Ursache behoben ist";
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
}

impl Lang {
    pub fn steps(self) -> &'static StepWords {
        match self {
            Lang::En => &EN,
            Lang::De => &DE,
        }
    }

    /// What the vehicle is asked for by a countermeasure, or what it has confirmed to do: `Slowing down`. A stop may be
    /// the operator's own alone.
    pub fn countermeasure(self, request: RequestKind, done: bool, for_a_fault: bool) -> &'static str {
        match (self, request, for_a_fault) {
            (Lang::En, RequestKind::Decelerate, _) if done => "Slowing down",
            (Lang::En, RequestKind::Decelerate, _) => "Asked to slow down",
            (Lang::De, RequestKind::Decelerate, _) if done => "Bremst ab",
            (Lang::De, RequestKind::Decelerate, _) => "Soll abbremsen",
            (Lang::En, RequestKind::ManeuverStop, true) if done => "Stopping for a fault",
            (Lang::En, RequestKind::ManeuverStop, true) => "Asked to stop for a fault",
            (Lang::En, RequestKind::ManeuverStop, false) if done => "Stopping safely",
            (Lang::En, RequestKind::ManeuverStop, false) => "Asked to stop safely",
            (Lang::De, RequestKind::ManeuverStop, true) if done => "Hält wegen einer Störung an",
            (Lang::De, RequestKind::ManeuverStop, true) => "Soll wegen einer Störung anhalten",
            (Lang::De, RequestKind::ManeuverStop, false) if done => "Hält sicher an",
            (Lang::De, RequestKind::ManeuverStop, false) => "Soll sicher anhalten",
            (Lang::En, RequestKind::Notify, _) => "Told to the operator",
            (Lang::De, RequestKind::Notify, _) => "Der Fahrbegleitung gemeldet",
        }
    }

    /// The texts around the duration of a silence: `silent for 3 s`.
    pub fn silent_around(self) -> (&'static str, &'static str) {
        match self {
            Lang::En => ("silent for ", ""),
            Lang::De => ("seit ", " still"),
        }
    }

    /// The last message, behind the duration of the silence if there is one.
    pub fn with_silence(self, last: String, silent: Option<Span>) -> String {
        let Some(long) = silent.map(how_long) else { return last };
        let (before, after) = self.silent_around();
        match last.is_empty() {
            true => format!("{before}{long}{after}"),
            false => format!("{before}{long}{after}; {} {last}", self.words().last_words),
        }
    }

    /// The title of a request that nobody receives.
    pub fn unheard(self, request: Request) -> &'static str {
        match (self, request.kind()) {
            (Lang::En, RequestKind::Decelerate) => "Request to slow down not received",
            (Lang::De, RequestKind::Decelerate) => "Abbremsen ist nicht angekommen",
            (Lang::En, _) => "Request to stop not received",
            (Lang::De, _) => "Anhalten ist nicht angekommen",
        }
    }

    /// `Sensors, CAN: error`: components that forbid a clearance.
    pub fn not_fit(self, names: &str, state: State) -> String {
        let what = match (self, state) {
            (Lang::En, State::Error) => "error",
            (Lang::De, State::Error) => "Fehler",
            (Lang::En, State::Unknown) => "state unknown",
            (Lang::De, State::Unknown) => "Zustand unbekannt",
            (Lang::En, State::Ignore) => "waiting for others",
            (Lang::De, State::Ignore) => "wartet auf andere",
            (Lang::En, _) => "warning",
            (Lang::De, _) => "Warnung",
        };
        format!("{names}: {what}")
    }

    /// `Planning, Control: wait for Localization`: components that another one's fault masks.
    pub fn wait_for(self, names: &[String], cause: Option<&str>) -> String {
        let what = match (self, cause, names.len()) {
            (_, None, _) => return self.not_fit(&names.join(", "), State::Ignore),
            (Lang::En, Some(cause), 1) => format!("waits for {cause}"),
            (Lang::En, Some(cause), _) => format!("wait for {cause}"),
            (Lang::De, Some(cause), 1) => format!("wartet auf {cause}"),
            (Lang::De, Some(cause), _) => format!("warten auf {cause}"),
        };
        format!("{}: {what}", names.join(", "))
    }

    /// A module's report that has not lasted long enough to count.
    pub fn reports_not_long(self, reported: State) -> String {
        match self {
            Lang::En => format!("Reports {}, not for long enough yet:", self.state(reported)),
            Lang::De => format!("Meldet {}, noch nicht lange genug:", self.state(reported)),
        }
    }

    /// A WARNING that has to be accepted before a clearance.
    pub fn not_accepted(self, name: &str) -> String {
        match self {
            Lang::En => format!("Acknowledge first: {name}"),
            Lang::De => format!("Zuerst quittieren: {name}"),
        }
    }

    /// `lasted 9 s`, of a fault that is over.
    pub fn lasted(self, long: Span) -> String {
        // A number and its unit stand on one line.
        match (self, how_long(long).replace(' ', "\u{a0}").as_str()) {
            (Lang::En, "0\u{a0}s") => "lasted under 1\u{a0}s".to_owned(),
            (Lang::En, long) => format!("lasted {long}"),
            (Lang::De, "0\u{a0}s") => "dauerte unter 1\u{a0}s".to_owned(),
            (Lang::De, long) => format!("dauerte {long}"),
        }
    }

    /// `3 times`, of an alarm that came and went.
    pub fn so_often(self, count: usize) -> String {
        match (self, count) {
            (_, 0 | 1) => String::new(),
            (Lang::En, _) => format!("{count} times"),
            (Lang::De, _) => format!("{count}-mal"),
        }
    }

    /// Why a confirmation is refused.
    pub fn not_pending(self, too_late: bool) -> String {
        let words = match (self, too_late) {
            (Lang::En, true) => "The confirmation came later than 10 s. Begin again.",
            (Lang::De, true) => "Die Bestätigung kam später als 10 s. Bitte neu beginnen.",
            (Lang::En, false) => "Nothing waits for this confirmation. Begin again.",
            (Lang::De, false) => "Auf diese Bestätigung wartet nichts. Bitte neu beginnen.",
        };
        words.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_is_said_in_both_languages() {
        const SAME: &[&str] = &["position", "stop", "recording_short"];
        for (key, en, de) in ALL {
            assert!(!en.trim().is_empty() && !de.trim().is_empty(), "{key}");
            assert!(en != de || SAME.contains(key), "{key}: {en}");
        }
    }

    #[test]
    fn what_is_asked_is_not_said_to_be_done() {
        for lang in Lang::ALL {
            for request in [RequestKind::Decelerate, RequestKind::ManeuverStop] {
                for for_a_fault in [false, true] {
                    let [done, asked] =
                        [true, false].map(|done| lang.countermeasure(request, done, for_a_fault));
                    assert_ne!(done, asked);
                }
            }
        }
    }
}
