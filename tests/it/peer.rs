//! The foreign DDS peers, `tests/dds/peer.py`, as child processes.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

use serde_json::Value;
use telltale::clock::Clock;
use telltale::engine::time::{Span, Timestamp};

/// Nothing here takes longer, even on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// The end of a wait for a value among others that keep coming.
pub struct Limit {
    clock: Clock,
    end: Timestamp,
}

impl Limit {
    pub fn start() -> Limit {
        let clock = Clock::start();
        let end = clock.now() + Span::from_secs(4 * PATIENCE.as_secs());
        Limit { clock, end }
    }

    pub fn is_over(&self) -> bool {
        self.clock.now() >= self.end
    }

    /// True, or the test has failed.
    pub fn holds(&self) -> bool {
        assert!(!self.is_over(), "what the test waits for does not come");
        true
    }
}

/// Whose DDS the foreign peers of a test use.
#[derive(Clone, Copy, Debug)]
pub enum Vendor {
    Cyclone,
    FastDds,
}

/// A DDS domain that no other test uses, in this process or another.
pub struct Domain {
    pub id: u16,
    pub vendor: Vendor,
    /// Held as a lock between processes.
    _lock: TcpListener,
}

impl Domain {
    pub fn take() -> Domain {
        Domain::of(Vendor::Cyclone)
    }

    pub fn of(vendor: Vendor) -> Domain {
        // Domains up to 101 keep their ports below the ephemeral ones. Starting at the process id
        // spreads processes; the lock settles the rest.
        let start = u16::try_from(std::process::id() % 101).expect("less than 101");
        let domains = (0..101).map(|step| 1 + (start + step) % 101);
        domains
            .filter_map(|id| {
                TcpListener::bind(("127.0.0.1", 5200 + id)).ok().map(|_lock| Domain { id, vendor, _lock })
            })
            .next()
            .expect("a free DDS domain for a test")
    }
}

fn needed(variable: &str, what: &str) -> String {
    std::env::var(variable).unwrap_or_else(|_| panic!("{variable} is not set: it names {what}"))
}

pub struct Peer {
    child: Child,
    input: Option<ChildStdin>,
    lines: mpsc::Receiver<Value>,
}

impl Peer {
    /// Starts `peer.py` and waits until it is ready. `arguments` are split at blanks.
    pub fn start(domain: &Domain, arguments: &str) -> Peer {
        Peer::start_by(domain, &[], arguments)
    }

    /// The same, started by another command.
    pub fn start_by(domain: &Domain, by: &[&str], arguments: &str) -> Peer {
        let python = needed(
            "TELLTALE_PEER_PYTHON",
            "a Python that has cyclonedds 11.0.1; `tests/run.sh` makes one, or: python3 -m venv V && \
             V/bin/pip install cyclonedds==11.0.1 && export TELLTALE_PEER_PYTHON=V/bin/python",
        );
        let dds = match domain.vendor {
            Vendor::Cyclone => "cyclone",
            Vendor::FastDds => {
                needed(
                    "TELLTALE_PEER_FASTDDS",
                    "Fast DDS as a library for the peer; `tests/run.sh` makes it of tests/dds/fastdds.cpp, or: \
                     apt-get install g++ libfastrtps-dev libfastcdr-dev && g++ -std=c++17 -shared -fPIC \
                     tests/dds/fastdds.cpp -o fastdds.so -lfastrtps -lfastcdr && export \
                     TELLTALE_PEER_FASTDDS=$PWD/fastdds.so",
                );
                "fastdds"
            }
        };
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/dds/peer.py");
        let mut words = by.iter().copied().chain([&*python, script]);
        let mut child = Command::new(words.next().expect("there are two at least"))
            .args(words)
            .args(["--domain", &domain.id.to_string(), "--dds", dds])
            .args(arguments.split_whitespace())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("TELLTALE_PEER_PYTHON={python} does not start: {error}"));
        let output = BufReader::new(child.stdout.take().expect("it is piped"));
        let (sender, lines) = mpsc::channel();
        std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                let value = serde_json::from_str(&line).unwrap_or(Value::String(line));
                if sender.send(value).is_err() {
                    return;
                }
            }
        });
        let input = child.stdin.take();
        let mut peer = Peer { child, input, lines };
        peer.expect("ready");
        peer
    }

    /// Sends one command of `peer.py pub`.
    pub fn tell(&mut self, command: &Value) {
        self.tell_raw(&command.to_string());
    }

    /// The same, for what is no proper JSON to others.
    pub fn tell_raw(&mut self, command: &str) {
        let input = self.input.as_mut().expect("not closed yet");
        writeln!(input, "{command}").expect("the peer reads its input");
        input.flush().expect("the peer reads its input");
    }

    /// Sends a command and waits until it is done.
    pub fn write(&mut self, command: &Value) {
        self.tell_and_expect(command, "written");
    }

    /// Sends a command and waits for the line that has this key.
    pub fn tell_and_expect(&mut self, command: &Value, key: &str) -> Value {
        self.tell(command);
        self.expect(key)
    }

    /// Waits until so many readers match.
    pub fn wait_matched(&mut self, readers: usize) {
        self.tell(&serde_json::json!({"wait_matched": readers, "timeout": PATIENCE.as_secs()}));
        self.expect("matched");
    }

    /// Ends it as a process that ends by itself.
    pub fn end(mut self) {
        self.input = None;
        self.expect("done");
        // Its participant says goodbye while it ends.
        let _ = self.child.wait();
    }

    /// Ends it as a crash does, without a goodbye.
    pub fn kill(mut self) {
        self.child.kill().expect("it runs");
    }

    /// The next line that has this key.
    pub fn expect(&mut self, key: &str) -> Value {
        let limit = Limit::start();
        loop {
            let line = self.next().filter(|_| limit.holds());
            let line = line.unwrap_or_else(|| panic!("the peer said no {key:?}; see its errors above"));
            if line.get(key).is_some() {
                return line;
            }
        }
    }

    /// The next line; `None` if none comes.
    pub fn next(&mut self) -> Option<Value> {
        self.next_within(PATIENCE)
    }

    /// The same, for a line that may not come.
    pub fn next_within(&mut self, limit: Duration) -> Option<Value> {
        self.lines.recv_timeout(limit).ok()
    }

    /// The lines that are there already.
    pub fn so_far(&mut self) -> Vec<Value> {
        self.lines.try_iter().collect()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // It may have ended by itself, which is as good.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
