//! Two hundred browsers at one vehicle. `TELLTALE_PEER_PYTHON=... cargo bench --bench clients [-- CLIENTS [SECONDS]]`.
//!
//! A foreign DDS peer publishes the shuttle's traffic, and twenty times a second a change to WARNING or back,
//! because the page shows a warning's words at once. The real server serves the operator's page to all clients,
//! and each of them answers as the page does. `TELLTALE` names another program to measure.

#[allow(dead_code, reason = "the tests use more of it")]
#[path = "../tests/it/peer.rs"]
mod peer;
#[allow(dead_code, reason = "another benchmark uses more of it")]
mod serving;

use std::time::Duration;

use futures_util::{SinkExt as _, StreamExt as _};
use peer::{Domain, Peer};
use serde::Deserialize;
use serving::{Server, USERS, connect, monotonic_ns, percentile, program, sent_ns};
use tokio_tungstenite::tungstenite::Message;

const CLIENTS: usize = 200;
const SECONDS: u64 = 30;
/// Sockets of one session. The server allows a few more.
const PER_SESSION: usize = 14;
const CHANGES_PER_S: u64 = 20;
/// The time before the measurement: pages connect, and processor time levels out.
const SETTLING_S: u64 = 3;

/// What one client saw.
#[derive(Default)]
struct Seen {
    /// From publishing a change to its frame, in microseconds.
    delays: Vec<f64>,
    /// Frames before the measurement began.
    unsettled: usize,
    messages: usize,
    bytes: usize,
    /// The longest time without a heartbeat, in milliseconds.
    silence_ms: f64,
}

/// The part of a message that decides the answer.
#[derive(Deserialize)]
struct Said {
    seq: u64,
    beat: Option<u64>,
}

/// Reads messages and answers them, as the page does.
async fn client(address: String, cookie: String, (from_ns, end_ns): (u64, u64)) -> Seen {
    let mut socket = connect(&address, &cookie, "/ws?lang=en").await;
    let (mut seen, mut last, mut beat_ns) = (Seen::default(), monotonic_ns(), monotonic_ns());
    while let Some(message) = socket.next().await {
        let message = message.expect("the server keeps the socket");
        let now = monotonic_ns();
        if now > end_ns {
            break;
        }
        assert!(!message.is_close(), "the server closed: {message}");
        if !message.is_text() {
            continue;
        }
        let data = message.into_data();
        seen.messages += 1;
        seen.bytes += data.len();
        if let Some(sent) = sent_ns(&data).filter(|&sent| sent > last) {
            last = sent;
            if sent < from_ns {
                seen.unsettled += 1;
            } else {
                seen.delays.push((now - sent) as f64 / 1000.0);
            }
        }
        let said: Said = serde_json::from_slice(&data).expect("JSON");
        if said.beat.is_some() {
            seen.silence_ms = seen.silence_ms.max((now - beat_ns) as f64 / 1e6);
            beat_ns = now;
        }
        let answer = format!(r#"{{"shown":{}}}"#, said.seq);
        socket.send(Message::text(answer)).await.expect("the server reads");
    }
    seen
}

/// Processor time of this process so far, in seconds.
fn own_seconds() -> f64 {
    let used = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    used.tv_sec as f64 + used.tv_nsec as f64 / 1e9
}

async fn measure(server: &Server, domain: &Domain, clients: usize, seconds: u64) {
    let sessions = clients.div_ceil(PER_SESSION).max(1);
    let cookies: Vec<String> = (0..sessions).map(|number| server.log_in(USERS[1 + number % 2])).collect();
    let whole = SETTLING_S + seconds;
    let (_, alone_mb) = server.used();
    let traffic = format!("load --statuses 30 --rate 10 --seconds {} --levels ok", whole + 2);
    let changes = format!(
        "load --statuses 1 --rate {CHANGES_PER_S} --seconds {} --name imu:~status --levels ok --flip --say --mark 7",
        whole + 2
    );
    let peers = [Peer::start(domain, &traffic), Peer::start(domain, &changes)];
    let began_ns = monotonic_ns();
    let counted = (began_ns + SETTLING_S * 1_000_000_000, began_ns + whole * 1_000_000_000);
    // The operator's own page is the first of them.
    let cookie = |index: usize| if index == 0 { &server.cookie } else { &cookies[index / PER_SESSION] };
    let tasks: Vec<_> = (0..clients)
        .map(|index| tokio::spawn(client(server.address.clone(), cookie(index).clone(), counted)))
        .collect();
    tokio::time::sleep(Duration::from_secs(SETTLING_S)).await;
    let ((before, _), own) = (server.used(), own_seconds());
    let mut all = Vec::with_capacity(clients);
    for task in tasks {
        all.push(task.await.expect("the client ends well"));
    }
    let ((after, rss_mb), own) = (server.used(), own_seconds() - own);
    drop(peers);
    say(&all, seconds, whole);
    println!(
        "server: {:.1} % of a core, {rss_mb:.1} MB (before the clients: {alone_mb:.1} MB); all clients together: {:.1} % of a core",
        (after - before) / seconds as f64 * 100.0,
        own / seconds as f64 * 100.0,
    );
}

fn say(all: &[Seen], seconds: u64, whole: u64) {
    let mut delays: Vec<f64> = all.iter().flat_map(|seen| seen.delays.iter().copied()).collect();
    let mut worst: Vec<f64> =
        all.iter().map(|seen| seen.delays.iter().copied().fold(0.0, f64::max)).collect();
    let unsettled: usize = all.iter().map(|seen| seen.unsettled).sum();
    assert!(!delays.is_empty(), "no change arrived, but {unsettled} before they counted");
    delays.sort_by(f64::total_cmp);
    worst.sort_by(f64::total_cmp);
    let messages: usize = all.iter().map(|seen| seen.messages).sum();
    let bytes: usize = all.iter().map(|seen| seen.bytes).sum();
    let silence_ms = all.iter().map(|seen| seen.silence_ms).fold(0.0, f64::max);
    println!(
        "publish to frame, {} clients, {seconds} s: {} frames  p50 {:.1} ms  p99 {:.1} ms  worst {:.1} ms",
        all.len(),
        delays.len(),
        percentile(&delays, 0.5) / 1000.0,
        percentile(&delays, 0.99) / 1000.0,
        percentile(&delays, 1.0) / 1000.0,
    );
    println!(
        "each client: {:.0} messages/s, {:.0} kB/s; longest without a heartbeat {silence_ms:.0} ms; the best client's worst {:.1} ms",
        messages as f64 / whole as f64 / all.len() as f64,
        bytes as f64 / whole as f64 / all.len() as f64 / 1000.0,
        percentile(&worst, 0.0) / 1000.0,
    );
}

fn main() {
    // cargo adds `--bench`.
    let mut numbers = std::env::args().skip(1).filter_map(|word| word.parse::<u64>().ok());
    let clients = numbers.next().map_or(CLIENTS, |count| usize::try_from(count).unwrap_or(CLIENTS));
    let seconds = numbers.next().unwrap_or(SECONDS);
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    println!(
        "{}, {} cores, load {}; 30 statuses at 10 Hz and {CHANGES_PER_S} changes of state a second",
        program().display(),
        std::thread::available_parallelism().map_or(0, usize::from),
        load.split(' ').next().unwrap_or_default(),
    );
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    let domain = Domain::take();
    let server = Server::start(&domain);
    runtime.block_on(measure(&server, &domain, clients, seconds));
}
