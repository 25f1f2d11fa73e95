//! Reactions to a fault: alarms, warnings to accept, countermeasures and their confirmation (`ENGINE.md` 6,
//! 9 and 10).

pub(super) mod alarms;
pub(super) mod calls;
pub(super) mod confirmation;
pub(super) mod held;
pub(super) mod unheard_requests;
pub(super) mod warnings;
