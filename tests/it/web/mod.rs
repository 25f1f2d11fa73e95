//! The HTTP server: the router without a socket, and sockets on a free port.

mod access;
mod developer;
mod fixture;
mod login;
mod sockets;
mod vehicle;
mod wire;
