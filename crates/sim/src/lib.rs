//! Simulation: a shuttle and a robot with their faults, and scenario files run through the engine in virtual time.

mod expectation;
pub mod machine;
pub mod robot;
pub mod scenario;
pub mod scenario_file;
mod scenario_operator;
mod scenario_raw;
pub mod scenario_sample;
pub mod shuttle;
pub mod strips;
