//! What the vehicle's side says of itself, and when that is a fault of the vehicle.

use telltale_engine::input::FleetFault;
use telltale_engine::text::Text;
use telltale_engine::time::{Span, Timestamp};

/// A hub that is away for this long is a WARNING. Vehicles drive through dead spots.
pub const AWAY_MAX: Span = Span::from_secs(600);

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Status {
    pub contact: Contact,
    /// Since when a hub that is reached takes nothing.
    pub refuses_since: Option<Timestamp>,
    /// Why the disk does not take messages.
    pub disk: Option<String>,
    /// Wishes of the hub that were not followed: they are none, or there were too many.
    pub dropped_wishes: u64,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Contact {
    Reached {
        since: Timestamp,
    },
    Away {
        since: Timestamp,
        why: String,
    },
    /// The hub does not admit this vehicle.
    Refused {
        since: Timestamp,
    },
    /// Two vehicles have one identity: nothing is told any more.
    TwoVehicles,
}

impl Contact {
    /// Of the same kind, whatever the time and the words.
    pub fn is_like(&self, other: &Contact) -> bool {
        std::mem::discriminant(self) == std::mem::discriminant(other)
    }
}

impl Status {
    /// At the start.
    pub fn new(now: Timestamp) -> Status {
        let contact = Contact::Away { since: now, why: "it was not reached yet".into() };
        Status { contact, refuses_since: None, disk: None, dropped_wishes: 0 }
    }

    /// The fault that the operator has to know of.
    pub fn fault(&self, now: Timestamp) -> Option<FleetFault> {
        let text = |en: String, de: String| Text { en: en.into(), de: de.into() };
        let warning = |text| Some(FleetFault { text, is_error: false });
        match (&self.contact, &self.disk) {
            (Contact::TwoVehicles, _) => Some(FleetFault {
                text: text(
                    "another vehicle tells the fleet by this one's name, or this one lost its outbox: nothing more is told".into(),
                    "ein anderes Fahrzeug meldet sich unter diesem Namen bei der Flotte, oder dieses hat seinen Ausgang verloren: es meldet nichts mehr".into(),
                ),
                is_error: true,
            }),
            (Contact::Refused { .. }, _) => warning(text(
                "the hub of the fleet does not admit this vehicle: enrol it with `telltale fleet enrol`".into(),
                "die Zentrale der Flotte lässt dieses Fahrzeug nicht zu: mit `telltale fleet enrol` anmelden".into(),
            )),
            (_, Some(disk)) => warning(text(
                format!("what the fleet should know is lost: {disk}"),
                format!("was die Flotte wissen soll, geht verloren: {disk}"),
            )),
            (Contact::Away { since, why }, None) if now.since(*since) >= AWAY_MAX => {
                let minutes = AWAY_MAX.as_millis() / 60_000;
                warning(text(
                    format!("the hub of the fleet has not been reached for {minutes} min: {why}"),
                    format!("die Zentrale der Flotte ist seit {minutes} min nicht erreichbar: {why}"),
                ))
            }
            (Contact::Reached { .. }, None) if self.refuses_since.is_some_and(|it| now.since(it) >= AWAY_MAX) => {
                warning(text(
                    "the hub of the fleet takes nothing: it is full, or its streams are missing".into(),
                    "die Zentrale der Flotte nimmt nichts an: sie ist voll, oder ihre Streams fehlen".into(),
                ))
            }
            (Contact::Away { .. } | Contact::Reached { .. }, None) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_double_identity_is_an_error_and_a_dead_spot_is_nothing() {
        let start = Timestamp::from_millis(5_000);
        let mut status = Status::new(start);
        let level = |status: &Status, now| status.fault(now).map(|fault| fault.is_error);
        assert_eq!(level(&status, start + Span::from_secs(599)), None);
        assert_eq!(level(&status, start + AWAY_MAX), Some(false));
        status.contact = Contact::Reached { since: start };
        assert_eq!(level(&status, start + AWAY_MAX), None);
        status.refuses_since = Some(start);
        assert_eq!(level(&status, start + Span::from_secs(599)), None);
        assert_eq!(level(&status, start + AWAY_MAX), Some(false));
        status.disk = Some("full".into());
        assert_eq!(level(&status, start), Some(false));
        status.contact = Contact::TwoVehicles;
        assert_eq!(level(&status, start), Some(true));
    }
}
