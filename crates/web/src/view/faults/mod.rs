//! The faults on the operator's page: the instruction on the most urgent one, and the list.

pub mod entries;
pub(super) mod instruction;
pub mod last_alarms;
pub mod list;
mod undeclared_statuses;
