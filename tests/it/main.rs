//! The integration tests, in one binary: it links once.

mod evaluation;
mod hostile;
mod properties;
mod tidy;
