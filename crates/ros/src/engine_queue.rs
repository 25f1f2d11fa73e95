//! The queue to the engine, bounded in bytes as well as in number.

use std::collections::VecDeque;
use std::time::Duration;

use tokio::sync::{mpsc, watch};

use telltale_engine::input::Input;
use telltale_msg::received::Stamped;

/// Bytes of messages that may wait for the engine from one topic, apart from the last message.
const WAITING_BYTES_MAX: usize = 16 << 20;

/// Why a topic is no longer read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// As told.
    Stopped,
    /// Nobody takes the inputs any more.
    NobodyListens,
    /// The participant has to be replaced.
    Rebuild(String),
    /// The participant is gone, and nothing was heard lately.
    Lost(String),
}

pub struct EngineQueue {
    inputs: mpsc::Sender<Stamped>,
    stop: watch::Receiver<bool>,
    /// Sizes of the last inputs that were sent, at most as many as the queue holds.
    sizes: VecDeque<usize>,
    bytes: usize,
}

impl EngineQueue {
    pub fn new(inputs: mpsc::Sender<Stamped>, stop: watch::Receiver<bool>) -> EngineQueue {
        EngineQueue { inputs, stop, sizes: VecDeque::new(), bytes: 0 }
    }

    /// Waits while the queue is full. Meanwhile the library keeps the newest samples of the topic and drops
    /// the oldest, which shows as a gap.
    ///
    /// # Errors
    /// The task was stopped while it waited.
    pub async fn send(&mut self, stamped: Stamped, bytes: usize) -> Result<(), End> {
        let EngineQueue { inputs, stop, sizes, bytes: waiting } = self;
        let sent = async {
            loop {
                // At most so many of the sent inputs still wait: others share the queue.
                let queued = inputs.max_capacity() - inputs.capacity();
                while sizes.len() > queued {
                    *waiting -= sizes.pop_front().unwrap_or(0);
                }
                if *waiting <= WAITING_BYTES_MAX {
                    break;
                }
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
            inputs.send(stamped).await.map_err(|_| End::NobodyListens)
        };
        tokio::select! {
            sent = sent => sent?,
            () = stopped(stop) => return Err(End::Stopped),
        }
        sizes.push_back(bytes);
        *waiting += bytes;
        Ok(())
    }
}

/// Ends when `stop` is true, or its sender is gone.
pub async fn stopped(stop: &mut watch::Receiver<bool>) {
    // An error means that the sender is gone: nobody needs the inputs any more.
    let _ = stop.wait_for(|stop| *stop).await;
}

/// The approximate memory of an input that waits for the engine.
pub fn waiting_bytes(input: &Input, body_bytes: usize) -> usize {
    const SMALL: usize = 64;
    match input {
        Input::Diagnostics(_) => body_bytes,
        input => SMALL + input.text_bytes(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_engine::time::Timestamp;

    fn tick() -> Stamped {
        Stamped::new(Input::Tick, Timestamp::ZERO)
    }

    fn queue(queue: usize) -> (EngineQueue, mpsc::Receiver<Stamped>, watch::Sender<bool>) {
        let (inputs, received) = mpsc::channel(queue);
        let (stop, stopped) = watch::channel(false);
        (EngineQueue::new(inputs, stopped), received, stop)
    }

    #[tokio::test(start_paused = true)]
    async fn bytes_hold_back_before_the_queue_is_full() {
        let (mut queue, mut received, _stop) = queue(1000);
        let large = WAITING_BYTES_MAX / 2;
        for _ in 0..3 {
            queue.send(tick(), large).await.unwrap();
        }
        let held = tokio::time::timeout(Duration::from_secs(5), queue.send(tick(), 1));
        assert!(held.await.is_err());
        received.recv().await.unwrap();
        queue.send(tick(), 1).await.unwrap();
    }

    #[tokio::test(start_paused = true)]
    async fn an_end_is_noticed_while_it_waits() {
        let (mut queue, received, stop) = queue(1);
        queue.send(tick(), 1).await.unwrap();
        let (end, _) = tokio::join!(queue.send(tick(), 1), async {
            tokio::time::sleep(Duration::from_secs(1)).await;
            stop.send(true)
        });
        assert_eq!(end, Err(End::Stopped));
        drop(received);
        let (mut queue, received, _stop) = super::tests::queue(1);
        drop(received);
        assert_eq!(queue.send(tick(), 1).await, Err(End::NobodyListens));
    }
}
