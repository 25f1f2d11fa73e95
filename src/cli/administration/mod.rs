//! Commands for the administration of a vehicle: its data folder, users, audit log, certificate
//! and fleet.

pub mod audit;
pub mod data;
pub mod fleet;
pub mod tls;
pub mod user;
