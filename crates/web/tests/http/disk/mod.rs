//! The disk: what is stored before it is answered, the audit log, and a damaged database.

mod audit;
mod damaged_database;
mod durable;
