//! Commands that read, write and try configurations.

pub mod check;
pub mod diff;
pub mod evaluate;
mod graph;
pub mod import;
pub mod init;
pub mod scenario;
