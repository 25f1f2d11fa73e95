//! Opens the outbox, however long its disk keeps it.

use std::time::{Duration, Instant};

use tokio::sync::watch;

use super::note_disk;
use crate::outbox::{Outbox, OutboxError};
use crate::status::Status;

/// An outbox that cannot be opened is tried again after this time.
const OPENED_AGAIN: Duration = Duration::from_secs(10);

/// Tries to open the outbox until that works; `None` if the program ends first.
pub(super) async fn opened(
    open: impl Fn() -> Result<Outbox, OutboxError>,
    status: &watch::Sender<Status>,
    ended: &mut watch::Receiver<Option<Instant>>,
) -> Option<Outbox> {
    loop {
        let opened = open();
        if let Ok(outbox) = opened {
            note_disk(status, None);
            return Some(outbox);
        }
        note_disk(status, opened.err());
        tokio::select! {
            () = tokio::time::sleep(OPENED_AGAIN) => {}
            _ = ended.changed() => return None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outbox::{Limits, Seed};
    use rusqlite::Connection;
    use telltale_engine::time::Timestamp;

    #[tokio::test(start_paused = true)]
    async fn an_outbox_that_is_locked_or_has_no_disk_is_opened_later() {
        let (status, shown) = watch::channel(Status::new(Timestamp::ZERO));
        let (_end, mut ended) = watch::channel(None);
        let attempts = std::cell::Cell::new(0);
        let seed = Seed { first: 1, nonce: 7 };
        let open = || {
            attempts.set(attempts.get() + 1);
            match attempts.get() {
                3 => Outbox::over(Connection::open_in_memory()?, Limits::default(), seed, Timestamp::ZERO),
                _ => Err(OutboxError::Disk(rusqlite::Error::InvalidQuery)),
            }
        };
        let opening = opened(open, &status, &mut ended);
        let look = async {
            tokio::time::sleep(OPENED_AGAIN / 2).await;
            assert!(shown.borrow().disk.is_some());
        };
        let (outbox, ()) = tokio::join!(opening, look);
        assert_eq!((outbox.map(|it| it.last()), attempts.get()), (Some(0), 3));
        assert_eq!(shown.borrow().disk, None);
    }
}
