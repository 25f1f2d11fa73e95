//! Everything that the server writes to the disk: the audit log, records that the disk refused earlier, and
//! the vehicle's state for a restart.

pub(super) mod audit;
pub(super) mod outbox;
pub(super) mod vehicle_memory;
pub(super) mod write;
