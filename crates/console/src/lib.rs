//! The console of a fleet: reads what lies at the hub, and shows all vehicles, the worst first. Nothing here acts on a
//! vehicle: no message is ever sent to one.

pub mod follow;
pub mod history;
pub mod http;
pub mod kept;
pub mod state;
