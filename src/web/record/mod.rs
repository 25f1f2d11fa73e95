//! What is written down: the audit log, what the disk did not take yet, the vehicle as it is after a restart.

pub(super) mod audit;
pub(super) mod outbox;
pub(super) mod vehicle_memory;
pub(super) mod write;
