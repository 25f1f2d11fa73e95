//! The HTTP server: pages, sessions, the WebSocket and the wire.

mod answer;
pub mod assets;
mod audit;
mod demo;
mod developer;
mod displays;
mod enrolled;
pub mod frame;
mod guard;
mod headers;
mod keep;
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
mod tls;
pub mod view;
mod wording;

pub use demo::{DemoFaults, FaultSwitch};
pub use enrolled::{Display, Enrolled, NoDisplay};
pub use guard::{Access, cookie_name};
pub use listen::serve;
pub use login::Peer;
pub use origins::{NoOrigin, Origins};
pub use router::{BODY_BYTES_MAX, Route, router, routes};
pub use seat::DEVELOPER_IDLE_MAX;
pub use state::{AppState, Settings};
pub use tls::{Tls, TlsError};
