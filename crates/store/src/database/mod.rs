//! The database as a file: its schema, its folder, its daily copies.

pub(super) mod backup;
pub(super) mod files;
pub(super) mod foreign;
pub(super) mod schema;
