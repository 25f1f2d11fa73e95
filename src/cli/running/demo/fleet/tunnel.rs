//! A line to the hub that is cut again and again, as of a vehicle in a tunnel.

use std::time::Duration;

use anyhow::Context as _;
use tokio::io::copy_bidirectional;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;

/// From the start to the first tunnel, its length, and the way to the next one.
const FIRST_AFTER: Duration = Duration::from_secs(40);
const LASTS: Duration = Duration::from_secs(120);
const NEXT_AFTER: Duration = Duration::from_secs(180);

pub struct Tunnel {
    listener: TcpListener,
    hub_port: u16,
}

impl Tunnel {
    /// # Errors
    /// This machine has no free port.
    pub async fn open(hub_port: u16) -> anyhow::Result<Tunnel> {
        let listener = TcpListener::bind("127.0.0.1:0").await.context("this machine has no free port")?;
        Ok(Tunnel { listener, hub_port })
    }

    /// # Errors
    /// The listener has no address.
    pub fn port(&self) -> anyhow::Result<u16> {
        Ok(self.listener.local_addr().context("the listener has no address")?.port())
    }

    /// Passes everything on, but for the time in tunnels. Never returns.
    pub async fn run(self) {
        let mut open_for = FIRST_AFTER;
        loop {
            let _ = tokio::time::timeout(open_for, self.pass()).await;
            tokio::time::sleep(LASTS).await;
            // Who tried meanwhile has given up.
            while let Ok(Ok(_)) = tokio::time::timeout(Duration::ZERO, self.listener.accept()).await {}
            open_for = NEXT_AFTER;
        }
    }

    /// The connections end with the future.
    async fn pass(&self) {
        let mut connections = JoinSet::new();
        loop {
            let Ok((mut vehicle, _)) = self.listener.accept().await else {
                tokio::time::sleep(Duration::from_secs(1)).await;
                continue;
            };
            let port = self.hub_port;
            while connections.try_join_next().is_some() {}
            connections.spawn(async move {
                if let Ok(mut hub) = TcpStream::connect(("127.0.0.1", port)).await {
                    let _ = copy_bidirectional(&mut vehicle, &mut hub).await;
                }
            });
        }
    }
}
