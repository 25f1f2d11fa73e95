//! Finds the source of a request behind trusted proxies.

use std::net::IpAddr;
use std::str::FromStr;

use axum::http::HeaderMap;

/// Each proxy adds the address from which a request came to it.
const FORWARDED: &str = "x-forwarded-for";

/// Addresses that begin alike: `10.0.0.0/8`, or one address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Network {
    first: IpAddr,
    bits: u32,
}

/// The text is not a network.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no network: give an address such as 127.0.0.1, or a network such as 10.0.0.0/24")]
pub struct NoNetwork(String);

impl FromStr for Network {
    type Err = NoNetwork;

    fn from_str(word: &str) -> Result<Network, NoNetwork> {
        let error = || NoNetwork(word.to_owned());
        let (ip, bits) = word.split_once('/').map_or((word, None), |(ip, bits)| (ip, Some(bits)));
        let first: IpAddr = ip.parse().map_err(|_| error())?;
        let bits_max = if first.is_ipv4() { 32 } else { 128 };
        let bits = bits.map_or(Ok(bits_max), str::parse).map_err(|_| error())?;
        if bits > bits_max { Err(error()) } else { Ok(Network { first, bits }) }
    }
}

impl Network {
    fn has(self, ip: IpAddr) -> bool {
        let (first, ip, length) = match (self.first, ip.to_canonical()) {
            (IpAddr::V4(first), IpAddr::V4(ip)) => (first.to_bits().into(), ip.to_bits().into(), 32),
            (IpAddr::V6(first), IpAddr::V6(ip)) => (first.to_bits(), ip.to_bits(), 128),
            _ => return false,
        };
        let differ: u128 = first ^ ip;
        differ.checked_shr(length - self.bits).unwrap_or(0) == 0
    }
}

/// The proxies that are trusted; none, unless they are named.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Proxies(Vec<Network>);

impl Proxies {
    pub fn new(networks: Vec<Network>) -> Proxies {
        Proxies(networks)
    }

    /// Whether this is the address of a proxy that is trusted.
    pub fn has(&self, ip: IpAddr) -> bool {
        self.0.iter().any(|network| network.has(ip))
    }

    /// The source of a request that arrived from `peer`: the last address that is no trusted proxy. Anybody
    /// can have written the addresses before that one. Where the source is missing or cannot be read, it is the
    /// last known proxy, which is never near. A loopback address says nothing beyond its own machine, so one in
    /// the header counts as one that cannot be read.
    pub fn source(&self, peer: IpAddr, headers: &HeaderMap) -> IpAddr {
        let lines = headers.get_all(FORWARDED).iter().rev();
        let hops = lines.flat_map(|line| line.to_str().unwrap_or("?").rsplit(','));
        let mut source = peer.to_canonical();
        for hop in hops {
            if !self.has(source) {
                break;
            }
            let before = hop.trim().parse::<IpAddr>().ok().map(|ip| ip.to_canonical());
            let Some(before) = before.filter(|ip| !ip.is_loopback() || self.has(*ip)) else { break };
            source = before;
        }
        source
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_address_that_is_no_trusted_proxys_is_the_source() {
        let cases: [(&str, &str, &[&str], &str); 22] = [
            ("", "127.0.0.1", &["10.0.0.7"], "127.0.0.1"),
            ("127.0.0.1", "127.0.0.1", &[], "127.0.0.1"),
            ("127.0.0.1", "127.0.0.1", &["203.0.113.9"], "203.0.113.9"),
            ("127.0.0.1", "::ffff:127.0.0.1", &["203.0.113.9"], "203.0.113.9"),
            // The part that the client itself wrote stands in front.
            ("127.0.0.1", "127.0.0.1", &["127.0.0.1, 203.0.113.9"], "203.0.113.9"),
            ("127.0.0.1", "127.0.0.1", &["10.0.0.7", "203.0.113.9"], "203.0.113.9"),
            ("127.0.0.1 10.0.0.0/8", "127.0.0.1", &["198.51.100.1, 203.0.113.9, 10.1.2.3"], "203.0.113.9"),
            ("127.0.0.1 10.0.0.0/8", "10.9.9.9", &["10.1.2.3"], "10.1.2.3"),
            ("10.0.0.0/8", "11.0.0.1", &["203.0.113.9"], "11.0.0.1"),
            ("127.0.0.1", "127.0.0.1", &["203.0.113.9, unknown"], "127.0.0.1"),
            ("127.0.0.1", "127.0.0.1", &["203.0.113.9, \u{e9}"], "127.0.0.1"),
            ("127.0.0.1", "127.0.0.1", &[""], "127.0.0.1"),
            ("127.0.0.1", "127.0.0.1", &["203.0.113.9,"], "127.0.0.1"),
            ("127.0.0.1", "127.0.0.1", &["203.0.113.9", ""], "127.0.0.1"),
            ("127.0.0.1", "127.0.0.1", &["[::1]:80"], "127.0.0.1"),
            ("127.0.0.1", "127.0.0.1", &["203.0.113.9:1234"], "127.0.0.1"),
            // A loopback address is that of a proxy's machine, which may be another one.
            ("10.0.0.2", "10.0.0.2", &["127.0.0.1"], "10.0.0.2"),
            ("10.0.0.2", "10.0.0.2", &["203.0.113.9, ::ffff:127.0.0.1"], "10.0.0.2"),
            ("127.0.0.9", "127.0.0.9", &["203.0.113.9, ::1"], "127.0.0.9"),
            ("10.0.0.2 127.0.0.1", "10.0.0.2", &["203.0.113.9, 127.0.0.1"], "203.0.113.9"),
            ("fd00::/8", "fd00::1", &["2001:db8::5"], "2001:db8::5"),
            ("0.0.0.0/0", "192.0.2.1", &["203.0.113.9"], "203.0.113.9"),
        ];
        for (proxies, peer, lines, expected) in cases {
            let networks = proxies.split_whitespace().map(|word| word.parse().unwrap()).collect();
            let mut headers = HeaderMap::new();
            for line in lines {
                headers.append(FORWARDED, line.parse().unwrap());
            }
            let source = Proxies::new(networks).source(peer.parse().unwrap(), &headers);
            assert_eq!(source.to_string(), expected, "{proxies:?} {peer} {lines:?}");
        }
        for wrong in ["", "proxy", "10.0.0.0/33", "10.0.0.0/x", "fd00::/129", "10.0.0/8"] {
            assert!(wrong.parse::<Network>().is_err(), "{wrong:?}");
        }
    }
}
