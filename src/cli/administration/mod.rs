//! Commands for who looks after a vehicle: its data folder, users, audit log and certificate.

pub mod audit;
pub mod data;
pub mod tls;
pub mod user;
