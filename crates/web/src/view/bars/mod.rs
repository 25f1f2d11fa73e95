//! The bars of the operator's page: the motion, the vehicle and its stage, the next step.

pub mod action_bar;
mod clearance_checks;
pub mod motion;
pub mod top_bar;
