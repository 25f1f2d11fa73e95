//! The whole way: a foreign DDS peer publishes, the real server aggregates, a WebSocket client
//! receives. `TELLTALE_PEER_PYTHON=... cargo bench --bench end_to_end`.
//!
//! Times are taken on the one monotonic clock of the machine: the peer writes it into the status,
//! the client reads it when the frame is there.

#[allow(dead_code, reason = "the tests use more of it")]
#[path = "../tests/it/peer.rs"]
mod peer;

mod serving;

use std::time::Duration;

use futures_util::StreamExt;
use peer::{Domain, Peer};
use serde_json::{Value, json};
use serving::{Server, monotonic_ns, percentile, sent_ns};

/// How often a second the probe changes its state, and for how many seconds.
const PROBE: &str =
    "load --statuses 1 --rate 20 --seconds 20 --name imu:~status --levels ok --flip --say --mark 7";
const PROBED_S: u64 = 24;

/// 100 arrays a second of 1,000 statuses, beside a probe.
const LOAD: &str = "load --statuses 1000 --rate 100 --seconds 40 --levels ok";

/// Requests to the vehicle that are timed.
const COUNTERMEASURES: usize = 200;

/// A request that stays longer is refused for a reason that does not pass.
const RELEASED_WITHIN_NS: u64 = 20_000_000_000;

/// Receives frames and returns the delays in microseconds, one for each published change.
async fn delays(server: (String, String), path: &str) -> (Vec<f64>, usize) {
    let (address, cookie) = server;
    let mut socket = serving::connect(&address, &cookie, path).await;
    // The first frame shows what an earlier probe left behind.
    let (mut delays, mut last, mut largest) = (Vec::new(), monotonic_ns(), 0);
    let end = tokio::time::sleep(Duration::from_secs(PROBED_S));
    tokio::pin!(end);
    loop {
        let message = tokio::select! {
            () = &mut end => return (delays, largest),
            message = socket.next() => message.expect("the server keeps the socket").expect("a message"),
        };
        let now = monotonic_ns();
        let data = message.into_data();
        if let Some(sent) = sent_ns(&data).filter(|&sent| sent > last) {
            last = sent;
            largest = largest.max(data.len());
            delays.push((now - sent) as f64 / 1000.0);
        }
    }
}

async fn probe(server: &Server, domain: &Domain, what: &str) {
    let tasks = ["/api/v1/stream", "/ws?lang=en"].map(|path| {
        let server = (server.address.clone(), server.cookie.clone());
        tokio::spawn(async move { (path, delays(server, path).await) })
    });
    let (before, _) = server.used();
    let peer = Peer::start(domain, PROBE);
    for task in tasks {
        let (path, (mut delays, bytes)) = task.await.expect("the client ends well");
        delays.sort_by(f64::total_cmp);
        assert!(!delays.is_empty(), "no change arrived on {path}");
        println!(
            "{what:<28} {path:<15} {:>4} changes  p50 {:>5.0} us  p99 {:>6.0} us  worst {:>6.0} us  frame up to {bytes} bytes",
            delays.len(),
            percentile(&delays, 0.5),
            percentile(&delays, 0.99),
            percentile(&delays, 1.0),
        );
    }
    let (after, rss) = server.used();
    println!("{what:<28} {:.1} % of a core, {rss:.1} MB", (after - before) / PROBED_S as f64 * 100.0);
    drop(peer);
}

/// From the status that a foreign peer writes to the request that another one receives; between two
/// of them the operator lets the vehicle go on, so that each is a new one.
fn countermeasures(server: &Server, domain: &Domain, what: &str) {
    let _display = server.open_display();
    let mut active = Peer::start(domain, "pub --topic rt/mission/active --type Bool");
    active.wait_matched(1);
    active.write(&json!({ "bool": true }));
    let mut status = Peer::start(domain, "pub");
    status.wait_matched(1);
    let requests = "rt/telltale/deceleration_request=AccelStamped";
    let mut vehicle = Peer::start(domain, &format!("sub --topic {requests}"));
    let say = |level: u8| json!({ "statuses": [{ "name": "can: wheel_speed", "level": level }] });
    let mut delays = Vec::new();
    while delays.len() < COUNTERMEASURES {
        let sent = status.tell_and_expect(&say(2), "written");
        let at = |line: &Value| line["at_ns"].as_f64().expect("a time");
        // The last repetitions of the request before may be under way still.
        let heard = loop {
            let line = vehicle.expect("at_ns");
            if at(&line) > at(&sent) {
                break line;
            }
        };
        // The first may come before the readers have found one another.
        if !delays.is_empty() || at(&heard) - at(&sent) < 1e8 {
            delays.push((at(&heard) - at(&sent)) / 1000.0);
        }
        status.write(&say(0));
        let deadline = monotonic_ns() + RELEASED_WITHIN_NS;
        while server.snapshot()["countermeasures"].as_array().is_some_and(|all| !all.is_empty()) {
            let answer = server.release();
            assert!(monotonic_ns() < deadline, "the request is not released: {answer}");
        }
        // Repetitions that came meanwhile.
        std::thread::sleep(Duration::from_millis(60));
        vehicle.so_far();
    }
    active.write(&json!({ "bool": false }));
    delays.sort_by(f64::total_cmp);
    println!(
        "{what:<28} countermeasure  {:>4} requests p50 {:>5.0} us  p99 {:>6.0} us  worst {:>6.0} us",
        delays.len(),
        percentile(&delays, 0.5),
        percentile(&delays, 0.99),
        percentile(&delays, 1.0),
    );
}

fn lossless(server: &Server, domain: &Domain, rate: u32) {
    let counters = server.counters();
    let (before, _) = server.used();
    let mut peer =
        Peer::start(domain, &format!("load --statuses 1000 --rate {rate} --seconds 10 --levels ok"));
    let done = peer.expect("done");
    let arrays = done["arrays"].as_u64().unwrap_or(0);
    let deadline = monotonic_ns() + 20_000_000_000;
    let lost = loop {
        let now = server.counters();
        let grown = |key: &str| now[key].as_u64().unwrap_or(0) - counters[key].as_u64().unwrap_or(0);
        if grown("arrays") + grown("lost") >= arrays || monotonic_ns() > deadline {
            break arrays.saturating_sub(grown("arrays"));
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    let (after, rss) = server.used();
    let seconds = done["seconds"].as_f64().unwrap_or(1.0);
    println!(
        "{:>9.0} statuses/s published: {lost} of {arrays} arrays lost, {:.0} % of a core, {rss:.1} MB",
        arrays as f64 * 1000.0 / seconds,
        (after - before) / seconds * 100.0,
    );
}

fn main() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    let domain = Domain::take();
    let unrecorded = Server::with(&domain, "recording: false\n");
    runtime.block_on(async {
        probe(&unrecorded, &domain, "idle, nothing recorded").await;
        let load = Peer::start(&domain, LOAD);
        probe(&unrecorded, &domain, "loaded, nothing recorded").await;
        drop(load);
    });
    drop(unrecorded);
    // Here an incident is being written throughout: the probe keeps turning to WARNING.
    let server = Server::start(&domain);
    runtime.block_on(async {
        probe(&server, &domain, "idle").await;
        countermeasures(&server, &domain, "idle");
        let load = Peer::start(&domain, LOAD);
        probe(&server, &domain, "100 arrays/s of 1,000").await;
        drop(load);
        let load = Peer::start(&domain, "load --statuses 1000 --rate 100 --seconds 60 --levels ok");
        countermeasures(&server, &domain, "100 arrays/s of 1,000");
        drop(load);
    });
    for rate in [800, 1600, 2400, 3200, 4000] {
        lossless(&server, &domain, rate);
    }
}
