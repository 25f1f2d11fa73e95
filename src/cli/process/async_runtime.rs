//! The async runtime of a server, where one task that computes for long holds no other up.

use std::time::Duration;

use anyhow::Context as _;
use tokio::runtime::Runtime;

/// A task from outside wakes a thread of the runtime this often.
const WAKES_EVERY: Duration = Duration::from_millis(200);

/// Starts the runtime. Tokio wakes one of its threads for a single task, and while that runs the others may sleep: nobody
/// waits for sockets and timers then, and a STOP is not heard.
///
/// # Errors
/// The operating system refuses a thread.
pub fn start() -> anyhow::Result<Runtime> {
    let refused = "the async runtime cannot be started";
    let runtime = Runtime::new().context(refused)?;
    let handle = runtime.handle().clone();
    let wake = move || {
        loop {
            std::thread::sleep(WAKES_EVERY);
            drop(handle.spawn(async {}));
        }
    };
    std::thread::Builder::new().name("waker".to_owned()).spawn(wake).context(refused)?;
    Ok(runtime)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    #[test]
    fn a_timer_runs_beside_tasks_that_never_yield() {
        let runtime = start().unwrap();
        let (end, ended) = mpsc::channel::<()>();
        let (tell, told) = mpsc::channel();
        runtime.spawn(async move {
            // Longer than a wake, so that the threads sleep.
            tokio::time::sleep(3 * WAKES_EVERY).await;
            tokio::spawn(async move {
                tokio::time::sleep(WAKES_EVERY).await;
                let _ = tell.send(());
            });
            tokio::time::sleep(WAKES_EVERY / 2).await;
            let _ = ended.recv();
        });
        assert_eq!(told.recv_timeout(Duration::from_secs(20)), Ok(()));
        drop(end);
    }
}
