//! Records incidents while the display runs: the recorder, the writer of files, the store's knowledge of them,
//! and their removal when they are old.

mod books;
mod tidying;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use tokio::sync::{mpsc, watch};
use tokio::task;

use self::books::{BookEntry, confirmed, keep_books};
use self::tidying::{Kept, look_after};
use super::timekeeping::WatchedRecording;
use super::{left_over, reload};
use crate::clock::Clock;
use crate::config::Loaded;
use crate::engine::time::Span;
use crate::msg::fields::Definitions;
use crate::record::feed::{Feed, Turns};
use crate::record::folder;
use crate::record::incident::Margins;
use crate::record::recorder::{Recorder, Settings};
use crate::record::retention::Policy;
use crate::record::room::Room;
use crate::record::writer::{self, Fault, NEWS_MAX, Place, VEHICLE};
use crate::runtime::Link;
use crate::store::{Store, TemporaryFolder};
use crate::web::{Marker, RecordingState};
use crate::yaml::private_file::make_folder;

/// A recording begins at most this much before its pre-roll.
const MEMORY_MAX: Span = Span::from_secs(120);

/// A disk that takes no longer for a piece of a recording does not hang.
const ANSWERS_WITHIN: Span = Span::from_secs(3);

/// A disk that hangs is looked for this often.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// A running recording.
#[derive(Debug)]
pub struct Recording {
    recorder: Recorder,
    place: Place,
    /// Why nothing can be recorded.
    fault: watch::Receiver<Fault>,
    /// Kept recordings take more than they may.
    kept_too_much: watch::Receiver<bool>,
    entry: watch::Receiver<BookEntry>,
    policy: watch::Sender<Policy>,
    writer: JoinHandle<()>,
    books: task::JoinHandle<()>,
    watching: task::JoinHandle<()>,
    tidying: task::JoinHandle<()>,
    _temporary: Option<TemporaryFolder>,
}

/// What a recording needs of its surroundings.
#[derive(Debug)]
pub struct Around {
    pub folder: Folder,
    pub definitions: Definitions,
    pub is_demo: bool,
}

/// The folder of the recordings.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    temporary: Option<TemporaryFolder>,
}

impl Folder {
    /// In a data folder, or in one that ends with the program and that nobody can guess.
    ///
    /// # Errors
    /// None can be made.
    pub fn of(data: Option<&Path>) -> anyhow::Result<Folder> {
        Ok(match data {
            Some(data) => Folder { path: folder::folder_in(data), temporary: None },
            None => {
                let made = TemporaryFolder::for_demo().context("there is no folder for recordings")?;
                Folder { path: folder::folder_in(made.path()), temporary: Some(made) }
            }
        })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// The two ends of a queue between the engine and the recorder, if the configuration records.
pub fn queue(loaded: &Loaded, clock: Clock) -> (Option<Feed>, Option<Turns>) {
    loaded.recording.as_ref().map(|_| Feed::new(clock)).unzip()
}

/// Starts to record what comes through the queue.
///
/// # Errors
/// If a thread cannot be started. A database or a folder that is of no use is a fault of the recording, not of
/// the start.
pub async fn start(
    loaded: &Loaded,
    turns: Turns,
    link: &Link,
    store: &Store,
    Around { folder, definitions, is_demo }: Around,
    clock: Clock,
) -> anyhow::Result<Option<Recording>> {
    let (Some(settings), Some(policy)) = (settings(loaded), policy(loaded)) else { return Ok(None) };
    let Folder { path: folder, temporary } = folder;
    if let Err(error) = make_folder(&folder) {
        tracing::error!(%error, "the folder {} cannot be made", folder.display());
    }
    left_over::make_whole(store, &folder, &policy, |_| false).await;
    let files = folder::numbers(&folder).unwrap_or_default();
    let largest = files.last().copied().unwrap_or(0);
    let number = store.next_incident_number(largest).await.unwrap_or_else(|error| {
        tracing::error!(%error, "incidents are numbered after the files that are there");
        largest + 1
    });
    let first = link.snapshots.borrow().snapshot.clone();
    let recorder =
        Recorder::start(turns, first, settings, number, clock).context("no thread can be started")?;
    let (tell, news) = mpsc::channel(NEWS_MAX);
    let mut about = BTreeMap::from([(VEHICLE.to_owned(), loaded.model.vehicle_id.to_string())]);
    if is_demo {
        // The demo's configuration has more time than its text says.
        about.insert("demo".to_owned(), "true".to_owned());
    }
    let place = Place { folder: folder.clone(), definitions, about };
    let (of_writer, faults_of_writer) = watch::channel(None);
    let room = Room::new(&policy);
    let writer = writer::start(&recorder, place.clone(), room.clone(), tell, of_writer)
        .context("no thread can be started")?;
    let (fault, faults) = watch::channel(None);
    let (policy, policies) = watch::channel(policy);
    let (write, entry) = watch::channel(BookEntry::default());
    let books = tokio::spawn(keep_books(news, store.clone(), write));
    let watching = tokio::spawn(watch_disk(faults_of_writer, fault, recorder.clone(), folder.clone()));
    let (tell_kept, kept_too_much) = watch::channel(false);
    let kept = Kept { store: store.clone(), folder, recorder: recorder.clone(), room, clock };
    let tidying = tokio::spawn(look_after(policies, kept, files, tell_kept));
    Ok(Some(Recording {
        recorder,
        place,
        fault: faults,
        kept_too_much,
        entry,
        policy,
        writer,
        books,
        watching,
        tidying,
        _temporary: temporary,
    }))
}

impl Recording {
    /// Marks moments for the pages. A mark that the disk does not take is not promised.
    pub fn marker(&self) -> Marker {
        let (recorder, fault, entry) = (self.recorder.clone(), self.fault.clone(), self.entry.clone());
        Marker::new(move |by, note| {
            // Also where the disk has a fault: a disk that recovers meanwhile still gets it.
            let mark = recorder.mark(by, note);
            Box::pin(confirmed(mark, entry.clone(), fault.clone()))
        })
    }

    pub fn watched(&self, unrecorded: watch::Receiver<bool>) -> WatchedRecording {
        WatchedRecording {
            recorder: self.recorder.clone(),
            fault: self.fault.clone(),
            kept_too_much: self.kept_too_much.clone(),
            unrecorded,
        }
    }

    /// What pages say of the recording.
    pub fn state(&self) -> RecordingState {
        RecordingState {
            recorder: self.recorder.clone(),
            place: self.place.clone(),
            fault: self.fault.clone(),
            policy: self.policy.subscribe(),
        }
    }

    /// Records by another configuration from now on. Whether it records at all is decided at the start.
    pub fn follow(&self, loaded: &Loaded) {
        match (settings(loaded), policy(loaded)) {
            (Some(settings), Some(policy)) => {
                self.recorder.follow_settings(settings);
                self.policy.send_replace(policy);
            }
            _ => tracing::warn!("incidents are recorded until the next start"),
        }
    }

    /// Waits until the last incident is written, but no longer than `until`. The engine must have ended.
    pub async fn end(self, until: Instant) {
        let Recording { writer, books, watching, tidying, _temporary, .. } = self;
        tidying.abort();
        watching.abort();
        let last = async {
            let written = task::spawn_blocking(move || writer.join().is_ok()).await;
            written.is_ok_and(|written| written) && books.await.is_ok()
        };
        if tokio::time::timeout_at(until.into(), last).await != Ok(true) {
            tracing::error!("the last incident is not whole: the next start completes its file");
        }
    }
}

fn settings(loaded: &Loaded) -> Option<Settings> {
    let recording = loaded.recording.as_ref()?;
    Some(Settings {
        margins: Margins { before: recording.before, after: recording.after },
        memory: usize::try_from(recording.memory).unwrap_or(usize::MAX),
        longest_memory: loaded.model.longest_memory().min(MEMORY_MAX),
        configuration: reload::texts(loaded),
    })
}

fn policy(loaded: &Loaded) -> Option<Policy> {
    loaded.recording.as_ref().map(|recording| Policy::new(recording.disk, recording.keep))
}

/// Tells why nothing can be recorded: what the writer met, or that the disk does not answer it.
async fn watch_disk(
    mut of_writer: watch::Receiver<Fault>,
    tell: watch::Sender<Fault>,
    recorder: Recorder,
    folder: PathBuf,
) {
    let hangs: Arc<str> = format!(
        "the disk of {} has not answered for {} s",
        folder.display(),
        ANSWERS_WITHIN.as_millis() / 1000
    )
    .into();
    loop {
        let is_hanging = recorder.waits_for_disk().is_some_and(|waits| waits >= ANSWERS_WITHIN);
        let found = if is_hanging { Some(hangs.clone()) } else { of_writer.borrow_and_update().clone() };
        tell.send_if_modified(|said| {
            let is_new = *said != found;
            said.clone_from(&found);
            is_new
        });
        // A disk that hangs reports nothing.
        if let Ok(Err(_)) = tokio::time::timeout(LOOK_EVERY, of_writer.changed()).await {
            return;
        }
    }
}
