//! ICMP echo without privileges, through the kernel's datagram sockets, if the system allows them.

use std::io::{self, ErrorKind};
use std::net::{IpAddr, SocketAddr};

use socket2::{Domain, Protocol, Socket, Type};
use tokio::net::UdpSocket;

pub const FORBIDDEN: &str = "this system does not let the program send ICMP echos. Allow it with `sysctl -w \
                             net.ipv4.ping_group_range=\"0 2147483647\"`, or watch a TCP port of that host";

const PAYLOAD: &[u8; 8] = b"telltale";
const HEADER_BYTES: usize = 8;

/// Sends one echo and waits for its reply, for ever.
///
/// # Errors
/// `Forbidden` if the system denies us such a socket; the other errors mean that the host does not answer.
pub async fn echo(ip: IpAddr) -> Result<(), EchoError> {
    let socket = open(ip).map_err(|error| match error.kind() {
        ErrorKind::PermissionDenied | ErrorKind::Unsupported => EchoError::Forbidden,
        _ if error.raw_os_error().is_some() => EchoError::NoSocket(error),
        _ => EchoError::Failed(error),
    })?;
    let (request, reply) = match ip {
        IpAddr::V4(_) => (8, 0),
        IpAddr::V6(_) => (128, 129),
    };
    // The kernel fills in the checksum, and an identifier by which it finds our socket again.
    let mut message = [0; HEADER_BYTES + PAYLOAD.len()];
    message[0] = request;
    message[7] = 1;
    message[HEADER_BYTES..].copy_from_slice(PAYLOAD);
    socket.connect(SocketAddr::new(ip, 0)).await.map_err(EchoError::Failed)?;
    socket.send(&message).await.map_err(EchoError::Failed)?;
    let mut received = [0; 64];
    loop {
        let bytes = socket.recv(&mut received).await.map_err(EchoError::Failed)?;
        let answer = &received[..bytes];
        if answer.len() == message.len() && answer[0] == reply && answer[6..] == message[6..] {
            return Ok(());
        }
    }
}

#[derive(Debug)]
pub enum EchoError {
    Forbidden,
    NoSocket(io::Error),
    Failed(io::Error),
}

fn open(ip: IpAddr) -> io::Result<UdpSocket> {
    let (domain, protocol) = match ip {
        IpAddr::V4(_) => (Domain::IPV4, Protocol::ICMPV4),
        IpAddr::V6(_) => (Domain::IPV6, Protocol::ICMPV6),
    };
    let socket = Socket::new(domain, Type::DGRAM, Some(protocol))?;
    socket.set_nonblocking(true)?;
    UdpSocket::from_std(socket.into())
}
