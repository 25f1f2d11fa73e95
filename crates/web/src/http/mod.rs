//! The common parts of all routes: who may use a route, the form of answers, and errors.

pub(super) mod guard;
pub(super) mod headers;
pub(super) mod origins;
pub(super) mod plain_errors;
pub(super) mod respond;
