//! The texts of the pages. A text that lacks a language does not compile.

pub(crate) mod action_words;
mod lang;
pub(crate) mod motion_words;
pub(crate) mod refusals;
pub(crate) mod session_end;

pub use lang::Lang;

use crate::view::text::{NAME, clean, clean_configured};
use telltale_engine::model::quantity::number;
use telltale_engine::model::{ACTIVE_SIGNAL, POSED_SIGNAL, Stage};
use telltale_engine::snapshot::{Layout, NotRelevant, Snapshot};
use telltale_engine::state::State;
use telltale_engine::text::Text;

macro_rules! words {
    ($table:ident; $($key:ident: $en:literal, $de:literal;)*) => {
        /// Fixed words of one language.
        #[derive(Debug)]
        pub struct $table { $(pub $key: &'static str,)* }

        static EN: $table = $table { $($key: $en,)* };
        static DE: $table = $table { $($key: $de,)* };

        #[cfg(test)]
        const ALL: &[(&str, &str, &str)] = &[$((stringify!($key), $en, $de),)*];
    };
}

pub(crate) use words;

words! {
    Words;
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
    to_day: "Switch to day colours", "Zu Tagfarben wechseln";
    to_night: "Switch to night colours", "Zu Nachtfarben wechseln";
    other_language: "Auf Deutsch umschalten", "Switch to English";
    other_language_short: "DE", "EN";
    demo: "Demo", "Demo";

    wrong: "What is wrong", "Störungen";
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
    not_in_charge: "Somebody else leads the vehicle. Log in again to take their place.", "Jemand anderes führt das Fahrzeug. Zum Ablösen neu anmelden.";
    refused_stale: "Things have changed since this was shown. Look again.", "Die Lage hat sich seit der Anzeige geändert. Neu hinsehen.";
    refused_stopped: "STOP was tapped in the meantime, so this was not done. Look again.", "Inzwischen wurde STOP getippt, daher nicht ausgeführt. Neu hinsehen.";
    refused_driving: "While the vehicle is cleared or drives, this is for its operator at the page.", "Während das Fahrzeug freigegeben ist oder fährt, ist das Sache des Bedieners an der Anzeige.";
    refused_late: "This waited too long and was not done. Look again.", "Das hat zu lange gewartet und wurde nicht ausgeführt. Neu hinsehen.";
    login_demo: "Demo: operator with PIN 246810", "Demo: operator mit PIN 246810";
    back: "Back to the vehicle", "Zurück zum Fahrzeug";
    not_now: "Cancel", "Abbrechen";

    demo_title: "Faults to try", "Fehler zum Ausprobieren";
    demo_text: "Each button switches one fault. The page of the vehicle shows what becomes of it, after at least 1.5 s: this computer does other work too, which must not look like a fault.", "Jeder Knopf schaltet einen Fehler. Die Seite des Fahrzeugs zeigt, was daraus wird, frühestens nach 1,5 s: Dieser Rechner tut auch anderes, und das darf nicht wie ein Fehler aussehen.";
    demo_on: "on", "an";
    demo_off: "off", "aus";
}

impl Lang {
    pub fn words(self) -> &'static Words {
        match self {
            Lang::En => &EN,
            Lang::De => &DE,
        }
    }

    /// A text of the configuration in this language. It comes from outside: cleaned.
    pub fn pick(self, text: &Text, letters: usize) -> String {
        match self {
            Lang::En => clean_configured(&text.en, letters),
            Lang::De => clean_configured(&text.de, letters),
        }
    }

    pub fn state(self, state: State) -> &'static str {
        let words = self.words();
        match state {
            State::Ok => words.ok,
            State::Warning => words.warning,
            State::Error => words.error,
            State::Ignore => words.ignore,
            State::Unknown => words.unknown,
        }
    }

    /// The stage in plain words. A vehicle that cannot be cleared is not "ready".
    pub fn stage(self, stage: Stage, ready: bool) -> &'static str {
        let words = self.words();
        match stage {
            Stage::Locked => words.locked,
            Stage::Localizing => words.localizing,
            Stage::Standby if ready => words.ready,
            Stage::Standby => words.not_ready,
            Stage::Cleared => words.cleared,
            Stage::Active => words.driving,
        }
    }

    /// The stage of a snapshot. A machine without stages is running.
    pub fn stage_of(self, snapshot: &Snapshot) -> &'static str {
        match snapshot.has_stages() {
            true => self.stage(snapshot.stage, snapshot.clearance_refusals.is_empty()),
            false => self.runs(snapshot),
        }
    }

    /// What a machine without stages does. As long as nothing was heard of it, nothing is known.
    pub fn runs(self, snapshot: &Snapshot) -> &'static str {
        let mut modules = snapshot.module_ids().map(|id| snapshot.module(id));
        let heard = modules.any(|(info, module)| {
            let of_machine = !snapshot.group(info.group).0.is_system;
            of_machine && module.received.is_some()
        });
        if heard { self.steps().runs } else { self.steps().no_data }
    }

    /// `3/3 OK`.
    pub fn ok_of(self, ok: u32, counted: u32) -> String {
        format!("{ok}/{counted} {}", self.words().ok)
    }

    /// `Waiting for Localization`.
    pub fn waits_for(self, name: &str) -> String {
        format!("{} {name}", self.words().waiting)
    }

    /// Why a node is not relevant: `not driving`. A signal is called as the configuration says.
    pub fn not_relevant(self, because: &NotRelevant, layout: &Layout) -> String {
        let words = self.words();
        let fixed = match because {
            NotRelevant::Stage(Stage::Locked) => words.not_locked,
            NotRelevant::Stage(Stage::Localizing) => words.not_localized,
            NotRelevant::Stage(Stage::Standby) => words.not_driving,
            NotRelevant::Stage(Stage::Cleared) => words.not_driving_yet,
            NotRelevant::Stage(Stage::Active) => words.not_while_driving,
            NotRelevant::Signal { name, value: false } if &**name == ACTIVE_SIGNAL => words.not_driving,
            NotRelevant::Signal { name, value: true } if &**name == ACTIVE_SIGNAL => words.not_while_driving,
            NotRelevant::Signal { name, value: false } if &**name == POSED_SIGNAL => self.steps().no_pose,
            NotRelevant::Signal { name, value } => {
                let title = layout.signal_titles.iter().find(|(of, _)| of == name);
                if let Some((_, title)) = title {
                    let title = self.pick(title, NAME);
                    return match (self, value) {
                        (_, true) => title,
                        (Lang::En, false) => format!("not {title}"),
                        (Lang::De, false) => format!("nicht {title}"),
                    };
                }
                let name = clean(name, NAME);
                return match (self, value) {
                    (Lang::En, true) => format!("{name} is on"),
                    (Lang::En, false) => format!("{name} is off"),
                    (Lang::De, true) => format!("{name} ist an"),
                    (Lang::De, false) => format!("{name} ist aus"),
                };
            }
        };
        fixed.to_owned()
    }

    /// `4 parts wait`: components that a root cause masks, or modules where no whole component is masked.
    pub fn parts_wait(self, count: usize) -> String {
        match (self, count) {
            (Lang::En, 1) => "1 part waits".to_owned(),
            (Lang::En, _) => format!("{count} parts wait"),
            (Lang::De, 1) => "1 Teil wartet".to_owned(),
            (Lang::De, _) => format!("{count} Teile warten"),
        }
    }

    /// `2 faults of its own`: behind a component that waits.
    pub fn own_faults(self, count: usize) -> String {
        match (self, count) {
            (Lang::En, 1) => "1 fault of its own".to_owned(),
            (Lang::En, _) => format!("{count} faults of its own"),
            (Lang::De, 1) => "1 eigene Störung".to_owned(),
            (Lang::De, _) => format!("{count} eigene Störungen"),
        }
    }

    /// `All 8 components OK`, or `All 6 active components OK` where others are not active.
    pub fn all_ok(self, count: usize, all: bool) -> String {
        match (self, count, all) {
            (Lang::En, 1, true) => "The component is OK".to_owned(),
            (Lang::En, 1, false) => "The active component is OK".to_owned(),
            (Lang::En, 2, true) => "Both components OK".to_owned(),
            (Lang::En, 2, false) => "Both active components OK".to_owned(),
            (Lang::En, _, true) => format!("All {count} components OK"),
            (Lang::En, _, false) => format!("All {count} active components OK"),
            (Lang::De, 1, true) => "Die Komponente ist OK".to_owned(),
            (Lang::De, 1, false) => "Die aktive Komponente ist OK".to_owned(),
            (Lang::De, 2, true) => "Beide Komponenten OK".to_owned(),
            (Lang::De, 2, false) => "Beide aktiven Komponenten OK".to_owned(),
            (Lang::De, _, true) => format!("Alle {count} Komponenten OK"),
            (Lang::De, _, false) => format!("Alle {count} aktiven Komponenten OK"),
        }
    }

    /// `and 3 more`.
    pub fn and_more(self, count: usize) -> String {
        match self {
            Lang::En => format!("and {count} more"),
            Lang::De if count == 1 => "und 1 weitere".to_owned(),
            Lang::De => format!("und {count} weitere"),
        }
    }

    /// `5 × Unknown`: modules of one component.
    pub fn times(self, count: usize, state: State) -> String {
        format!("{count} × {}", self.state(state))
    }

    /// `Mission not reporting`: the fault of a component that is silent.
    pub fn not_reporting(self, name: &str) -> String {
        match self {
            Lang::En => format!("{name} not reporting"),
            Lang::De => format!("{name} ohne Meldung"),
        }
    }

    /// `State unknown: Mission`: the fault of a component that reports that it does not know.
    pub fn state_unknown(self, name: &str) -> String {
        match self {
            Lang::En => format!("State unknown: {name}"),
            Lang::De => format!("Zustand unbekannt: {name}"),
        }
    }

    /// Another operator has the vehicle: the question above the button `take_place`.
    pub fn login_other_operator(self, by: &str) -> String {
        match self {
            Lang::En => format!("{by} is the operator. Take their place?"),
            Lang::De => format!("{by} ist im Dienst. Ablösen?"),
        }
    }

    /// The button that makes the reader the operator. To take over is to steer.
    pub fn take_place(self, of: &str) -> String {
        match self {
            Lang::En => format!("Take the place of {of}"),
            Lang::De => format!("{of} ablösen"),
        }
    }

    /// Above the login of another operator at the display of the present one.
    pub fn login_change(self, from: &str) -> String {
        match self {
            Lang::En => format!("{from} is the operator. Who takes their place?"),
            Lang::De => format!("{from} ist im Dienst. Wer löst ab?"),
        }
    }

    /// The notice on every page while a hand-over is due.
    pub fn hand_over(self, to: &str) -> String {
        let to = clean(to, NAME);
        match self {
            Lang::En => format!("{to} takes your place in 5 s. Until then both of you can stop the vehicle."),
            Lang::De => format!("{to} löst Sie in 5 s ab. Bis dahin können beide das Fahrzeug anhalten."),
        }
    }

    pub fn login_wait(self, seconds: u64) -> String {
        match self {
            Lang::En => format!("Too many tries. Wait {seconds} s."),
            Lang::De => format!("Zu viele Versuche. {seconds} s warten."),
        }
    }

    /// What a monitor's measured value is called, and its unit.
    pub fn measured(self, key: &str) -> (&str, &'static str) {
        let (en, de, unit) = match key {
            "rate_hz" => ("rate", "Rate", "Hz"),
            "input_hz" => ("inputs", "Eingaben", "Hz"),
            "output_hz" => ("outputs", "Ausgaben", "Hz"),
            "ratio" => ("ratio", "Verhältnis", ""),
            "latency_s" => ("late", "Verspätung", "s"),
            "value" => ("value", "Wert", ""),
            "difference" => ("difference", "Abweichung", ""),
            "earlier" => ("earlier", "früher", ""),
            "later" => ("later", "später", ""),
            "translation_m" => ("shift", "Verschiebung", "m"),
            "rotation_deg" => ("rotation", "Drehung", "°"),
            "count_difference" => ("difference in number", "Abweichung der Anzahl", ""),
            "nearest_m" => ("apart", "Abstand", "m"),
            "answer_ms" => ("answer", "Antwort", "ms"),
            "misses" => ("misses", "ohne Antwort", ""),
            other => (other, other, ""),
        };
        match self {
            Lang::En => (en, unit),
            Lang::De => (de, unit),
        }
    }

    /// A number as people read it: times `factor`, with few digits, with the decimal separator of the language
    /// and with its unit. A number that is followed by a unit keeps that, and any other text stays.
    pub fn quantity(self, text: &str, factor: f64, unit: &str) -> String {
        let (first, rest) = text.split_once(' ').unwrap_or((text, unit));
        let decimal = |it: char| it.is_ascii_digit() || matches!(it, '.' | '-');
        let value = first.parse::<f64>().ok().filter(|_| first.chars().all(decimal));
        let Some(value) = value.filter(|_| !rest.contains(|it: char| it.is_ascii_digit())) else {
            return text.to_owned();
        };
        let digits = first.trim_start_matches(['-', '0', '.']).chars().filter(char::is_ascii_digit).count();
        // A whole number, as a count, is exact.
        let exact = factor == 1.0 && (digits <= 3 || !first.contains('.'));
        let number = if exact { first.to_owned() } else { number(value * factor) };
        let number = if self == Lang::De { number.replace('.', ",") } else { number };
        if rest.is_empty() { number } else { format!("{number} {rest}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_have_their_units() {
        for (text, factor, unit, en, de) in [
            ("0.17", 100.0, "%", "17 %", "17 %"),
            ("0.1746", 100.0, "%", "17.5 %", "17,5 %"),
            ("4.9", 1.0, "m/s", "4.9 m/s", "4,9 m/s"),
            ("25.6342 V", 1.0, "", "25.6 V", "25,6 V"),
            ("0.123456", 1.0, "", "0.123", "0,123"),
            ("-12.3456", 1.0, "", "-12.3", "-12,3"),
            ("1234567", 1.0, "", "1234567", "1234567"),
            ("10.77.0.1", 1.0, "", "10.77.0.1", "10.77.0.1"),
            ("2.5 of 3.5", 1.0, "", "2.5 of 3.5", "2.5 of 3.5"),
            ("not a number", 1.0, "m/s", "not a number", "not a number"),
            ("high", 1.0, "", "high", "high"),
        ] {
            let said = Lang::ALL.map(|lang| lang.quantity(text, factor, unit));
            assert!(said.contains(&en.to_owned()) && said.contains(&de.to_owned()), "{text}: {said:?}");
            assert_eq!(Lang::De.quantity(text, factor, unit), de);
        }
    }

    /// Words that are the same in both languages, on purpose.
    const SAME: &[&str] = &["ok", "name", "demo", "live"];

    #[test]
    fn every_word_is_said_in_both_languages() {
        for (key, en, de) in ALL {
            assert!(!en.trim().is_empty() && !de.trim().is_empty(), "{key}");
            assert!(en != de || SAME.contains(key), "{key}: {en}");
        }
    }

    #[test]
    fn every_state_and_stage_has_a_word_of_its_own() {
        for lang in Lang::ALL {
            let mut states: Vec<_> = State::ALL.map(|state| lang.state(state)).to_vec();
            states.sort_unstable();
            states.dedup();
            assert_eq!(states.len(), State::ALL.len());
            let mut stages: Vec<_> = Stage::ALL.map(|stage| lang.stage(stage, true)).to_vec();
            stages.sort_unstable();
            stages.dedup();
            assert_eq!(stages.len(), Stage::ALL.len());
        }
    }

    #[test]
    fn counts_agree_with_their_words() {
        assert_eq!(Lang::En.parts_wait(1), "1 part waits");
        assert_eq!(Lang::De.parts_wait(4), "4 Teile warten");
        assert_eq!(Lang::De.own_faults(1), "1 eigene Störung");
        assert_eq!(Lang::De.own_faults(3), "3 eigene Störungen");
        assert_eq!(Lang::En.own_faults(1), "1 fault of its own");
        assert_eq!(Lang::En.all_ok(7, false), "All 7 active components OK");
        assert_eq!(Lang::En.all_ok(2, false), "Both active components OK");
        assert_eq!(Lang::De.all_ok(1, false), "Die aktive Komponente ist OK");
        assert_eq!(Lang::De.all_ok(8, true), "Alle 8 Komponenten OK");
    }
}
