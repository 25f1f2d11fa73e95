//! Admission: which callers the server admits and how many, from the vehicle's own displays and from
//! elsewhere; proxies, connections and logins; and how often an account does actions that the audit log records.

pub(super) mod connections;
pub(super) mod login_throttle;
pub(super) mod peer;
pub(super) mod proxies;
pub(super) mod recorded;
pub(super) mod vehicle_displays;
