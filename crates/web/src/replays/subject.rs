//! The source of a replay: an incident, as it was judged or as an edited configuration judges it, the last minutes,
//! or the file with which `telltale replay --serve` was started.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use crate::AppState;
use crate::incidents::WhatIf;
use crate::texts::HttpError;
use telltale_record::file::FileError;
use telltale_record::folder;
use telltale_record::recorder::Recorder;
use telltale_record::summary::Summary;
use telltale_record::writer::{Place, write_recent};
use telltale_replay::{Recording, ReplayError, Run};
use telltale_store::TemporaryFolder;

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

/// The source of a replay, as it stands in its address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    Incident(u64),
    /// The same by the configuration of this person's last what-if of it.
    WhatIf(u64),
    /// The content of the recorder's ring when it was opened.
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
pub(super) type Open = Box<dyn FnOnce() -> Result<Run, ReplayError> + Send>;

/// Opens this file of the folder of recordings.
pub(super) fn incident(app: &AppState, file: &str) -> Result<Open, HttpError> {
    let path = app.settings.recordings.as_deref().and_then(|it| folder::file_in(it, file));
    let path = path.ok_or(HttpError::NoRecording)?;
    Ok(Box::new(move || Recording::open(&path).and_then(Run::recorded)))
}

/// Opens the recording of an incident as an edited configuration judges it.
pub(super) fn what_if(app: &AppState, edited: &Arc<WhatIf>, summary: &Summary) -> Result<Open, HttpError> {
    Ok(Box::new(edited.judged(app, summary)?))
}

/// Opens the last minutes.
pub(super) fn recent(app: &AppState) -> Result<Open, HttpError> {
    let state = app.settings.recording.as_ref().ok_or(HttpError::NotRecording)?;
    let (recorder, place) = (state.recorder.clone(), state.place.clone());
    Ok(Box::new(move || last_minutes(&recorder, &place)))
}

/// Opens the file of the server.
pub(super) fn file(app: &AppState) -> Result<Open, HttpError> {
    let file = app.settings.replayed.as_ref().ok_or(HttpError::NotFound)?;
    let open = file.open.clone();
    Ok(Box::new(move || open()))
}

fn last_minutes(recorder: &Recorder, place: &Place) -> Result<Run, ReplayError> {
    let failed = |error| FileError::io(&std::env::temp_dir(), "written", error);
    let folder = TemporaryFolder::for_replay().map_err(failed)?;
    let path = write_recent(recorder, place, folder.path())?.ok_or(ReplayError::Empty)?;
    // The file is open from here on. It needs no name, so none is left of it whatever happens.
    Recording::open(&path).and_then(Run::recorded)
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
