//! Whether a vehicle is heard, and where it stands among all: judged from when its last head came, by the console's own
//! clock, and from the console's line to the hub.

use schemars::JsonSchema;
use serde::Serialize;
use telltale_engine::state::State;
use telltale_engine::time::{Since, Span, Timestamp};

/// A vehicle tells its head every 15 s; two that are missed make it late, and four lost.
pub const LATE_AFTER: Span = Span::from_secs(35);
pub const LOST_AFTER: Span = Span::from_secs(65);

/// Vehicles wait up to two minutes before they try to reach a hub again, and tell their head within 15 s then.
pub const BACK_WITHIN: Span = Span::from_secs(150);

telltale_engine::words! {
    /// Whether a vehicle is heard.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum Contact {
        Live = "live",
        /// Two heads are missing, or the hub came back and this vehicle did not yet.
        Late = "late",
        Lost = "lost",
        /// It said goodbye.
        Off = "off",
        /// The console does not reach the hub, so it knows of no vehicle what it does now.
        HubDown = "hub_down",
    }
}

/// The console's own line to the hub.
#[derive(Debug, Clone)]
pub struct Line {
    /// Since when the hub is reached.
    pub up_since: Option<Timestamp>,
    /// When the hub was reached last before the present line, or before now without one.
    pub last_up: Since,
    /// Why it is not reached.
    pub why: String,
}

impl Line {
    pub fn contact(&self, heard: Since, has_left: bool, now: Timestamp) -> Contact {
        let Some(up_since) = self.up_since else { return Contact::HubDown };
        let age = heard.age(now);
        match () {
            () if has_left => Contact::Off,
            () if age <= LATE_AFTER => Contact::Live,
            () if age <= LOST_AFTER => Contact::Late,
            // It was there when the hub went away, and has not had the time to come back.
            () if age > now.since(up_since)
                && now.since(up_since) <= BACK_WITHIN
                && age - self.last_up.age(now) <= LOST_AFTER =>
            {
                Contact::Late
            }
            () => Contact::Lost,
        }
    }
}

/// The order of vehicles: who needs somebody first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Urgency {
    LostDriving,
    Error,
    Unacknowledged,
    Warning,
    Lost,
    Late,
    NeverHeard,
    Ok,
    Off,
}

/// What an urgency follows from.
#[derive(Debug, Clone, Copy)]
pub struct Judged {
    pub contact: Contact,
    pub state: State,
    pub drives: bool,
    pub unacknowledged: bool,
}

impl Judged {
    pub fn urgency(self) -> Urgency {
        match (self.contact, self.state) {
            (Contact::Lost | Contact::Off, _) if self.drives => Urgency::LostDriving,
            (Contact::Off, _) => Urgency::Off,
            (_, State::Error) => Urgency::Error,
            _ if self.unacknowledged => Urgency::Unacknowledged,
            (_, State::Warning | State::Unknown) => Urgency::Warning,
            (Contact::Lost | Contact::HubDown, _) => Urgency::Lost,
            (Contact::Late, _) => Urgency::Late,
            (Contact::Live, State::Ok | State::Ignore) => Urgency::Ok,
        }
    }
}

/// How many vehicles there are of each kind; each is counted once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Counts {
    pub error: usize,
    pub warning: usize,
    pub ok: usize,
    /// Late, lost, or the hub is away: what they do now is not known.
    pub lost: usize,
    pub never_heard: usize,
    /// Said goodbye, or nothing of it is judged, as of a shuttle that is locked.
    pub off: usize,
}

impl Counts {
    pub fn add(&mut self, contact: Contact, state: State, urgency: Urgency) {
        let count = match (contact, state) {
            _ if urgency == Urgency::NeverHeard => &mut self.never_heard,
            (Contact::Off, _) if urgency == Urgency::Off => &mut self.off,
            (Contact::Off | Contact::Lost | Contact::HubDown, _) => &mut self.lost,
            (_, State::Error) => &mut self.error,
            (_, State::Warning | State::Unknown) => &mut self.warning,
            (Contact::Late, _) => &mut self.lost,
            (Contact::Live, State::Ignore) => &mut self.off,
            (Contact::Live, State::Ok) => &mut self.ok,
        };
        *count += 1;
    }
}
