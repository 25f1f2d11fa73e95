//! The address of the other end of a connection.

use std::convert::Infallible;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

use axum::extract::FromRequestParts;
use axum::http::request::Parts;

/// The address of the other end of a connection; behind a trusted proxy, that of the proxy's client.
#[derive(Debug, Clone, Copy)]
pub struct Peer(pub SocketAddr);

/// The address of the other end. A request without a connection, as in tests, comes from this machine.
pub fn source_of(peer: Option<Peer>) -> IpAddr {
    peer.map_or(IpAddr::V4(Ipv4Addr::LOCALHOST), |Peer(peer)| peer.ip().to_canonical())
}

/// The address that a request came from.
#[derive(Debug, Clone, Copy)]
pub struct CameFrom(pub IpAddr);

impl<S: Sync> FromRequestParts<S> for CameFrom {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<CameFrom, Infallible> {
        Ok(CameFrom(source_of(parts.extensions.get::<Peer>().copied())))
    }
}

/// Where a browser is, for the question whether it is elsewhere: this machine has several addresses.
pub fn place_of(source: IpAddr) -> IpAddr {
    if source.is_loopback() { IpAddr::V4(Ipv4Addr::LOCALHOST) } else { network(source) }
}

/// The network of an address: a host with one IPv6 address has 2^64 of them.
pub fn network(ip: IpAddr) -> IpAddr {
    match ip {
        IpAddr::V4(_) => ip,
        IpAddr::V6(ip) => IpAddr::V6(Ipv6Addr::from_bits(ip.to_bits() & !u128::from(u64::MAX))),
    }
}
