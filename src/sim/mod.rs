//! Simulation: scenario files run through the engine in virtual time.

pub mod scenario;
pub mod scenario_file;
mod scenario_raw;
