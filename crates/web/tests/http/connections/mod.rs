//! Connections: pages and programs on sockets, their bounds, and attacks on them.

mod attacks;
mod bounds;
pub mod sockets;
mod streams;
