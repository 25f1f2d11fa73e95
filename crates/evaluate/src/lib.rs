//! A campaign of faults with known truth: how often and how soon a diagnosis names the broken component, how many
//! alarms it raises, and what it hides. Other rules of diagnosis see the same histories.
//!
//! A [`plan`] is drawn from a seed. A [`machine::Machine`] turns it into a [`machine::History`] of inputs, which no rule
//! of diagnosis has changed: the machine does not obey it. `track` runs engines over it, `truth` says which faults
//! were there and when, by runs with each fault alone, and `judge` compares that with what each rule showed. `live` does
//! the same with what a diagnosis showed in real time.

pub mod campaign;
pub mod figures;
mod judge;
pub mod learning;
pub mod live;
pub mod machine;
pub mod plan;
mod random;
pub mod report;
mod rules;
mod statistics;
pub mod track;
mod truth;
mod variant;
