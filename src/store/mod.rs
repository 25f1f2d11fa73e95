//! What outlives a restart: users and their sessions, in SQLite, behind a thread of its own.

mod role;

pub use role::Role;
