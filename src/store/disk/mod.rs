//! What may be wrong with the disk, the database or the clock, and how it is mended.

pub(super) mod clock_floor;
pub(super) mod exposed;
pub(super) mod health;
pub(super) mod repair;
pub(super) mod salvage;
pub(super) mod stall;
