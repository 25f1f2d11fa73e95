//! What a replay shows: an incident, as it was judged or as an edited configuration judges it, the last minutes, or the file with which `telltale replay --serve` was started.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use crate::record::file::FileError;
use crate::record::folder;
use crate::record::recorder::Recorder;
use crate::record::summary::Summary;
use crate::record::writer::{Place, write_recent};
use crate::replay::{Recording, ReplayError, Run};
use crate::store::make_folder;
use crate::web::AppState;
use crate::web::http::errors::HttpError;
use crate::web::incidents::WhatIf;

/// Opens the recording that a server shows. It may run by another configuration than it was recorded by.
type OpenFile = dyn Fn() -> Result<Run, ReplayError> + Send + Sync;

/// The recording with which the server was started.
pub struct ServedFile {
    pub name: String,
    open: Arc<OpenFile>,
}

impl ServedFile {
    pub fn new(
        name: String,
        open: impl Fn() -> Result<Run, ReplayError> + Send + Sync + 'static,
    ) -> ServedFile {
        ServedFile { name, open: Arc::new(open) }
    }

    /// # Errors
    /// It cannot be replayed.
    pub fn open(&self) -> Result<Run, ReplayError> {
        (self.open)()
    }
}

impl fmt::Debug for ServedFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("ServedFile").field(&self.name).finish()
    }
}

/// What a replay shows, as it stands in its address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    Incident(u64),
    /// The same by the configuration of this person's last what-if of it.
    WhatIf(u64),
    /// What the recorder's ring held when it was opened.
    Recent,
    /// The file of `telltale replay --serve`.
    File,
}

/// Behind the number of an incident in the address of its replay by an edited configuration.
const WHAT_IF: &str = "-what-if";

impl Subject {
    /// The incident of the store that it shows.
    pub(super) fn incident(self) -> Option<u64> {
        match self {
            Subject::Incident(id) | Subject::WhatIf(id) => Some(id),
            Subject::Recent | Subject::File => None,
        }
    }

    /// It shows what was never shown.
    pub(super) fn is_edited(self) -> bool {
        matches!(self, Subject::WhatIf(_))
    }
}

impl FromStr for Subject {
    type Err = HttpError;

    fn from_str(text: &str) -> Result<Subject, HttpError> {
        match text {
            "recent" => Ok(Subject::Recent),
            "file" => Ok(Subject::File),
            number => match number.strip_suffix(WHAT_IF) {
                Some(number) => number.parse().map(Subject::WhatIf),
                None => number.parse().map(Subject::Incident),
            }
            .map_err(|_| HttpError::NotFound),
        }
    }
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Subject::Incident(id) => id.fmt(f),
            Subject::WhatIf(id) => write!(f, "{id}{WHAT_IF}"),
            Subject::Recent => f.write_str("recent"),
            Subject::File => f.write_str("file"),
        }
    }
}

/// Opens a recording. Blocks.
pub(super) type Open = Box<dyn FnOnce() -> Result<(Run, Option<Temporary>), ReplayError> + Send>;

/// What opens this file of the folder of recordings.
pub(super) fn incident(app: &AppState, file: &str) -> Result<Open, HttpError> {
    let path = app.settings.recordings.as_deref().and_then(|it| folder::path_of(it, file));
    let path = path.filter(|path| path.is_file()).ok_or(HttpError::NoRecording)?;
    Ok(Box::new(move || Ok((Recording::open(&path).and_then(Run::recorded)?, None))))
}

/// What opens the recording of an incident as an edited configuration judges it.
pub(super) fn what_if(app: &AppState, edited: &Arc<WhatIf>, summary: &Summary) -> Result<Open, HttpError> {
    let judged = edited.judged(app, summary)?;
    Ok(Box::new(move || Ok((judged()?, None))))
}

/// What opens the last minutes.
pub(super) fn recent(app: &AppState) -> Result<Open, HttpError> {
    let state = app.settings.recording.as_ref().ok_or(HttpError::NotRecording)?;
    let (recorder, place) = (state.recorder.clone(), state.place.clone());
    Ok(Box::new(move || {
        let (run, folder) = last_minutes(&recorder, &place)?;
        Ok((run, Some(folder)))
    }))
}

/// What opens the file of the server.
pub(super) fn file(app: &AppState) -> Result<Open, HttpError> {
    let file = app.settings.replayed.as_ref().ok_or(HttpError::NotFound)?;
    let open = file.open.clone();
    Ok(Box::new(move || Ok((open()?, None))))
}

fn last_minutes(recorder: &Recorder, place: &Place) -> Result<(Run, Temporary), ReplayError> {
    let folder = Temporary::new()?;
    let path = write_recent(recorder, place, &folder.0)?.ok_or(ReplayError::Empty)?;
    Ok((Recording::open(&path).and_then(Run::recorded)?, folder))
}

/// A folder that only its owner may read, and that is removed with this.
#[derive(Debug)]
pub(super) struct Temporary(PathBuf);

impl Temporary {
    fn new() -> Result<Temporary, ReplayError> {
        let mut random = [0; 8];
        let path = |random: [u8; 8]| {
            std::env::temp_dir().join(format!("telltale-replay-{:016x}", u64::from_le_bytes(random)))
        };
        let made = getrandom::fill(&mut random).map_err(std::io::Error::other);
        let path = path(random);
        made.and_then(|()| make_folder(&path)).map_err(|error| FileError::io(&path, "made", error))?;
        Ok(Temporary(path))
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if let Err(error) = std::fs::remove_dir_all(&self.0) {
            tracing::warn!(%error, "the folder {} is not removed", self.0.display());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_names_what_is_shown() {
        for (text, subject) in [
            ("12", Subject::Incident(12)),
            ("12-what-if", Subject::WhatIf(12)),
            ("recent", Subject::Recent),
            ("file", Subject::File),
        ] {
            assert_eq!((text.parse().ok(), &*subject.to_string()), (Some(subject), text));
        }
        for wrong in ["", "-what-if", "12-what", "x", "recent-what-if", "12-what-if-what-if", "-1"] {
            assert!(wrong.parse::<Subject>().is_err(), "{wrong}");
        }
    }
}
