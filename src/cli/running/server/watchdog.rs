//! What systemd is told of the service: that it is ready, that it lives, and that it ends (sd_notify(3)).
//!
//! The watchdog is fed by a task of the runtime that serves the pages, and only after the way to the pages has
//! been tried. So a hanging engine, a blocked runtime or a lock that is never released stop the feeding.

use std::ffi::OsString;
use std::io;
use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::Duration;

use tokio::task::JoinHandle;
use tokio::time::{MissedTickBehavior, interval, timeout};

use crate::web::{AppState, SelfCheck, Stuck};

/// The way is tried so many times in the interval of the watchdog, so that a single failure has no effect.
const CHECKS_PER_INTERVAL: u32 = 5;
/// Without a watchdog the status is kept up all the same.
const CHECK_EVERY: Duration = Duration::from_secs(2);
const CHECK_EVERY_MIN: Duration = Duration::from_millis(20);

/// The task that feeds, and its socket.
#[derive(Debug)]
pub struct Watchdog {
    systemd: Systemd,
    feeding: JoinHandle<()>,
}

impl Watchdog {
    /// Tells that the service is ready as soon as it is, and feeds the watchdog from then on. `status` is what the
    /// service does while it is well, in a short line. `None` if nobody wants to be told.
    pub fn start(status: &str, app: AppState) -> Option<Watchdog> {
        let systemd = Systemd::from_environment()?;
        let feeding = feed(systemd.clone(), SelfCheck::new(app), status.to_owned());
        Some(Watchdog { systemd, feeding: tokio::spawn(feeding) })
    }

    /// Tells that the service ends.
    pub fn end(self) {
        self.feeding.abort();
        self.systemd.tell("STOPPING=1\nSTATUS=ending\n");
    }
}

async fn feed(systemd: Systemd, check: SelfCheck, status: String) {
    check.is_serving().await;
    let (mut is_told, mut told) = (false, None);
    let mut checks = interval(systemd.check_every);
    checks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut running = None;
    loop {
        checks.tick().await;
        // A check that hangs is waited for: another one would hang at the same place.
        let check = running.get_or_insert_with(|| Box::pin(check.run()));
        let found = match timeout(systemd.check_every, check).await {
            Ok(found) => {
                running = None;
                found.err()
            }
            Err(_) => Some(Stuck::Somewhere),
        };
        if found != told {
            match found {
                Some(stuck) => tracing::error!(
                    "messages do not reach the pages, and systemd is not told that they do: {stuck}"
                ),
                None => tracing::info!("messages reach the pages again"),
            }
        }
        let mut lines = String::new();
        if !is_told {
            lines += "READY=1\n";
        }
        if !is_told || found != told {
            let status = found.map_or_else(|| status.clone(), |stuck| stuck.to_string());
            lines += &format!("STATUS={status}\n");
        }
        if found.is_none() {
            lines += "WATCHDOG=1\n";
        }
        told = found;
        is_told |= !lines.is_empty() && systemd.tell(&lines);
    }
}

/// The socket of systemd.
#[derive(Debug, Clone)]
struct Systemd {
    socket: OsString,
    check_every: Duration,
}

impl Systemd {
    /// By the environment of the process.
    fn from_environment() -> Option<Systemd> {
        let socket = std::env::var_os("NOTIFY_SOCKET").filter(|socket| !socket.is_empty())?;
        let number = |name: &str| std::env::var(name).ok().and_then(|value| value.parse::<u64>().ok());
        // A process that the watchdog does not mean may have inherited its environment.
        let is_meant = number("WATCHDOG_PID").is_none_or(|pid| pid == u64::from(std::process::id()));
        let interval =
            number("WATCHDOG_USEC").filter(|&usec| usec > 0 && is_meant).map(Duration::from_micros);
        let check_every = interval.map_or(CHECK_EVERY, |interval| interval / CHECKS_PER_INTERVAL);
        Some(Systemd { socket, check_every: check_every.max(CHECK_EVERY_MIN) })
    }

    /// Whether systemd was told. One that does not read must not stop the server, so this never waits.
    fn tell(&self, lines: &str) -> bool {
        let told = self.send(lines);
        if let Err(error) = &told {
            tracing::warn!(%error, "systemd cannot be told");
        }
        told.is_ok()
    }

    fn send(&self, lines: &str) -> io::Result<()> {
        let name = self.socket.as_bytes();
        let address = match name.strip_prefix(b"@") {
            Some(name) => SocketAddr::from_abstract_name(name)?,
            None => SocketAddr::from_pathname(&self.socket)?,
        };
        let socket = UnixDatagram::unbound()?;
        socket.set_nonblocking(true)?;
        socket.send_to_addr(lines.as_bytes(), &address).map(|_| ())
    }
}
