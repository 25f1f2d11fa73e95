//! Commands that show what was: the history, incidents, and recordings through the engine again.

pub mod history;
pub mod incident;
pub mod learn;
pub mod replay;
