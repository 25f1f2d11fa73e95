//! What stands between a connection and a page: who may use a route, how an answer looks, what an error says.

pub(super) mod errors;
pub(super) mod guard;
pub(super) mod headers;
pub(super) mod origins;
pub(super) mod plain_errors;
pub(super) mod respond;
