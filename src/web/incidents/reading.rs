//! Reads recordings for pages, reports and programs: in a server beside the async runtime, and a bounded number at once.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::Duration;

use tokio::sync::Semaphore;
use tokio::task;
use tokio::time::timeout;

use crate::record::folder;
use crate::record::story::{self, Series, Story};
use crate::record::summary::Summary;
use crate::record::writer::hash_file;
use crate::replay::series::series;
use crate::replay::{Playback, Recording, ReplayError, Run};
use crate::web::AppState;

/// Files that are read at once. More readers wait.
const READERS: usize = 2;
/// A reader waits this long, less than a request may take.
const WAITS: Duration = Duration::from_secs(4);
/// A larger file is not compared with its hash for a page: that takes longer than a reader waits.
const COMPARED_BYTES_MAX: u64 = 256 << 20;
/// The numbers of a larger recording are not looked for: a replay of it takes longer than a reader waits.
const REPLAYED_BYTES_MAX: u64 = 64 << 20;

static PLACES: LazyLock<Semaphore> = LazyLock::new(|| Semaphore::new(READERS));

/// What came of reading a recording.
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

/// Whether a recording is as it was recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Proof {
    Same,
    /// Its SHA-256 is this one.
    Other(String),
    /// It was not compared, or has no hash.
    None,
}

/// What the recording in this folder tells. Blocks.
pub fn read(folder: &Path, summary: &Summary) -> Read {
    let path = folder::path_of(folder, &summary.recording.file);
    let Some(path) = path.filter(|path| path.is_file()) else { return Read::Missing };
    match story::read(&path, summary) {
        Ok(mut story) => {
            if summary.recording.finished && summary.recording.bytes <= REPLAYED_BYTES_MAX {
                match numbers(&path, summary) {
                    Ok(series) => story.series = series,
                    Err(error) => story.left_out.push(format!("it cannot be replayed: {error}")),
                }
            }
            Read::Told(Box::new(story))
        }
        Err(error) => Read::Bad(error.to_string()),
    }
}

/// The numbers of the nodes that an incident is about, and of the vehicle.
fn numbers(path: &Path, summary: &Summary) -> Result<Vec<Series>, ReplayError> {
    let mut playback = Playback::open(Run::recorded(Recording::open(path)?)?)?;
    series(&mut playback, &summary.causes())
}

/// Compares the recording in this folder with the hash that it had. Blocks.
pub fn compare(folder: &Path, summary: &Summary) -> Proof {
    let path = folder::path_of(folder, &summary.recording.file);
    let found = path.and_then(|path| hash_file(&path).ok());
    match (found, &summary.recording.sha256) {
        (Some(found), Some(recorded)) if found == *recorded => Proof::Same,
        (Some(found), Some(_)) => Proof::Other(found),
        _ => Proof::None,
    }
}

/// What the recording of an incident tells.
pub async fn story(app: &AppState, summary: &Summary) -> Read {
    in_turn(app, summary, read).await.unwrap_or_else(|without| without)
}

/// The same, and whether it is as it was recorded.
pub async fn story_with_proof(app: &AppState, summary: &Summary) -> (Read, Proof) {
    let both = |folder: &Path, summary: &Summary| {
        let proof = match summary.recording.bytes {
            ..=COMPARED_BYTES_MAX => compare(folder, summary),
            _ => Proof::None,
        };
        (read(folder, summary), proof)
    };
    in_turn(app, summary, both).await.unwrap_or_else(|without| (without, Proof::None))
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
