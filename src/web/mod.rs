//! The HTTP server: pages, sessions, the WebSocket and the wire.

pub mod assets;
pub mod frame;
pub mod view;
