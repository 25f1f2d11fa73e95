//! The signals that end the program. The first SIGINT or SIGTERM requests the end; a second one ends it at
//! once.

use std::time::{Duration, Instant};

use anyhow::Context as _;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

use crate::clock::Clock;

/// The program ends this long after the first signal, whatever hangs: supervisors and operators count on
/// three seconds. Each step of an end in order has its own time before that, from the same signal.
pub const ENDS_WITHIN: Duration = Duration::from_millis(2600);

/// The log has this long to take the last line.
const LOGGED_WITHIN: Duration = Duration::from_millis(100);

/// The requests to end the program.
pub struct ShutdownSignal {
    requests: watch::Receiver<Requests>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Requests {
    count: u32,
    /// When the first one came.
    first: Option<Instant>,
}

impl ShutdownSignal {
    /// Listens in a thread of its own, which ends the program if nothing else does any more.
    ///
    /// # Errors
    /// If the operating system refuses the handlers or the thread.
    pub fn listen() -> anyhow::Result<ShutdownSignal> {
        let refused = "signals cannot be handled";
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().context(refused)?;
        let (mut interrupt, mut terminate) = {
            let _entered = runtime.enter();
            let listen = |kind| signal(kind).context(refused);
            (listen(SignalKind::interrupt())?, listen(SignalKind::terminate())?)
        };
        let (sender, requests) = watch::channel(Requests::default());
        let clock = Clock::start();
        let listen = async move {
            loop {
                tokio::select! {
                    _ = interrupt.recv() => {}
                    _ = terminate.recv() => {}
                }
                let now = clock.instant(clock.now());
                sender.send_modify(|it| {
                    it.count += 1;
                    it.first = it.first.or(Some(now));
                });
                if sender.borrow().count == 1 {
                    std::thread::spawn(end_in_time);
                }
            }
        };
        let thread = std::thread::Builder::new().name("signals".to_owned());
        thread.spawn(move || runtime.block_on(listen)).context(refused)?;
        Ok(ShutdownSignal { requests })
    }

    /// Waits for the next request. Returns when the first one came.
    pub async fn requested(&mut self) -> Instant {
        if self.requests.changed().await.is_ok()
            && let Some(first) = self.requests.borrow_and_update().first
        {
            return first;
        }
        // The thread lives as long as the program.
        std::future::pending().await
    }
}

/// Ends the program although something hangs.
fn end_in_time() {
    std::thread::sleep(ENDS_WITHIN - LOGGED_WITHIN);
    // The log may be what hangs.
    std::thread::spawn(|| tracing::error!("the end takes too long: what is not on the disk by now is lost"));
    std::thread::sleep(LOGGED_WITHIN);
    // Acknowledged actions are on the disk.
    std::process::exit(0);
}
