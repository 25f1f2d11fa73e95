//! The list of faults on the operator's page.

pub mod entries;
pub mod list;
mod undeclared_statuses;
