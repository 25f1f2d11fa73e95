//! The integration tests, in one binary: it links once.

mod hostile;
mod properties;
mod tidy;
