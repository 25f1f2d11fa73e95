//! Tells the store of every incident, and tells the client that marked a moment whether the mark is on the disk.

use std::time::Duration;

use tokio::sync::{mpsc, watch};

use crate::record::recorder::{Mark, Unmarked};
use crate::record::writer::{Fault, News};
use crate::store::Store;
use crate::web::NotMarked;

/// A mark waits this long for the disk.
const MARKED_WITHIN: Duration = Duration::from_secs(1);

/// What was given to the store last.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct BookEntry {
    incident: u64,
    triggers: u64,
    is_stored: bool,
}

/// Waits until a mark is in a file and in the database, and returns the number of its incident.
///
/// # Errors
/// The disk refused it, or has not taken it yet.
pub(super) async fn confirmed(
    mark: Result<Mark, Unmarked>,
    mut entry: watch::Receiver<BookEntry>,
    mut fault: watch::Receiver<Fault>,
) -> Result<u64, NotMarked> {
    let Mark { incident, triggers } = match mark {
        Ok(mark) => mark,
        Err(Unmarked::Off) => return Err(NotMarked::Unsure { incident: None }),
        Err(Unmarked::Full) => return Err(NotMarked::Full),
    };
    let unsure = NotMarked::Unsure { incident: Some(incident) };
    let is_written = |entry: &BookEntry| entry.incident == incident && entry.triggers >= triggers;
    tokio::select! {
        // What is written stays, whatever follows.
        biased;
        Ok(entry) = entry.wait_for(is_written) => {
            if entry.is_stored { Ok(incident) } else { Err(unsure) }
        }
        // A disk that recovers while the incident lasts still gets it.
        Ok(_) = fault.wait_for(Option::is_some) => Err(unsure),
        () = tokio::time::sleep(MARKED_WITHIN) => Err(unsure),
    }
}

/// Tells the store of every incident.
pub(super) async fn keep_books(
    mut news: mpsc::Receiver<News>,
    store: Store,
    write: watch::Sender<BookEntry>,
) {
    while let Some(news) = news.recv().await {
        let stored = match &news {
            News::Begun(summary) => store.incident_opened(summary).await,
            News::Extended(summary) => store.incident_updated(summary).await,
            News::Ended(summary) => store.incident_finished(summary).await,
        };
        if let Err(error) = &stored {
            tracing::error!(%error, "an incident is not in the database; `telltale incident verify` names its file");
        }
        let (News::Begun(summary) | News::Extended(summary) | News::Ended(summary)) = &news;
        write.send_replace(BookEntry {
            incident: summary.id,
            triggers: summary.trigger_count(),
            // Whether the file of an interrupted one has its last triggers is not known.
            is_stored: stored.is_ok() && !summary.recording.interrupted,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_mark_is_confirmed_when_it_is_on_the_disk_and_answered_within_a_second() {
        let (write, entry) = watch::channel(BookEntry::default());
        let (tell, fault) = watch::channel(None);
        let mark = Ok(Mark { incident: 7, triggers: 3 });
        let confirmed = |mark| tokio::spawn(confirmed(mark, entry.clone(), fault.clone()));
        let unsure = Err(NotMarked::Unsure { incident: Some(7) });
        assert_eq!(confirmed(Err(Unmarked::Off)).await.unwrap(), Err(NotMarked::Unsure { incident: None }));
        assert_eq!(confirmed(Err(Unmarked::Full)).await.unwrap(), Err(NotMarked::Full));
        assert_eq!(confirmed(mark).await.unwrap(), unsure, "the disk does not answer");
        let waits = confirmed(mark);
        tokio::task::yield_now().await;
        let written = |incident, triggers, is_stored| {
            write.send_replace(BookEntry { incident, triggers, is_stored });
        };
        for (incident, triggers) in [(6, 9), (7, 2)] {
            written(incident, triggers, true);
            tokio::task::yield_now().await;
            assert!(!waits.is_finished(), "that is without the mark");
        }
        written(7, 3, true);
        assert_eq!(waits.await.unwrap(), Ok(7));
        written(7, 4, false);
        assert_eq!(confirmed(mark).await.unwrap(), unsure, "the database does not take it");
        written(7, 2, true);
        let waits = confirmed(mark);
        tell.send_replace(Some("the disk is full".into()));
        assert_eq!(waits.await.unwrap(), unsure);
        written(7, 3, true);
        assert_eq!(confirmed(mark).await.unwrap(), Ok(7), "what is written stays");
    }
}
