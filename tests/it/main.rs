//! The integration tests, in one binary: it links once.

mod countermeasures;
mod dds;
mod driving;
mod evaluation;
mod fields;
mod held;
mod hostile;
mod peer;
mod properties;
mod start;
mod tidy;
mod web;
