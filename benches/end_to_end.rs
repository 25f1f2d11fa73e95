//! The whole way: a foreign DDS peer publishes, the real server aggregates, a WebSocket client
//! receives. `TELLTALE_PEER_PYTHON=... cargo bench --bench end_to_end`.
//!
//! Times are taken on the one monotonic clock of the machine: the peer writes it into the status,
//! the client reads it when the frame is there.

#[allow(dead_code, reason = "the tests use more of it")]
#[path = "../tests/it/peer.rs"]
mod peer;

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use futures_util::StreamExt;
use peer::{Domain, Peer};
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::http::HeaderValue;

/// The probe changes its state so often each second, and for so long.
const PROBE: &str = "load --statuses 1 --rate 20 --seconds 20 --name imu:~status --levels ok --flip --mark 7";
const PROBED_S: u64 = 24;

/// Requests to the vehicle that are timed.
const COUNTERMEASURES: usize = 200;

fn monotonic_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0)
}

struct Server {
    child: Child,
    address: String,
    cookie: String,
    _data: Folder,
}

struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        // What cannot be removed stays in the temporary folder.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

impl Server {
    fn start(domain: &Domain) -> Server {
        let folder = std::env::temp_dir().join(format!("telltale-bench-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a temporary folder");
        let data = Folder(folder);
        let config = write_config(&data.0);
        let program = env!("CARGO_BIN_EXE_telltale");
        let mut user = Command::new(program)
            .args(["user", "add", "bench", "--role", "operator", "--data"])
            .arg(&data.0)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .expect("the program starts");
        user.stdin.take().expect("piped").write_all(b"975310\n975310\n").expect("it reads two lines");
        assert!(user.wait().expect("it ends").success());
        let port =
            TcpListener::bind("127.0.0.1:0").and_then(|it| it.local_addr()).expect("a free port").port();
        let address = format!("127.0.0.1:{port}");
        let child = Command::new(program)
            .args([
                "serve",
                "--interface",
                "127.0.0.1",
                "--listen",
                &address,
                "--domain",
                &domain.id.to_string(),
            ])
            .arg("--config")
            .arg(config)
            .arg("--data")
            .arg(&data.0)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the program starts");
        let mut server = Server { child, address, cookie: String::new(), _data: data };
        while TcpStream::connect(&server.address).is_err() {
            std::thread::sleep(Duration::from_millis(20));
        }
        server.log_in();
        server
    }

    fn log_in(&mut self) {
        let body = "name=bench&secret=975310";
        let head = format!(
            "POST /login HTTP/1.1\r\nHost: {0}\r\nOrigin: http://{0}\r\nContent-Type: application/x-www-form-urlencoded\r\nContent-Length: {1}\r\n",
            self.address,
            body.len()
        );
        let answer = self.exchange(&format!("{head}Connection: close\r\n\r\n{body}"));
        let cookie = answer.split("set-cookie: ").nth(1).and_then(|rest| rest.split(';').next());
        self.cookie = cookie.unwrap_or_else(|| panic!("no session: {answer}")).to_owned();
    }

    fn exchange(&self, request: &str) -> String {
        let mut stream = TcpStream::connect(&self.address).expect("the server listens");
        stream.write_all(request.as_bytes()).expect("the server reads");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("the server answers");
        answer
    }

    fn counters(&self) -> Value {
        self.snapshot()["counters"].clone()
    }

    fn acknowledge(&self, node: &str) {
        let body = format!("version={}", self.snapshot()["seq"]);
        let head = format!(
            "POST /alarms/{node}/acknowledge HTTP/1.1\r\nHost: {0}\r\nOrigin: http://{0}\r\nCookie: {1}\r\nContent-Type: application/x-www-form-urlencoded\r\nContent-Length: {2}\r\n",
            self.address,
            self.cookie,
            body.len()
        );
        self.exchange(&format!("{head}Connection: close\r\n\r\n{body}"));
    }

    fn snapshot(&self) -> Value {
        let answer = self.exchange(&format!(
            "GET /api/v1/snapshot HTTP/1.1\r\nHost: {}\r\nCookie: {}\r\nConnection: close\r\n\r\n",
            self.address, self.cookie
        ));
        let body = answer.split("\r\n\r\n").nth(1).expect("a body");
        let start = body.find('{').expect("an object");
        let end = body.rfind('}').expect("an object");
        serde_json::from_str(&body[start..=end]).expect("JSON")
    }

    /// Seconds of processor time used so far, and resident MB.
    fn used(&self) -> (f64, f64) {
        let pid = self.child.id();
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).expect("it runs");
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
        let ticks = |at: usize| fields[at].parse::<f64>().expect("a number");
        let status = std::fs::read_to_string(format!("/proc/{pid}/status")).expect("it runs");
        let rss = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("it has memory");
        let kib: f64 = rss.trim().trim_end_matches(" kB").parse().expect("a number");
        ((ticks(11) + ticks(12)) / 100.0, kib / 1024.0)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // It may have ended by itself; the benchmark has failed then anyway.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The shuttle, one more group that takes what the load peer publishes, and a countermeasure.
fn write_config(folder: &Path) -> PathBuf {
    let shuttle = concat!(env!("CARGO_MANIFEST_DIR"), "/config/self-diagnosing-shuttle.yaml");
    let text = std::fs::read_to_string(shuttle).expect("the shuttle's configuration");
    let group = "\n  - id: load\n    name: Load\n    match: [{ namespace: /load }]\n\
                 countermeasures: [{ request: decelerate, when: { modules: [can/wheel_speed] } }]\n";
    let path = folder.join("bench.yaml");
    std::fs::write(&path, text.trim_end().to_owned() + group).expect("the folder can be written");
    path
}

/// Receives frames and returns the delays in microseconds, one for each published change.
async fn delays(server: (String, String), path: &str) -> (Vec<f64>, usize) {
    let (address, cookie) = server;
    let mut request = format!("ws://{address}{path}").into_client_request().expect("a good address");
    let header = |text: &str| HeaderValue::from_str(text).expect("plain text");
    request.headers_mut().insert("Cookie", header(&cookie));
    request.headers_mut().insert("Origin", header(&format!("http://{address}")));
    let (mut socket, _) = tokio_tungstenite::connect_async(request).await.expect("the server upgrades");
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

/// The probe's time in a frame: the number of twenty digits that begins with its mark.
fn sent_ns(frame: &[u8]) -> Option<u64> {
    let runs = frame.split(|byte| !byte.is_ascii_digit());
    let marked = runs.filter(|run| run.len() == 20 && run[0] == b'7');
    marked.filter_map(|run| std::str::from_utf8(&run[1..]).ok()?.parse().ok()).max()
}

fn percentile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
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
/// of them the operator acknowledges, so that each is a new one.
fn countermeasures(server: &Server, domain: &Domain, what: &str) {
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
        while server.snapshot()["countermeasures"].as_array().is_some_and(|all| !all.is_empty()) {
            server.acknowledge("can/wheel_speed");
        }
        // What was repeated meanwhile.
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
    let server = Server::start(&domain);
    runtime.block_on(async {
        probe(&server, &domain, "idle").await;
        countermeasures(&server, &domain, "idle");
        let load = Peer::start(&domain, "load --statuses 1000 --rate 100 --seconds 40 --levels ok");
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
