//! The HTTP server from outside: the router without a socket, and sockets on a free port.

// Helpers of tests are outside of tests for clippy.
#![allow(clippy::unwrap_used)]

mod access;
mod connections;
mod developer;
mod disk;
mod fixture;
#[path = "../../../../tests/it/folder.rs"]
mod folder;
mod logins;
mod programs;
mod recordings;
#[path = "../../../../tests/it/schemas.rs"]
mod schemas;
mod stops;
mod vehicle;
