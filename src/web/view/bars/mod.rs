//! The bars of the operator's page: the motion, the vehicle and its stage, the countermeasure, the next step.

pub mod action_bar;
mod clearance_checks;
pub mod countermeasure;
pub mod motion;
pub mod top_bar;
