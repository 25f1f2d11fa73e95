//! The interface for programs, in the order in which a request meets it. `operations` is the table of what a program can
//! call, in words and types (`operation`); `openapi` makes one document of it and of the routes, `page` shows that to people.
//! Then come the handlers that answer programs alone: their parameters are a `query`, their answer a `table`, JSON or CSV.
//! A route that a page calls as well has its handler beside the page: actions in `operator`, the stream in `live`.

pub mod operation;
pub mod operations;

pub mod openapi;
pub mod page;

pub mod query;
pub mod table;

pub mod audit;
pub mod history;
pub mod incidents;
pub mod statistics;
pub mod statuses;
pub mod topics;
pub mod values;

/// The version of the interface. Within it keys and routes are added and never removed.
pub const VERSION: &str = "1";
