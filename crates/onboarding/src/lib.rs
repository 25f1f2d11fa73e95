//! The first configuration of a robot: guessed from a running system, or carried over from another tool's files.

pub mod import;
pub mod init;
pub mod live;
#[cfg(test)]
mod pretend;
pub mod update;
