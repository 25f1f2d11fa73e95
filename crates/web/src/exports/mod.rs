//! The tables of the developer's pages for programs, as JSON and CSV.

pub mod audit;
pub mod description;
pub mod history;
pub mod statistics;
pub mod statuses;
pub mod topics;
