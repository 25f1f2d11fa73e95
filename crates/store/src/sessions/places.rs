//! The places from which a session is used. A cookie that was stolen is used from another one.

use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};

use tokio::sync::watch;

use crate::Session;

/// Further places are not told.
const PLACES_MAX: usize = 8;

#[derive(Debug)]
pub(crate) struct Places {
    /// Networks, the first one in front.
    known: Mutex<Vec<IpAddr>>,
    /// The address from which it was used that was not known before.
    other: watch::Sender<Option<IpAddr>>,
}

impl Default for Places {
    fn default() -> Places {
        Places { known: Mutex::default(), other: watch::channel(None).0 }
    }
}

impl Session {
    /// Notes an address from which it is used, and its network. Returns the network of the beginning if this is another
    /// one, once for each.
    pub fn used_from(&self, address: IpAddr, network: IpAddr) -> Option<IpAddr> {
        let mut known = self.places.known.lock().unwrap_or_else(PoisonError::into_inner);
        if known.contains(&network) || known.len() >= PLACES_MAX {
            return None;
        }
        known.push(network);
        let first = known.first().copied().filter(|first| *first != network)?;
        self.places.other.send_replace(Some(address));
        Some(first)
    }

    /// The last address from another network, now and whenever there is one.
    pub fn elsewhere(&self) -> watch::Receiver<Option<IpAddr>> {
        self.places.other.subscribe()
    }
}
