//! The console of a fleet: reads what lies at the hub, and shows all vehicles, the worst first. Nothing here acts on a
//! vehicle: a message to one asks for recordings by their numbers, or for live data.

pub mod follow;
pub mod history;
pub mod http;
pub mod kept;
pub mod oidc;
pub mod past;
pub mod recordings;
pub mod state;
pub mod what_ifs;
