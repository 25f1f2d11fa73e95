//! The end of the program: the first SIGINT or SIGTERM requests it, a second one ends it at once.

use std::time::Duration;

use anyhow::Context as _;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

/// So long after the first signal the program is over, whatever hangs: a supervisor, and who sits at the
/// vehicle, count on three seconds.
const OVER: Duration = Duration::from_millis(2600);

/// Listens for the signals that ask a program to end.
pub struct Ending {
    asked: watch::Receiver<u32>,
}

impl Ending {
    /// From a thread of its own, which ends the program where nothing else does any more.
    ///
    /// # Errors
    /// If the operating system refuses the handlers or the thread.
    pub fn listen() -> anyhow::Result<Ending> {
        let refused = "signals cannot be handled";
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().context(refused)?;
        let (mut interrupt, mut terminate) = {
            let _entered = runtime.enter();
            let listen = |kind| signal(kind).context(refused);
            (listen(SignalKind::interrupt())?, listen(SignalKind::terminate())?)
        };
        let (asks, asked) = watch::channel(0);
        let listen = async move {
            loop {
                tokio::select! {
                    _ = interrupt.recv() => {}
                    _ = terminate.recv() => {}
                }
                asks.send_modify(|count| *count += 1);
                if *asks.borrow() == 1 {
                    std::thread::spawn(|| {
                        std::thread::sleep(OVER);
                        // What is acknowledged is on the disk; nobody waits for the rest.
                        std::process::exit(0);
                    });
                }
            }
        };
        let thread = std::thread::Builder::new().name("ending".to_owned());
        thread.spawn(move || runtime.block_on(listen)).context(refused)?;
        Ok(Ending { asked })
    }

    /// Waits for the next of them.
    pub async fn asked(&mut self) {
        if self.asked.changed().await.is_err() {
            // The thread lives as long as the program.
            std::future::pending().await
        }
    }
}
