//! The group `telltale` with Telltale's own modules. Nothing masks it.

use crate::input::{ReceptionTrouble, TroubleKind};
use crate::model::wording::{Advice, ByStage, Urgency, Wording};
use crate::model::{Limits, Policy, Stage};
use crate::state::State;
use crate::text::{Text, say, words};
use crate::time::{Span, Timestamp};
use serde::{Deserialize, Serialize};

/// The name of the group, reserved in configurations.
pub const SYSTEM_GROUP: &str = "telltale";

/// The name of the group of unclaimed statuses, reserved in configurations.
pub const OTHER_GROUP: &str = "other";

/// The built-in groups: the path, and the names in English and German.
pub const BUILT_IN_GROUPS: [(&str, &str, &str); 2] =
    [(OTHER_GROUP, "Other", "Sonstige"), (SYSTEM_GROUP, "Telltale", "Telltale")];

/// A fault of the reception stays a WARNING for this long after its last appearance.
const RECEPTION_HOLD: Span = Span::from_secs(10);

words! {
    /// A check of Telltale itself; a module of the group `telltale`. Its word is its path.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum SystemCheck {
        /// The invariants of masking hold.
        Invariants = "telltale/invariants",
        /// Messages arrive completely and with the configured types.
        Reception = "telltale/reception",
        /// A component reports whether the vehicle drives.
        Active = "telltale/active",
        /// The vehicle confirms the requests.
        Countermeasure = "telltale/countermeasure",
        /// All outputs to the vehicle can be sent, and nobody else sends them.
        Outputs = "telltale/outputs",
        /// The disk can store records.
        Storage = "telltale/storage",
        /// The operator's display shows the present state.
        Display = "telltale/display",
        /// No other program publishes the aggregated diagnosis.
        Aggregator = "telltale/aggregator",
        /// The DDS process runs.
        Dds = "telltale/dds",
        /// The texts of statuses fit into memory.
        Memory = "telltale/memory",
        /// No two writers contradict each other, and no writer reports a status for which it is not admitted.
        Writers = "telltale/writers",
        /// The wall clock is right.
        Clock = "telltale/clock",
        /// Browsers accept the certificate, and will for some time.
        Certificate = "telltale/certificate",
        /// Incidents can be recorded, with as much of the past as they need.
        Recording = "telltale/recording",
        /// No two nodes have one name.
        Nodes = "telltale/nodes",
        /// The fleet hears of this vehicle, if it belongs to one.
        Fleet = "telltale/fleet",
    }
}

impl SystemCheck {
    pub(crate) fn name(self) -> Text {
        let (en, de) = match self {
            SystemCheck::Invariants => ("Display contradicts itself", "Anzeige widerspricht sich"),
            SystemCheck::Reception => ("Messages get lost", "Meldungen gehen verloren"),
            SystemCheck::Active => ("Driving state unknown", "Fahrzustand unbekannt"),
            SystemCheck::Countermeasure => {
                ("Vehicle does not react as asked", "Fahrzeug reagiert nicht wie verlangt")
            }
            SystemCheck::Outputs => ("Vehicle cannot be told", "Fahrzeug ist nicht erreichbar"),
            SystemCheck::Storage => ("Nothing can be recorded", "Aufzeichnen nicht möglich"),
            SystemCheck::Display => ("Display not live", "Anzeige nicht live"),
            SystemCheck::Aggregator => {
                ("Diagnosis is published twice", "Diagnose wird doppelt veröffentlicht")
            }
            SystemCheck::Dds => ("Nothing is heard of the vehicle", "Vom Fahrzeug kommt nichts an"),
            SystemCheck::Memory => ("Messages are shortened", "Meldungen sind gekürzt"),
            SystemCheck::Writers => ("Senders contradict each other", "Sender widersprechen sich"),
            SystemCheck::Clock => ("Clock is wrong", "Uhr geht falsch"),
            SystemCheck::Certificate => ("Certificate has to be renewed", "Zertifikat muss erneuert werden"),
            SystemCheck::Nodes => ("Node runs twice", "Node läuft doppelt"),
            SystemCheck::Fleet => ("Fleet does not hear this vehicle", "Flotte hört dieses Fahrzeug nicht"),
            SystemCheck::Recording => {
                ("Recordings are missing or too short", "Aufzeichnungen fehlen oder sind zu kurz")
            }
        };
        Text { en: en.into(), de: de.into() }
    }

    /// Advice: while driving, and at a stop, where the operator has nothing to take over.
    pub(crate) fn help(self) -> Wording<Advice> {
        let urgency = match self {
            SystemCheck::Active | SystemCheck::Countermeasure | SystemCheck::Dds => Some(Urgency::TakeOver),
            SystemCheck::Outputs | SystemCheck::Display => Some(Urgency::BeReady),
            _ => None,
        };
        let advice =
            |en: &str, de: &str, urgency| Advice { text: Text { en: en.into(), de: de.into() }, urgency };
        let always = |en: &str, de: &str| ByStage::Always(advice(en, de, None));
        let driving = |en: &str, de: &str, (stop_en, stop_de): (&str, &str)| {
            let standing = advice(stop_en, stop_de, None);
            ByStage::In(vec![(Stage::Standby, standing), (Stage::Active, advice(en, de, urgency))])
        };
        const STAY: (&str, &str) =
            ("Do not drive off. Call the control room.", "Nicht losfahren. Leitstelle rufen.");
        let mut help = Wording::default();
        match self {
            SystemCheck::Invariants => {
                help.error = always(
                    "Do not rely on this display. Call the control room.",
                    "Nicht auf diese Anzeige verlassen. Leitstelle rufen.",
                );
            }
            SystemCheck::Reception
            | SystemCheck::Aggregator
            | SystemCheck::Writers
            | SystemCheck::Memory
            | SystemCheck::Clock
            | SystemCheck::Certificate
            | SystemCheck::Recording
            | SystemCheck::Nodes => {
                help.warning = driving(
                    "It may go on. Report it.",
                    "Weiterfahren möglich. Melden.",
                    ("Report it.", "Melden."),
                );
            }
            SystemCheck::Fleet => {
                let report = driving(
                    "It may go on. Report it.",
                    "Weiterfahren möglich. Melden.",
                    ("Report it.", "Melden."),
                );
                help.warning = report.clone();
                help.error = report;
            }
            SystemCheck::Active | SystemCheck::Countermeasure | SystemCheck::Dds => {
                let (en, de) =
                    ("Take over. Stop. Call the control room.", "Übernehmen. Anhalten. Leitstelle rufen.");
                help.error = driving(en, de, STAY);
            }
            SystemCheck::Outputs => {
                let (en, de) = (
                    "Be ready to take over. Call the control room.",
                    "Zum Übernehmen bereithalten. Leitstelle rufen.",
                );
                help.error = driving(en, de, STAY);
                help.warning = driving(en, de, STAY);
            }
            SystemCheck::Storage => {
                help.warning = driving(
                    "Finish the drive. No new clearance until it is mended. Report it.",
                    "Fahrt beenden. Bis zur Behebung keine neue Freigabe. Melden.",
                    (
                        "No clearance until it is mended. Report it.",
                        "Bis zur Behebung keine Freigabe. Melden.",
                    ),
                );
            }
            SystemCheck::Display => {
                help.warning = driving(
                    "Do not rely on it. Be ready to take over.",
                    "Nicht darauf verlassen. Zum Übernehmen bereithalten.",
                    (
                        "Do not rely on it. Use this display.",
                        "Nicht darauf verlassen. Diese Anzeige benutzen.",
                    ),
                );
            }
        }
        help
    }
}

/// The message about a display that does not answer.
pub(crate) fn display_late(whose: &str) -> Text {
    say!(
        "the display of {whose} is frozen or does not answer",
        "die Anzeige von {whose} ist eingefroren oder antwortet nicht",
        whose
    )
}

/// The message while texts of statuses are cut.
pub(crate) fn words_cut(limits: &Limits) -> Text {
    say!(
        "statuses say more than is kept: limits.status_bytes is {all}, limits.source_bytes {one}; the longest are cut, their states hold",
        "Meldungen sind länger, als behalten wird: limits.status_bytes ist {all}, limits.source_bytes {one}; die längsten sind gekürzt, ihre Zustände gelten",
        all = limits.status_bytes,
        one = limits.source_bytes
    )
}

/// The message while another program publishes the aggregated diagnosis.
pub(crate) fn other_aggregator(other: &str) -> Text {
    say!(
        "another program publishes the diagnosis: {other}",
        "ein anderes Programm veröffentlicht die Diagnose: {other}",
        other
    )
}

/// The message while another program tells the vehicle what Telltale tells it.
pub(crate) fn other_voices(other: &str) -> Text {
    say!(
        "another program tells the vehicle what Telltale tells it, and may release it: {other}; end that program, or give it another ROS_DOMAIN_ID",
        "ein anderes Programm sagt dem Fahrzeug, was Telltale ihm sagt, und kann es freigeben: {other}; dieses Programm beenden oder ihm eine andere ROS_DOMAIN_ID geben",
        other
    )
}

/// The message while several nodes have one name.
pub(crate) fn repeated_nodes(names: &str) -> Text {
    say!("several nodes have one name: {names}", "mehrere Nodes haben denselben Namen: {names}", names)
}

/// The message while the process of DDS or Zenoh is down; the reason names it.
pub(crate) fn dds_down(reason: &str) -> Text {
    say!(
        "the connection to the vehicle failed and is being restarted: {reason}",
        "die Verbindung zum Fahrzeug ist ausgefallen und wird neu gestartet: {reason}",
        reason
    )
}

/// The engine itself reports these modules; they never fall silent.
pub(crate) fn policy() -> Policy {
    Policy { timeout: Span::from_nanos(u64::MAX), ..Policy::default() }
}

/// Recent faults of the reception.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct ReceptionCheck {
    last: Option<Timestamp>,
    pub(crate) message: Text,
}

impl ReceptionCheck {
    pub(crate) fn take(&mut self, trouble: &ReceptionTrouble, now: Timestamp) {
        self.last = Some(now);
        let german = match trouble.kind {
            TroubleKind::Malformed => "unlesbar",
            TroubleKind::WrongType => "anderer Typ",
            TroubleKind::Lost => "Meldungen fehlen",
        };
        self.message = Text {
            en: format!("{}: {}", trouble.topic, trouble.text).into(),
            de: format!("{}: {german}", trouble.topic).into(),
        };
    }

    pub(crate) fn state(&mut self, now: Timestamp) -> State {
        if self.due().is_some_and(|due| now >= due) {
            self.last = None;
            self.message = Text::default();
        }
        if self.last.is_some() { State::Warning } else { State::Ok }
    }

    pub(crate) fn due(&self) -> Option<Timestamp> {
        self.last.map(|last| last + RECEPTION_HOLD)
    }
}
