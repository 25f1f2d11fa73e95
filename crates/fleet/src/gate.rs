//! Stands between the hub and the NATS library: TLS to the hub, and a bound for each line and each message from there.
//!
//! The library reads a line or a message of any length into memory, answers each `PING` from memory, and panics at some
//! lines. It knows no connection but TCP, so it connects to a port of the loopback interface, which takes one connection.
//! Somebody else who is faster there reaches the hub's login, without the key. The port stays taken until the library
//! has given up: it would log in to another program there.

use std::io::{self, ErrorKind, Read as _};
use std::net::Ipv4Addr;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use async_nats::ServerAddr;
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, RootCertStore};
use telltale_yaml::input_file;
use tokio::io::{
    AsyncBufRead, AsyncBufReadExt as _, AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _,
};
use tokio::io::{BufReader, split};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{oneshot, watch};
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;

use crate::line::Hub;
use crate::message::BATCH_BYTES_MAX;

/// A line of the protocol. The longest is the hub's `INFO`, which names the servers of a cluster.
const LINE_BYTES_MAX: usize = 32 << 10;

/// A message with its headers. The largest is a batch of a log.
const MESSAGE_BYTES_MAX: usize = BATCH_BYTES_MAX + (8 << 10);

/// `PING`s that wait for this side to say something. A hub sends one in a minute or two.
const PINGS_MAX: usize = 16;

/// A file of certificates.
const CA_BYTES_MAX: u64 = 1 << 20;

/// The allowance of a vehicle for one of these ticks, and how much a message costs beside its bytes.
const TICK: Duration = Duration::from_millis(100);
const BYTES_IN_A_TICK: usize = 64 << 10;
const MESSAGE_COSTS: usize = 4 << 10;

/// By then the library has tried to connect again, and has given up.
const GIVEN_UP_WITHIN: Duration = Duration::from_secs(10);

/// How fast the hub's messages are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// 160 small messages a second, or 640 KiB. Of a vehicle, which gets an answer to each batch and a wish now and then.
    Slow,
    /// As they come. Of a console.
    Any,
}

/// An open connection. It ends when this is dropped.
#[derive(Debug)]
pub struct Gate {
    port: u16,
    why: watch::Receiver<Option<String>>,
    /// The connection ends with it.
    _kept: oneshot::Sender<()>,
}

impl Gate {
    /// Connects to the hub, which must show a certificate that the file of certificates signs.
    pub async fn open(hub: &Hub, pace: Pace) -> io::Result<Gate> {
        let (info, secured) = connect(hub).await?;
        Gate::before(secured, info, pace).await
    }

    /// Before a connection to a hub that has said this.
    async fn before(
        secured: impl AsyncRead + AsyncWrite + Send + 'static,
        info: Vec<u8>,
        pace: Pace,
    ) -> io::Result<Gate> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await?;
        let port = listener.local_addr()?.port();
        let (tell, why) = watch::channel(None);
        let (kept, dropped) = oneshot::channel();
        tokio::spawn(async move {
            let ended = tokio::select! {
                ended = pass(&listener, &info, secured, pace) => ended,
                _ = dropped => Ok(()),
            };
            let why = match ended {
                Err(error) if error.kind() != ErrorKind::UnexpectedEof => error.to_string(),
                _ => "the line was cut".to_owned(),
            };
            tell.send_replace(Some(why));
            // The library connects once more by itself, and logs in with the key. Nobody else has this port then.
            let refuse = async { while listener.accept().await.is_ok() {} };
            let _ = tokio::time::timeout(GIVEN_UP_WITHIN, refuse).await;
        });
        Ok(Gate { port, why, _kept: kept })
    }

    /// Where the NATS library connects.
    pub fn url(&self) -> String {
        format!("nats://{}:{}", Ipv4Addr::LOCALHOST, self.port)
    }

    /// Why the connection is over, if it is.
    pub fn why(&self) -> Option<String> {
        self.why.borrow().clone()
    }

    /// Waits until the connection is over, and says why it is.
    pub async fn ended(&mut self) -> String {
        match self.why.wait_for(Option::is_some).await {
            Ok(why) => why.clone().unwrap_or_default(),
            Err(_) => "the line was cut".into(),
        }
    }
}

/// The hub's first line, for a client to which this connection needs no TLS, and the connection.
async fn connect(hub: &Hub) -> io::Result<(Vec<u8>, TlsStream<TcpStream>)> {
    let address: ServerAddr = hub.url.parse()?;
    let name = ServerName::try_from(address.host().to_owned()).map_err(invalid)?;
    let connector = TlsConnector::from(Arc::new(believing(&hub.ca)?));
    let mut stream = TcpStream::connect((address.host(), address.port())).await?;
    stream.set_nodelay(true)?;
    let mut line = Vec::new();
    // Byte by byte, so that nothing of TLS is read with it.
    while !line.ends_with(b"\n") {
        if line.len() == LINE_BYTES_MAX {
            return Err(invalid("the hub's first line is too long"));
        }
        line.push(stream.read_u8().await?);
    }
    let info = line.strip_prefix(b"INFO ").ok_or_else(|| invalid("no hub answers there"))?;
    let mut info: serde_json::Map<String, serde_json::Value> =
        serde_json::from_slice(info).map_err(|_| invalid("no hub answers there"))?;
    info.retain(|key, _| !key.starts_with("tls_") && key != "connect_urls");
    let info = format!("INFO {}\r\n", serde_json::Value::Object(info));
    Ok((info.into_bytes(), connector.connect(name, stream).await?))
}

fn believing(ca: &Path) -> io::Result<ClientConfig> {
    let unusable = |why: &dyn std::fmt::Display| invalid(format!("{}: {why}", ca.display()));
    let mut text = Vec::new();
    input_file::open(ca)
        .and_then(|file| file.take(CA_BYTES_MAX).read_to_end(&mut text))
        .map_err(|error| unusable(&error))?;
    let mut roots = RootCertStore::empty();
    for certificate in CertificateDer::pem_slice_iter(&text) {
        let added = certificate.map_err(|error| unusable(&error)).map(|it| roots.add(it));
        added?.map_err(|error| unusable(&error))?;
    }
    if roots.is_empty() {
        return Err(unusable(&"it holds no certificate"));
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let versions = ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions();
    Ok(versions.map_err(invalid)?.with_root_certificates(roots).with_no_client_auth())
}

/// Passes bytes both ways until one side ends or the hub exceeds a bound.
async fn pass(
    listener: &TcpListener,
    info: &[u8],
    hub: impl AsyncRead + AsyncWrite,
    pace: Pace,
) -> io::Result<()> {
    let (client, _) = listener.accept().await?;
    client.set_nodelay(true)?;
    let (from_client, mut to_client) = client.into_split();
    let (from_hub, to_hub) = split(hub);
    to_client.write_all(info).await?;
    let pings = AtomicUsize::new(0);
    tokio::select! {
        ended = inwards(BufReader::new(from_hub), to_client, pace, &pings) => ended,
        ended = outwards(from_client, to_hub, &pings) => ended,
    }
}

async fn outwards(
    mut client: impl AsyncRead + Unpin,
    mut hub: impl AsyncWrite + Unpin,
    pings: &AtomicUsize,
) -> io::Result<()> {
    let mut bytes = vec![0; 16 << 10];
    loop {
        let count = client.read(&mut bytes).await?;
        if count == 0 {
            return Ok(());
        }
        hub.write_all(&bytes[..count]).await?;
        hub.flush().await?;
        pings.store(0, Ordering::Relaxed);
    }
}

async fn inwards(
    mut hub: impl AsyncBufRead + Unpin,
    mut client: impl AsyncWrite + Unpin,
    pace: Pace,
    pings: &AtomicUsize,
) -> io::Result<()> {
    let mut ticks = tokio::time::interval(TICK);
    ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
    let mut used = 0;
    let mut line = Vec::new();
    loop {
        line.clear();
        (&mut hub).take(LINE_BYTES_MAX as u64).read_until(b'\n', &mut line).await?;
        if line.is_empty() {
            return Ok(());
        }
        let follows = following(&line)?;
        if line == b"PING\r\n" && pings.fetch_add(1, Ordering::Relaxed) >= PINGS_MAX {
            return Err(invalid("the hub sends PING without end"));
        }
        while pace == Pace::Slow && used >= BYTES_IN_A_TICK {
            ticks.tick().await;
            used = used.saturating_sub(BYTES_IN_A_TICK);
        }
        used += line.len() + follows + MESSAGE_COSTS;
        client.write_all(&line).await?;
        let passed = tokio::io::copy(&mut (&mut hub).take(follows as u64), &mut client).await?;
        if passed < follows as u64 {
            return Ok(());
        }
    }
}

/// The bytes that follow a line: of a message, with its end.
fn following(line: &[u8]) -> io::Result<usize> {
    let unknown = || invalid("the hub says something that is not of the protocol");
    let line = line.strip_suffix(b"\r\n").ok_or_else(unknown)?;
    match line.split(|byte| *byte == b' ').next() {
        Some(b"PING" | b"PONG" | b"+OK") if !line.contains(&b' ') => Ok(0),
        Some(b"INFO") if line.len() > 5 => Ok(0),
        Some(b"-ERR") if line.len() > 5 => Ok(0),
        Some(b"MSG" | b"HMSG") if line.iter().all(|byte| matches!(byte, b' '..=b'~')) => {
            let count = line.rsplit(|byte| *byte == b' ').find(|word| !word.is_empty());
            let count =
                count.and_then(|it| std::str::from_utf8(it).ok()).and_then(|it| it.parse::<usize>().ok());
            match count.ok_or_else(unknown)? {
                count if count <= MESSAGE_BYTES_MAX => Ok(count + 2),
                count => Err(invalid(format!("the hub sends a message of {count} bytes"))),
            }
        }
        _ => Err(unknown()),
    }
}

fn invalid(why: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, why)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What passes of the hub's bytes, and how that ended.
    async fn passed(bytes: &[u8]) -> (Vec<u8>, io::Result<()>) {
        let mut out = Vec::new();
        let ended = inwards(bytes, &mut out, Pace::Any, &AtomicUsize::new(0)).await;
        (out, ended)
    }

    #[tokio::test]
    async fn the_protocol_of_a_hub_passes_unchanged() {
        let said = b"PING\r\n+OK\r\nMSG tt.1.a.want 1 13\r\n{\"live_s\":30}\r\nPONG\r\nINFO {\"a\":1}\r\n\
            HMSG _INBOX.a.b 2 12 14\r\nNATS/1.0\r\n\r\nab\r\n-ERR 'Authorization Violation'\r\nMSG a 1  0\r\n\r\n";
        let (out, ended) = passed(said).await;
        ended.unwrap();
        assert_eq!(out, said);
    }

    #[tokio::test]
    async fn what_has_no_bound_ends_the_connection_and_does_not_pass() {
        let long = [b'x'; LINE_BYTES_MAX + 1];
        let large = format!("MSG a 1 {}\r\n", MESSAGE_BYTES_MAX + 1);
        for bad in [
            &b"-ERR\r\n"[..],
            b"-ERR \r\n",
            b"INFO\r\n",
            b"PING x\r\n",
            b"MSG a 1 4000000000\r\n",
            b"MSG a 1 99999999999999999999999\r\n",
            b"MSG a 1 -1\r\n",
            b"MSG a\t1 5\t\r\n",
            b"HMSG a 1 5 x\r\n",
            b"PING\n",
            b"msg a 1 2\r\n",
            b"\r\n",
            b"+OK",
            &long,
            large.as_bytes(),
        ] {
            let (out, ended) = passed(bad).await;
            ended.unwrap_err();
            assert!(out.is_empty(), "{}", String::from_utf8_lossy(bad));
        }
        let (out, ended) = passed(b"MSG a 1 5\r\nab").await;
        ended.unwrap();
        assert_eq!(out, b"MSG a 1 5\r\nab");
    }

    #[tokio::test]
    async fn pings_that_nothing_answers_end_the_connection() {
        let (out, ended) = passed(&b"PING\r\n".repeat(PINGS_MAX + 1)).await;
        assert!(ended.unwrap_err().to_string().contains("PING"));
        assert_eq!(out.len(), 6 * PINGS_MAX);
        let pings = AtomicUsize::new(PINGS_MAX);
        outwards(&b"PONG\r\n"[..], Vec::new(), &pings).await.unwrap();
        assert_eq!(pings.into_inner(), 0);
    }

    #[tokio::test]
    async fn nobody_takes_the_place_of_a_gate_that_is_over() {
        let (hub, far) = tokio::io::duplex(1024);
        let mut gate = Gate::before(hub, b"INFO {}\r\n".to_vec(), Pace::Slow).await.unwrap();
        let address = (Ipv4Addr::LOCALHOST, gate.port);
        let mut library = TcpStream::connect(address).await.unwrap();
        let mut heard = [0; 9];
        library.read_exact(&mut heard).await.unwrap();
        assert_eq!(&heard, b"INFO {}\r\n");
        drop(far);
        gate.ended().await;
        drop(gate);
        assert_eq!(library.read(&mut heard).await.unwrap(), 0);
        let taken = TcpListener::bind(address).await.unwrap_err();
        assert_eq!(taken.kind(), ErrorKind::AddrInUse);
        let mut again = TcpStream::connect(address).await.unwrap();
        assert!(again.read(&mut heard).await.map_or(true, |count| count == 0), "it says nothing");
    }

    #[tokio::test(start_paused = true)]
    async fn a_vehicle_takes_a_flood_in_its_own_time() {
        let flood = b"MSG a 1 2\r\n{}\r\n".repeat(1600);
        for (seconds, is_over) in [(9, false), (11, true)] {
            let pings = AtomicUsize::new(0);
            let taking = inwards(&flood[..], Vec::new(), Pace::Slow, &pings);
            let taken = tokio::time::timeout(Duration::from_secs(seconds), taking).await;
            assert_eq!(taken.is_ok(), is_over, "{seconds} s");
        }
    }
}
