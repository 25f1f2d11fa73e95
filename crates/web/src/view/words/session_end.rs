//! The texts of ended sessions, for the login page.

use std::net::IpAddr;

use super::Lang;

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

impl Lang {
    /// That the session of a page is used from another address, too.
    pub fn elsewhere(self, address: IpAddr) -> String {
        match self {
            Lang::En => format!(
                "Your login is also used from {address}. If that is not you, log out and have your secret changed."
            ),
            Lang::De => format!(
                "Ihre Anmeldung wird auch von {address} aus benutzt. Wenn Sie das nicht sind, melden Sie sich ab und \
                 lassen Sie Ihr Zugangsgeheimnis ändern."
            ),
        }
    }

    /// Why the login page is shown again.
    pub fn session_end(self, why: SessionEnd) -> &'static str {
        let (en, de) = match why {
            SessionEnd::Expired => (
                "Your login is over after 12 hours. Log in again.",
                "Ihre Anmeldung ist nach 12 Stunden abgelaufen. Neu anmelden.",
            ),
            SessionEnd::Idle => {
                ("Logged out: nothing was done for 15 minutes.", "Abgemeldet: 15 Minuten lang nichts getan.")
            }
            SessionEnd::TakenOver => {
                ("Another operator has taken your place.", "Jemand anderes hat Sie abgelöst.")
            }
            SessionEnd::LoggedOut => {
                ("You logged out at another display.", "Sie haben sich an einer anderen Anzeige abgemeldet.")
            }
            SessionEnd::Removed => (
                "This user was removed. Call the control room.",
                "Dieser Benutzer wurde entfernt. Leitstelle rufen.",
            ),
            SessionEnd::LoggedOutHere => ("Logged out.", "Abgemeldet."),
            SessionEnd::Ended => {
                ("Your login has ended. Log in again.", "Ihre Anmeldung wurde beendet. Neu anmelden.")
            }
        };
        match self {
            Lang::En => en,
            Lang::De => de,
        }
    }
}
