//! The HTTP server: the router without a socket, and sockets on a free port.

mod access;
mod attacks;
mod audit;
mod bounds;
mod broken;
mod developer;
mod durable;
mod fixture;
mod in_charge;
mod incidents;
mod late;
mod login;
mod overdue;
mod replay;
mod sockets;
mod streams;
mod tls;
mod vehicle;
mod what_if;
mod wire;
