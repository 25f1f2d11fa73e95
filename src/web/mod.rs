//! The HTTP server: pages, sessions, the WebSocket and the wire.

mod answer;
pub mod assets;
mod demo;
mod developer;
mod displays;
pub mod frame;
mod guard;
mod headers;
mod listen;
mod login;
mod origins;
mod pages;
mod refusals;
mod router;
mod seat;
mod socket;
mod state;
pub mod text;
mod throttle;
mod trends;
pub mod view;
mod wording;

pub use demo::{DemoFaults, FaultSwitch};
pub use guard::{Access, cookie_name};
pub use listen::serve;
pub use origins::{NoOrigin, Origins};
pub use router::{BODY_BYTES_MAX, Route, router, routes};
pub use state::{AppState, Settings};
