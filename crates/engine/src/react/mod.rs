//! Reactions to a fault: alarms, warnings to accept, countermeasures and their confirmation.

pub(super) mod alarms;
pub(super) mod confirmation;
pub(super) mod held;
pub(super) mod release;
pub mod shelves;
pub(super) mod sounds;
pub(super) mod unheard_requests;
pub(super) mod urgency;
pub(super) mod warnings;
