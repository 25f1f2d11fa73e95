//! Faults of the disk, the database and the clock, and their repair.

pub(super) mod clock_floor;
pub(super) mod exposed;
pub(super) mod health;
pub(super) mod repair;
pub(super) mod salvage;
pub(super) mod stall;
