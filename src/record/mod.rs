//! The black box: the last minutes of everything that the engine took, and incidents on the disk.

pub mod feed;
pub mod incident;
pub mod ring;
pub mod summary;
