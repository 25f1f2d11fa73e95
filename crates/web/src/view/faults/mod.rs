//! The faults on the operator's page: the instruction on the most urgent one, and the list.

pub mod entries;
pub mod instruction;
pub mod list;
mod undeclared_statuses;
