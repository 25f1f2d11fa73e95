//! Admission: which callers the server admits and how many, from the vehicle's own displays and from
//! elsewhere; proxies, connections and logins; and how much is made for readers at once.

pub(super) mod connections;
pub(super) mod login_throttle;
pub(super) mod peer;
pub(super) mod proxies;
pub(super) mod readers;
pub(super) mod vehicle_displays;
