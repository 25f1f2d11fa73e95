//! A line that is slow, that holds everything back, or that is cut, between a vehicle and its hub.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use telltale_fleet::line;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;

use super::server::Hub;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    Open,
    /// Nothing passes, and nobody is told.
    BlackHole,
    /// So many bytes pass at once, then none for 20 ms.
    Slow(usize),
    /// Open connections and new ones are reset.
    Reset,
}

pub struct Proxy {
    port: u16,
    mode: watch::Sender<Mode>,
    cuts: Arc<Mutex<VecDeque<usize>>>,
}

impl Proxy {
    pub async fn start(hub: &Hub, mode: Mode) -> Proxy {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let target = hub.address().url.strip_prefix("tls://").unwrap().to_owned();
        let (mode, seen) = watch::channel(mode);
        let cuts: Arc<Mutex<VecDeque<usize>>> = Arc::default();
        let next = cuts.clone();
        tokio::spawn(async move {
            while let Ok((client, _)) = listener.accept().await {
                let cut = next.lock().unwrap().pop_front().unwrap_or(usize::MAX);
                tokio::spawn(carry(client, target.clone(), seen.clone(), cut));
            }
        });
        Proxy { port, mode, cuts }
    }

    /// The hub, behind this line.
    pub fn address(&self, hub: &Hub) -> line::Hub {
        line::Hub { url: format!("tls://127.0.0.1:{}", self.port), ..hub.address() }
    }

    pub fn is(&self, mode: Mode) {
        self.mode.send_replace(mode);
    }

    /// The next connections are reset when so many bytes have come from the vehicle.
    pub fn cut_after(&self, bytes: &[usize]) {
        self.cuts.lock().unwrap().extend(bytes);
    }

    pub fn has_cut_all(&self) -> bool {
        self.cuts.lock().unwrap().is_empty()
    }
}

async fn carry(client: TcpStream, target: String, mut mode: watch::Receiver<Mode>, cut: usize) {
    let Ok(server) = TcpStream::connect(target).await else { return };
    for stream in [&client, &server] {
        // A dropped connection is reset.
        stream.set_zero_linger().unwrap();
    }
    let (from_client, to_client) = client.into_split();
    let (from_server, to_server) = server.into_split();
    tokio::select! {
        () = pump(from_client, to_server, mode.clone(), cut) => {}
        () = pump(from_server, to_client, mode.clone(), usize::MAX) => {}
        _ = mode.wait_for(|mode| *mode == Mode::Reset) => {}
    }
}

async fn pump(
    mut from: OwnedReadHalf,
    mut to: OwnedWriteHalf,
    mut mode: watch::Receiver<Mode>,
    mut cut: usize,
) {
    let mut buffer = vec![0; 16 * 1024];
    loop {
        let now = *mode.borrow();
        let most = if let Mode::Slow(bytes) = now { bytes } else { buffer.len() };
        let Ok(count @ 1..) = from.read(&mut buffer[..most]).await else { return };
        if mode.wait_for(|mode| *mode != Mode::BlackHole).await.is_err() {
            return;
        }
        if let Mode::Slow(_) = now {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        let passed = count.min(cut);
        cut -= passed;
        if to.write_all(&buffer[..passed]).await.is_err() || cut == 0 {
            return;
        }
    }
}
