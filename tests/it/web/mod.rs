//! The HTTP server: the router without a socket, and sockets on a free port.

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
mod incidents;
mod late_actions;
mod learn;
mod login;
mod login_policy;
mod open_replays;
mod replay;
mod services;
mod snapshot_json;
mod sockets;
mod stops;
mod streams;
mod tls;
mod trusted_recordings;
mod vehicle;
mod what_if;
