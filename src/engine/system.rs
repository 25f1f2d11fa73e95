//! The group `telltale`: what the diagnosis says of itself (`ENGINE.md` 6 and 8). Nothing masks it.

use super::input::ReceptionTrouble;
use super::model::{Policy, Text};
use super::monitor::say;
use super::state::State;
use super::time::{Span, Timestamp};

/// The name of the group, reserved in configurations.
pub const SYSTEM_GROUP: &str = "telltale";

/// The name of the group of statuses that nothing claims, reserved in configurations.
pub const OTHER_GROUP: &str = "other";

/// A fault of the reception stays a WARNING for this long after its last appearance.
const RECEPTION_HOLD: Span = Span::from_secs(10);

/// One thing that the diagnosis checks of itself; a module of the group `telltale`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SystemCheck {
    /// The invariants of masking hold.
    Invariants,
    /// Messages arrive whole and as the configuration says.
    Reception,
    /// Somebody says whether the vehicle drives.
    Active,
    /// The vehicle confirms what is asked of it.
    Countermeasure,
    /// What the vehicle is to know can be sent.
    Outputs,
    /// What must be kept can be written down.
    Storage,
    /// The operator's display shows what is.
    Display,
}

impl SystemCheck {
    pub const ALL: [SystemCheck; 7] = [
        SystemCheck::Invariants,
        SystemCheck::Reception,
        SystemCheck::Active,
        SystemCheck::Countermeasure,
        SystemCheck::Outputs,
        SystemCheck::Storage,
        SystemCheck::Display,
    ];

    pub(super) fn id(self) -> &'static str {
        match self {
            SystemCheck::Invariants => "telltale/invariants",
            SystemCheck::Reception => "telltale/reception",
            SystemCheck::Active => "telltale/active",
            SystemCheck::Countermeasure => "telltale/countermeasure",
            SystemCheck::Outputs => "telltale/outputs",
            SystemCheck::Storage => "telltale/storage",
            SystemCheck::Display => "telltale/display",
        }
    }

    pub(super) fn name(self) -> Text {
        let (en, de) = match self {
            SystemCheck::Invariants => ("Display contradicts itself", "Anzeige widerspricht sich"),
            SystemCheck::Reception => ("Messages cannot be read", "Meldungen sind nicht lesbar"),
            SystemCheck::Active => ("Driving state unknown", "Fahrzustand unbekannt"),
            SystemCheck::Countermeasure => {
                ("Vehicle does not react as asked", "Fahrzeug reagiert nicht wie verlangt")
            }
            SystemCheck::Outputs => ("Vehicle cannot be told", "Fahrzeug ist nicht erreichbar"),
            SystemCheck::Storage => ("Nothing can be recorded", "Aufzeichnen nicht möglich"),
            SystemCheck::Display => ("Display not live", "Anzeige nicht live"),
        };
        Text { en: en.into(), de: de.into() }
    }

    pub(super) fn help(self) -> Text {
        let (en, de) = match self {
            SystemCheck::Invariants => (
                "Do not rely on this display. Call the control room.",
                "Nicht auf diese Anzeige verlassen. Leitstelle rufen.",
            ),
            SystemCheck::Reception => ("You may drive. Report it.", "Weiterfahren möglich. Melden."),
            SystemCheck::Active | SystemCheck::Countermeasure => {
                ("Take over. Stop. Call the control room.", "Übernehmen. Anhalten. Leitstelle rufen.")
            }
            SystemCheck::Outputs => (
                "Be ready to take over. Call the control room.",
                "Zur Übernahme bereit sein. Leitstelle rufen.",
            ),
            SystemCheck::Storage => (
                "Finish the drive. No new clearance until it is mended. Report it.",
                "Fahrt beenden. Bis zur Behebung keine neue Freigabe. Melden.",
            ),
            SystemCheck::Display => (
                "Do not rely on it. Be ready to take over.",
                "Nicht darauf verlassen. Zur Übernahme bereit sein.",
            ),
        };
        Text { en: en.into(), de: de.into() }
    }
}

/// What is said of a display that does not answer.
pub(super) fn display_late(whose: &str) -> Text {
    say!(
        "the display of {whose} does not say what it shows",
        "die Anzeige von {whose} meldet nicht, was sie zeigt",
        whose = whose
    )
}

/// System modules are told what they are; they never fall silent.
pub(super) fn policy() -> Policy {
    Policy { timeout: Span::from_nanos(u64::MAX), ..Policy::default() }
}

/// Faults of the reception, while they are fresh.
#[derive(Debug, Default)]
pub(super) struct ReceptionCheck {
    last: Option<Timestamp>,
    pub(super) message: String,
}

impl ReceptionCheck {
    pub(super) fn take(&mut self, trouble: &ReceptionTrouble, now: Timestamp) {
        self.last = Some(now);
        self.message = format!("{}: {}", trouble.topic, trouble.text);
    }

    pub(super) fn state(&mut self, now: Timestamp) -> State {
        if self.due().is_some_and(|due| now >= due) {
            self.last = None;
            self.message.clear();
        }
        if self.last.is_some() { State::Warning } else { State::Ok }
    }

    pub(super) fn due(&self) -> Option<Timestamp> {
        self.last.map(|last| last + RECEPTION_HOLD)
    }
}
