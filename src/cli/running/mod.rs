//! Commands that run on until they are stopped: the display of a vehicle, the simulation, and what looks at a display.

pub mod console;
pub mod demo;
pub mod serve;
pub mod server;
pub mod sim;
pub mod vehicle;
pub mod watch;
