//! Commands that read, write and try configurations.

pub mod check;
pub mod diff;
mod graph;
pub mod import;
pub mod init;
pub mod scenario;
