//! Resolves host names. The system's resolver may hang for half a minute, so it runs in a thread of its
//! own, one at a time for each name, and a cancelled query is not started twice.

use std::io;
use std::net::{SocketAddr, ToSocketAddrs as _};

use tokio::sync::oneshot;

use telltale_clock::Clock;
use telltale_engine::time::{Span, Timestamp};

/// A name is resolved again after this time.
const FRESH: Span = Span::from_secs(30);

/// One `HOST:PORT`, or `HOST` where the port does not matter.
#[derive(Debug)]
pub struct Lookup {
    host_and_port: String,
    clock: Clock,
    known: Option<(Vec<SocketAddr>, Timestamp)>,
    pending: Option<oneshot::Receiver<io::Result<Vec<SocketAddr>>>>,
}

impl Lookup {
    pub fn of_address(host_and_port: &str, clock: Clock) -> Lookup {
        Lookup { host_and_port: host_and_port.to_owned(), clock, known: None, pending: None }
    }

    pub fn of_host(host: &str, clock: Clock) -> Lookup {
        let bare_ipv6 = host.contains(':') && !host.starts_with('[');
        let host_and_port = if bare_ipv6 { format!("[{host}]:0") } else { format!("{host}:0") };
        Lookup { host_and_port, clock, known: None, pending: None }
    }

    /// With another resolver, for tests.
    #[cfg(test)]
    pub fn answered_by(pending: oneshot::Receiver<io::Result<Vec<SocketAddr>>>, clock: Clock) -> Lookup {
        Lookup { host_and_port: String::new(), clock, known: None, pending: Some(pending) }
    }

    /// Whether an answer of the resolver is pending.
    pub fn is_pending(&self) -> bool {
        self.pending.is_some()
    }

    /// May be cancelled: the next call waits for the same answer.
    pub async fn addresses(&mut self) -> io::Result<Vec<SocketAddr>> {
        if let Ok(address) = self.host_and_port.parse() {
            return Ok(vec![address]);
        }
        let now = self.clock.now();
        if let Some((addresses, since)) = &self.known
            && now.since(*since) < FRESH
        {
            return Ok(addresses.clone());
        }
        let pending = match &mut self.pending {
            Some(pending) => pending,
            None => self.pending.insert(ask(self.host_and_port.clone())?),
        };
        // The thread sends unless it panics, in the system's resolver.
        let answer = pending.await.unwrap_or_else(|_| Err(io::Error::other("the resolver failed")));
        self.pending = None;
        let addresses = answer?;
        self.known = Some((addresses.clone(), self.clock.now()));
        Ok(addresses)
    }
}

/// Not a thread of the runtime's pool, which would be waited for at the end.
fn ask(host_and_port: String) -> io::Result<oneshot::Receiver<io::Result<Vec<SocketAddr>>>> {
    let (answer, pending) = oneshot::channel();
    std::thread::Builder::new().name("lookup".to_owned()).spawn(move || {
        // The caller may have gone.
        let _ = answer.send(host_and_port.to_socket_addrs().map(Iterator::collect));
    })?;
    Ok(pending)
}
