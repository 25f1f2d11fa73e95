//! Commands for the administration of a vehicle: its data folder, users, audit log and certificate.

pub mod audit;
pub mod data;
pub mod tls;
pub mod user;
