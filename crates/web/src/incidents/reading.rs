//! Reads recordings for pages, reports and programs: in a server beside the async runtime, and a bounded number at once.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::Semaphore;
use tokio::task;
use tokio::time::timeout;

use crate::AppState;
use telltale_record::folder;
use telltale_record::proof::{Proof, compare};
use telltale_record::story::{self, Series, Story};
use telltale_record::summary::Summary;
use telltale_replay::series::series;
use telltale_replay::{Playback, Recording, ReplayError, Run};
use telltale_store::Logged;

/// Files that are read at once. More readers wait.
const READERS: usize = 2;
/// A reader waits this long, less than a request may take.
const WAITS: Duration = Duration::from_secs(4);
/// A larger file is not compared with its hash for a page: that takes longer than a reader waits.
const COMPARED_BYTES_MAX: u64 = 256 << 20;
/// The numbers of a larger recording are not looked for: a replay of it takes longer than a reader waits.
const REPLAYED_BYTES_MAX: u64 = 64 << 20;
/// A page waits this long for the numbers; a request may take ten seconds in all.
const NUMBERS_WITHIN: Duration = Duration::from_millis(1500);
/// Recordings whose numbers are remembered.
const NUMBERS_MAX: usize = 32;

static PLACES: LazyLock<Semaphore> = LazyLock::new(|| Semaphore::new(READERS));

/// The result of reading a recording.
#[derive(Debug)]
pub enum Read {
    Told(Box<Story>),
    /// There is no file.
    Missing,
    /// It is no recording, or the disk cannot read it.
    Bad(String),
    /// Others are read.
    Busy,
}

/// The story of the recording in this folder, with its numbers. Blocks.
pub fn read(folder: &Path, summary: &Summary) -> Read {
    let mut read = read_story(folder, summary);
    if let Read::Told(story) = &mut read
        && let Some(path) = replayable(folder, summary)
    {
        take_numbers(story, numbers(&path, summary));
    }
    read
}

/// The story of the recording in this folder, without a replay. Blocks.
fn read_story(folder: &Path, summary: &Summary) -> Read {
    let Some(path) = folder::file_in(folder, &summary.recording.file) else { return Read::Missing };
    match story::read(&path, summary) {
        Ok(story) => Read::Told(Box::new(story)),
        Err(error) => Read::Bad(error.to_string()),
    }
}

/// The file, if it is whole and not too long for a replay.
fn replayable(folder: &Path, summary: &Summary) -> Option<PathBuf> {
    let recording = &summary.recording;
    let is_replayed = recording.finished && recording.bytes <= REPLAYED_BYTES_MAX;
    folder::file_in(folder, &recording.file).filter(|_| is_replayed)
}

fn take_numbers(story: &mut Story, numbers: Result<Vec<Series>, String>) {
    match numbers {
        Ok(series) => story.series = series,
        Err(why) => story.left_out.push(format!("it cannot be replayed: {why}")),
    }
}

/// The numbers of the nodes that an incident is about, and of the vehicle. Blocks.
fn numbers(path: &Path, summary: &Summary) -> Result<Vec<Series>, String> {
    let found = || {
        let mut playback = Playback::open(Run::recorded(Recording::open(path)?)?)?;
        series(&mut playback, &summary.causes())
    };
    found().map_err(|error: ReplayError| error.to_string())
}

/// The numbers of a recording that were looked for; `None` while a replay looks for them.
type Numbers = Option<Result<Vec<Series>, String>>;

/// A recording by its file and length.
type Key = (PathBuf, u64);

/// The last searches, the newest at the end.
static NUMBERS: LazyLock<Mutex<VecDeque<(Key, Numbers)>>> = LazyLock::new(Mutex::default);

fn known_numbers(key: &Key) -> Option<Numbers> {
    let known = NUMBERS.lock().unwrap_or_else(PoisonError::into_inner);
    known.iter().find(|(it, _)| it == key).map(|(_, numbers)| numbers.clone())
}

fn remember_numbers(key: Key, numbers: Numbers) {
    let mut known = NUMBERS.lock().unwrap_or_else(PoisonError::into_inner);
    known.retain(|(it, _)| *it != key);
    if known.len() >= NUMBERS_MAX {
        known.pop_front();
    }
    known.push_back((key, numbers));
}

/// Adds the numbers, if a replay finds them soon. It goes on in the background for the next reader.
async fn with_numbers(app: &AppState, summary: &Summary, mut read: Read) -> Read {
    let (Read::Told(story), Some(folder)) = (&mut read, &app.settings.recordings) else { return read };
    let Some(path) = replayable(folder, summary) else { return read };
    let key = (path, summary.recording.bytes);
    if known_numbers(&key).is_none() {
        remember_numbers(key.clone(), None);
        let (key, summary) = (key.clone(), summary.clone());
        let looking = tokio::spawn(async move {
            let Ok(_place) = PLACES.acquire().await else { return };
            let path = key.0.clone();
            let found = task::spawn_blocking(move || numbers(&path, &summary)).await;
            remember_numbers(key, Some(found.unwrap_or_else(|error| Err(error.to_string()))));
        });
        let _ = timeout(NUMBERS_WITHIN, looking).await;
    }
    match known_numbers(&key).flatten() {
        Some(numbers) => take_numbers(story, numbers),
        None => story.series_pending = true,
    }
    read
}

/// The story of an incident's recording, and whether the file is as it was recorded.
pub async fn story(app: &AppState, summary: &Summary) -> (Read, Proof) {
    // A log that cannot be read is a fault of the database, which is told elsewhere.
    let logged = app.store.incident_logged(summary.id).await.ok().flatten();
    let expected = Logged::expected(logged, summary);
    let both = move |folder: &Path, summary: &Summary| {
        let path = folder::file_in(folder, &summary.recording.file);
        let proof = path.map_or(Proof::None, |path| compare(&path, &expected, COMPARED_BYTES_MAX));
        (read_story(folder, summary), proof)
    };
    let (read, proof) = in_turn(app, summary, both).await.unwrap_or_else(|without| (without, Proof::None));
    (with_numbers(app, summary, read).await, proof)
}

/// Does something with the folder of the recordings when it is this reader's turn.
async fn in_turn<T: Send + 'static>(
    app: &AppState,
    summary: &Summary,
    work: impl FnOnce(&Path, &Summary) -> T + Send + 'static,
) -> Result<T, Read> {
    let folder: PathBuf = app.settings.recordings.clone().ok_or(Read::Missing)?;
    let Ok(Ok(place)) = timeout(WAITS, PLACES.acquire()).await else { return Err(Read::Busy) };
    let summary = summary.clone();
    let done = task::spawn_blocking(move || {
        // The place is free again when the file is read, whether somebody waits for it or not.
        let _place = place;
        work(&folder, &summary)
    });
    match timeout(WAITS, done).await {
        Ok(Ok(done)) => Ok(done),
        Ok(Err(error)) => Err(Read::Bad(error.to_string())),
        Err(_) => Err(Read::Busy),
    }
}
