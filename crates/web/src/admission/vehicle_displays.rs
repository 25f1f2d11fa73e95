//! The vehicle's own displays, to which only authorized people have access. They accept a PIN, and nobody
//! elsewhere takes their share of places.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr};
use std::str::FromStr;

use axum::http::HeaderMap;

use super::proxies::Proxies;
use crate::AppState;
use telltale_store::Caller;

/// One value of the flag `--display`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VehicleDisplay {
    /// Browsers on this machine.
    Loopback,
    At(IpAddr),
    /// No display at all: everybody gives a password.
    None,
}

/// The text is not a display.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no display: give an address such as 10.0.0.7, or `loopback`, or `none`")]
pub struct NoDisplay(String);

impl FromStr for VehicleDisplay {
    type Err = NoDisplay;

    fn from_str(word: &str) -> Result<VehicleDisplay, NoDisplay> {
        match word {
            "loopback" => Ok(VehicleDisplay::Loopback),
            "none" => Ok(VehicleDisplay::None),
            _ => word.parse().map(VehicleDisplay::At).map_err(|_| NoDisplay(word.to_owned())),
        }
    }
}

impl fmt::Display for VehicleDisplay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            VehicleDisplay::Loopback => f.write_str("loopback"),
            VehicleDisplay::At(ip) => ip.fmt(f),
            VehicleDisplay::None => f.write_str("none"),
        }
    }
}

/// The enrolled displays: this machine's own, unless others are named.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Enrolled {
    displays: Vec<VehicleDisplay>,
    proxies: Proxies,
}

impl Default for Enrolled {
    fn default() -> Enrolled {
        Enrolled { displays: vec![VehicleDisplay::Loopback], proxies: Proxies::default() }
    }
}

impl Enrolled {
    /// Those of the list; without one, this machine's own.
    pub fn new(displays: Vec<VehicleDisplay>) -> Enrolled {
        let default = Enrolled::default();
        if displays.is_empty() { default } else { Enrolled { displays, ..default } }
    }

    /// The same, with proxies that are trusted to name the source of a request.
    #[must_use]
    pub fn behind(self, proxies: Proxies) -> Enrolled {
        Enrolled { proxies, ..self }
    }

    /// The source of a request that arrived from this address.
    pub fn source(&self, peer: IpAddr, headers: &HeaderMap) -> IpAddr {
        self.proxies.source(peer, headers)
    }

    /// Whether connections from this address are a trusted proxy's.
    pub fn is_proxy(&self, peer: IpAddr) -> bool {
        self.proxies.has(peer)
    }

    /// Where a caller with this address is. If other displays are named, this machine is not one: a proxy
    /// may run on it, and all its clients look alike. The address of a trusted proxy is that of a browser which
    /// it does not name, so it is never a display.
    pub fn caller(&self, source: IpAddr) -> Caller {
        let source = source.to_canonical();
        let is_display = self.displays.iter().any(|display| match display {
            VehicleDisplay::Loopback => source.is_loopback(),
            VehicleDisplay::At(ip) => ip.to_canonical() == source,
            VehicleDisplay::None => false,
        });
        if is_display && !self.proxies.has(source) { Caller::Vehicle } else { Caller::Elsewhere }
    }

    /// The first named display that is no display because it is a trusted proxy's address.
    pub fn display_of_proxy(&self) -> Option<VehicleDisplay> {
        let is_proxy = |display: &&VehicleDisplay| match display {
            VehicleDisplay::Loopback => self.proxies.has(Ipv4Addr::LOCALHOST.into()),
            VehicleDisplay::At(ip) => self.proxies.has(*ip),
            VehicleDisplay::None => false,
        };
        self.displays.iter().find(is_proxy).copied()
    }
}

impl AppState {
    /// Where a caller with this address is.
    pub fn caller(&self, source: IpAddr) -> Caller {
        self.settings.enrolled.caller(source)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_is_what_the_list_says_and_without_one_this_machine() {
        let cases = [
            ("", "127.0.0.9", true),
            ("", "127.0.0.1", true),
            ("", "::1", true),
            ("", "::ffff:127.0.0.1", true),
            ("", "10.0.0.7", false),
            ("10.0.0.7", "10.0.0.7", true),
            ("10.0.0.7", "::ffff:10.0.0.7", true),
            ("10.0.0.7", "10.0.0.70", false),
            ("10.0.0.7", "127.0.0.1", false),
            ("10.0.0.7 loopback", "127.0.0.1", true),
            ("10.0.0.7", "::1", false),
            ("none", "127.0.0.1", false),
            ("none", "::1", false),
            ("fd00::7", "fd00::7", true),
        ];
        for (list, source, expected) in cases {
            let displays = list.split_whitespace().map(|word| word.parse().unwrap()).collect();
            let enrolled = Enrolled::new(displays);
            let expected = if expected { Caller::Vehicle } else { Caller::Elsewhere };
            assert_eq!(enrolled.caller(source.parse().unwrap()), expected, "{list:?} {source}");
        }
        let network = |text: &str| text.parse().unwrap();
        for (displays, proxy, source, expected) in [
            ("loopback", "127.0.0.9", "127.0.0.9", Caller::Elsewhere),
            ("loopback", "127.0.0.9", "::ffff:127.0.0.9", Caller::Elsewhere),
            ("loopback", "127.0.0.9", "127.0.0.1", Caller::Vehicle),
            ("10.0.0.7", "10.0.0.7", "10.0.0.7", Caller::Elsewhere),
            ("10.0.0.7", "10.0.0.0/24", "10.0.0.7", Caller::Elsewhere),
        ] {
            let enrolled = Enrolled::new(vec![displays.parse().unwrap()]);
            let enrolled = enrolled.behind(Proxies::new(vec![network(proxy)]));
            assert_eq!(enrolled.caller(source.parse().unwrap()), expected, "{displays} {proxy} {source}");
        }
        let behind = |proxy| Enrolled::default().behind(Proxies::new(vec![network(proxy)]));
        assert_eq!(behind("127.0.0.1").display_of_proxy(), Some(VehicleDisplay::Loopback));
        assert_eq!(behind("127.0.0.9").display_of_proxy(), None);
        assert!("shuttle".parse::<VehicleDisplay>().is_err());
    }
}
