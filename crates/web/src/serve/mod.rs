//! The listener: connections, TLS, the end of the server.

pub(super) mod accept;
pub(super) mod tls;
