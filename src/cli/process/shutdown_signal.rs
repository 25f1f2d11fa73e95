//! The signals that end the program. The first SIGINT or SIGTERM requests the end; a second one ends it at
//! once.

use std::time::Duration;

use anyhow::Context as _;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

/// The program ends this long after the first signal, whatever hangs: supervisors and operators count on
/// three seconds.
const ENDS_WITHIN: Duration = Duration::from_millis(2600);

/// The requests to end the program.
pub struct ShutdownSignal {
    requests: watch::Receiver<u32>,
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
        let (sender, requests) = watch::channel(0);
        let listen = async move {
            loop {
                tokio::select! {
                    _ = interrupt.recv() => {}
                    _ = terminate.recv() => {}
                }
                sender.send_modify(|count| *count += 1);
                if *sender.borrow() == 1 {
                    std::thread::spawn(|| {
                        std::thread::sleep(ENDS_WITHIN);
                        // Acknowledged actions are on the disk; nobody waits for the rest.
                        std::process::exit(0);
                    });
                }
            }
        };
        let thread = std::thread::Builder::new().name("signals".to_owned());
        thread.spawn(move || runtime.block_on(listen)).context(refused)?;
        Ok(ShutdownSignal { requests })
    }

    /// Waits for the next request.
    pub async fn requested(&mut self) {
        if self.requests.changed().await.is_err() {
            // The thread lives as long as the program.
            std::future::pending().await
        }
    }
}
