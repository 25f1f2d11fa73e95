//! Reads recordings for pages and programs, beside the async runtime and a bounded number at once.

use std::sync::LazyLock;
use std::time::Duration;

use tokio::sync::Semaphore;
use tokio::task;
use tokio::time::timeout;

use crate::record::folder;
use crate::record::story::{self, Story};
use crate::record::summary::Summary;
use crate::web::AppState;

/// Files that are read at once. More readers wait.
const READERS: usize = 2;
/// A reader waits this long, less than a request may take.
const WAITS: Duration = Duration::from_secs(4);

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

/// What the recording of an incident tells.
pub async fn story(app: &AppState, summary: &Summary) -> Read {
    let folder = app.settings.recordings.as_deref();
    let Some(path) = folder.and_then(|it| folder::path_of(it, &summary.recording.file)) else {
        return Read::Missing;
    };
    let Ok(Ok(place)) = timeout(WAITS, PLACES.acquire()).await else { return Read::Busy };
    let summary = summary.clone();
    let read = task::spawn_blocking(move || {
        // The place is free again when the file is read, whether somebody waits for it or not.
        let _place = place;
        match path.is_file().then(|| story::read(&path, &summary)) {
            None => Read::Missing,
            Some(Ok(story)) => Read::Told(Box::new(story)),
            Some(Err(error)) => Read::Bad(error.to_string()),
        }
    });
    match timeout(WAITS, read).await {
        Ok(Ok(read)) => read,
        Ok(Err(error)) => Read::Bad(error.to_string()),
        Err(_) => Read::Busy,
    }
}
