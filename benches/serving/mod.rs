//! The real server as a child process, with a user of each kind that benchmarks need, and the clock
//! that it shares with the peers and the clients.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use futures_util::{SinkExt as _, StreamExt as _};
use serde_json::Value;
use tokio::net::TcpStream as Stream;
use tokio::sync::oneshot;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::http::HeaderValue;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream};

use crate::peer::Domain;

/// Name, role and secret: the operator, and two users who look on.
pub const USERS: [(&str, &str, &str); 3] = [
    ("bench", "operator", "975310"),
    ("watcher", "authority", "lantern-48-harbour"),
    ("guest", "authority", "lantern-49-harbour"),
];

/// The program to measure: the one that `TELLTALE` names, else the one that was built with this.
pub fn program() -> PathBuf {
    std::env::var_os("TELLTALE").map_or_else(|| env!("CARGO_BIN_EXE_telltale").into(), PathBuf::from)
}

/// Opens a socket of a page or a program.
pub async fn connect(address: &str, cookie: &str, path: &str) -> WebSocketStream<MaybeTlsStream<Stream>> {
    let mut request = format!("ws://{address}{path}").into_client_request().expect("a good address");
    let header = |text: &str| HeaderValue::from_str(text).expect("plain text");
    request.headers_mut().insert("Cookie", header(cookie));
    request.headers_mut().insert("Origin", header(&format!("http://{address}")));
    tokio_tungstenite::connect_async(request).await.expect("the server upgrades").0
}

pub fn monotonic_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0)
}

pub struct Server {
    child: Child,
    pub address: String,
    pub cookie: String,
    _data: Folder,
}

struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        // Files that cannot be removed stay in the temporary folder.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

impl Server {
    pub fn start(domain: &Domain) -> Server {
        Server::with(domain, "")
    }

    /// A server with further lines in its configuration.
    pub fn with(domain: &Domain, lines: &str) -> Server {
        let folder = std::env::temp_dir().join(format!("telltale-bench-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a temporary folder");
        let data = Folder(folder);
        let config = write_config(&data.0, lines);
        let program = program();
        for (name, role, secret) in USERS {
            let mut user = Command::new(&program)
                .args(["user", "add", name, "--role", role, "--data"])
                .arg(&data.0)
                .stdin(Stdio::piped())
                .stdout(Stdio::null())
                .spawn()
                .expect("the program starts");
            let typed = format!("{secret}\n{secret}\n");
            user.stdin.take().expect("piped").write_all(typed.as_bytes()).expect("it reads two lines");
            assert!(user.wait().expect("it ends").success());
        }
        let port =
            TcpListener::bind("127.0.0.1:0").and_then(|it| it.local_addr()).expect("a free port").port();
        let address = format!("127.0.0.1:{port}");
        let child = Command::new(&program)
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
        server.cookie = server.log_in(USERS[0]);
        server
    }

    /// The cookie of a new session.
    pub fn log_in(&self, (name, _, secret): (&str, &str, &str)) -> String {
        let body = format!("name={name}&secret={secret}");
        let head = format!(
            "POST /login HTTP/1.1\r\nHost: {0}\r\nOrigin: http://{0}\r\n\
             Content-Type: application/x-www-form-urlencoded\r\nContent-Length: {1}\r\n",
            self.address,
            body.len()
        );
        let answer = self.exchange(&format!("{head}Connection: close\r\n\r\n{body}"));
        let cookie = answer.split("set-cookie: ").nth(1).and_then(|rest| rest.split(';').next());
        cookie.unwrap_or_else(|| panic!("no session: {answer}")).to_owned()
    }

    fn exchange(&self, request: &str) -> String {
        let mut stream = TcpStream::connect(&self.address).expect("the server listens");
        stream.write_all(request.as_bytes()).expect("the server reads");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("the server answers");
        answer
    }

    pub fn counters(&self) -> Value {
        self.snapshot()["counters"].clone()
    }

    fn post(&self, path: &str, body: &str) -> String {
        let head = format!(
            "POST {path} HTTP/1.1\r\nHost: {0}\r\nOrigin: http://{0}\r\nCookie: {1}\r\nAccept: application/json\r\n\
             Content-Type: application/x-www-form-urlencoded\r\nContent-Length: {2}\r\n",
            self.address,
            self.cookie,
            body.len()
        );
        self.exchange(&format!("{head}Connection: close\r\n\r\n{body}"))
    }

    /// Releases the vehicle's countermeasures, in both steps. Returns the answer.
    pub fn release(&self) -> String {
        let asked = self.post("/vehicle/release", &format!("version={}", self.snapshot()["seq"]));
        let token = asked.split("\"token\":\"").nth(1).and_then(|rest| rest.split('"').next());
        match token {
            Some(token) => self.post("/vehicle/release/confirm", &format!("token={token}")),
            None => asked,
        }
    }

    /// Opens a page that confirms what it is shown, in a thread of its own, until the returned sender is
    /// dropped: without a live display no request is released.
    pub fn open_display(&self) -> oneshot::Sender<()> {
        let (address, cookie) = (self.address.clone(), self.cookie.clone());
        let (open, closed) = oneshot::channel();
        std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            runtime.expect("a runtime").block_on(async {
                tokio::select! {
                    () = confirm_beats(&address, &cookie) => {}
                    _ = closed => {}
                }
            });
        });
        open
    }

    pub fn snapshot(&self) -> Value {
        let answer = self.exchange(&format!(
            "GET /api/v1/snapshot HTTP/1.1\r\nHost: {}\r\nCookie: {}\r\nConnection: close\r\n\r\n",
            self.address, self.cookie
        ));
        let body = answer.split("\r\n\r\n").nth(1).expect("a body");
        let start = body.find('{').expect("an object");
        let end = body.rfind('}').expect("an object");
        serde_json::from_str(&body[start..=end]).expect("JSON")
    }

    /// Seconds of processor time used so far, and resident MB, with those of the DDS process.
    pub fn used(&self) -> (f64, f64) {
        let server = self.child.id();
        let tasks = std::fs::read_dir(format!("/proc/{server}/task")).expect("it runs").flatten();
        let children = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("children")).ok());
        let children: String = children.collect();
        let children = children.split_whitespace().filter_map(|pid| pid.parse().ok());
        let sum = |sum: (f64, f64), one: (f64, f64)| (sum.0 + one.0, sum.1 + one.1);
        std::iter::once(server).chain(children).map(used_by).fold((0.0, 0.0), sum)
    }
}

/// Confirms each beat of a page, with the state that it names, until the socket closes.
async fn confirm_beats(address: &str, cookie: &str) {
    let mut socket = connect(address, cookie, "/ws?lang=en").await;
    while let Some(Ok(message)) = socket.next().await {
        let Ok(Value::Object(said)) = serde_json::from_slice(&message.into_data()) else { continue };
        let Some((beat, seq)) = said.get("beat").zip(said.get("seq")) else { continue };
        let shown = serde_json::json!({ "beat": beat, "shown": seq }).to_string();
        if socket.send(shown.into()).await.is_err() {
            return;
        }
    }
}

/// Seconds of processor time that a process used so far, and its share of the resident MB: the processes run the same
/// file, whose pages count once.
fn used_by(pid: u32) -> (f64, f64) {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).expect("it runs");
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let ticks = |at: usize| fields[at].parse::<f64>().expect("a number");
    let sums = std::fs::read_to_string(format!("/proc/{pid}/smaps_rollup")).expect("it runs");
    let share = sums.lines().find_map(|line| line.strip_prefix("Pss:")).expect("it has memory");
    let kib: f64 = share.trim().trim_end_matches(" kB").parse().expect("a number");
    ((ticks(11) + ticks(12)) / 100.0, kib / 1024.0)
}

impl Drop for Server {
    fn drop(&mut self) {
        // It may have ended by itself; the benchmark has failed then anyway.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The shuttle with one more group, for the load peer's statuses, a countermeasure, and further lines.
fn write_config(folder: &Path, lines: &str) -> PathBuf {
    let shuttle = concat!(env!("CARGO_MANIFEST_DIR"), "/config/self-diagnosing-shuttle.yaml");
    let text = std::fs::read_to_string(shuttle).expect("the shuttle's configuration");
    let group = "\n  - id: load\n    name: Load\n    match: [{ namespace: /load }]\n\
                 countermeasures: [{ request: decelerate, when: { modules: [can/wheel_speed] } }]\n";
    let path = folder.join("bench.yaml");
    std::fs::write(&path, text.trim_end().to_owned() + group + lines).expect("the folder can be written");
    path
}

/// The probe's time in a frame: a number of twenty digits, the first being the probe's mark.
pub fn sent_ns(frame: &[u8]) -> Option<u64> {
    let runs = frame.split(|byte| !byte.is_ascii_digit());
    let marked = runs.filter(|run| run.len() == 20 && run[0] == b'7');
    marked.filter_map(|run| std::str::from_utf8(&run[1..]).ok()?.parse().ok()).max()
}

pub fn percentile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}
