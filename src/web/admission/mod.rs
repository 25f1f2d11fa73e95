//! Whom the server admits, and how much of them: the vehicle's own displays and callers from elsewhere,
//! proxies, connections, logins.

pub(super) mod connections;
pub(super) mod login_throttle;
pub(super) mod peer;
pub(super) mod proxies;
pub(super) mod vehicle_displays;
