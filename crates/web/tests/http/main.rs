//! The HTTP server from outside: the router without a socket, and sockets on a free port.

// Helpers of tests are outside of tests for clippy.
#![allow(clippy::unwrap_used)]

mod access;
mod api;
mod attacks;
mod audit;
mod bounds;
mod damaged_database;
mod developer;
mod durable;
mod expired_sessions;
mod fixture;
#[path = "../../../../tests/it/folder.rs"]
mod folder;
mod incidents;
mod late_actions;
mod login;
mod login_policy;
mod replay;
#[path = "../../../../tests/it/schemas.rs"]
mod schemas;
mod services;
mod snapshot_json;
mod sockets;
mod stops;
mod streams;
mod trusted_recordings;
mod vehicle;
