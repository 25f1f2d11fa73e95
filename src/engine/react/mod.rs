//! What follows from a fault: alarms, warnings to accept, countermeasures and whether the vehicle confirms them (`ENGINE.md` 6, 9 and 10).

pub(super) mod alarms;
pub(super) mod calls;
pub(super) mod confirmation;
pub(super) mod held;
pub(super) mod unheard_requests;
pub(super) mod warnings;
