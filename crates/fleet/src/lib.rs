//! The vehicle's line to a fleet: what it tells, what waits for the hub, how that is delivered, and the history that a
//! console makes of it. Nothing here can reach the engine: what comes from the hub becomes a [`line::Want`], which is
//! a span and numbers, or an end.

mod connection;
pub mod delivery;
pub mod fetching;
mod gate;
pub mod history;
pub mod hub;
pub mod identity;
pub mod line;
pub mod message;
pub mod outbox;
#[cfg(test)]
mod property;
pub mod reading;
pub mod recordings;
pub mod status;
pub mod tell;
pub mod vehicle;
