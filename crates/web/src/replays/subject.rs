//! The source of a replay: an incident, as it was judged or as an edited configuration judges it, the last minutes,
//! or a file that this server shows, of `telltale replay --serve` or of a fleet's console.

use std::fmt;
use std::path::PathBuf;
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

/// Opens a recording. It may run by another configuration than it was recorded by.
type OpenFile = dyn Fn() -> Result<Run, ReplayError> + Send + Sync;

/// A recording that this server shows.
#[derive(Clone)]
pub struct ServedFile {
    /// For people.
    pub name: String,
    /// The page that "Leave the replay" leads to; empty if there is none.
    pub leave: String,
    open: Arc<OpenFile>,
}

impl ServedFile {
    pub fn new(
        name: String,
        leave: String,
        open: impl Fn() -> Result<Run, ReplayError> + Send + Sync + 'static,
    ) -> ServedFile {
        ServedFile { name, leave, open: Arc::new(open) }
    }

    pub(super) fn opening(&self) -> Open {
        let open = self.open.clone();
        Box::new(move || open())
    }

    /// A recording in a file, as it was judged.
    pub fn of_path(name: String, leave: String, path: PathBuf) -> ServedFile {
        ServedFile::new(name, leave, move || Recording::open(&path).and_then(Run::recorded))
    }
}

/// The recordings that this server shows, by their names in addresses: `file`, or a name with a dot in it.
pub struct ServedFiles(Box<FindFile>);

type FindFile = dyn Fn(&str) -> Option<ServedFile> + Send + Sync;

impl ServedFiles {
    pub fn new(of: impl Fn(&str) -> Option<ServedFile> + Send + Sync + 'static) -> ServedFiles {
        ServedFiles(Box::new(of))
    }

    /// This one alone, as `file`.
    pub fn one(file: ServedFile) -> ServedFiles {
        ServedFiles::new(move |name| (name == FILE).then(|| file.clone()))
    }

    pub(super) fn of(&self, name: &str) -> Option<ServedFile> {
        (self.0)(name)
    }
}

impl fmt::Debug for ServedFiles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ServedFiles")
    }
}

/// The name of the file of `telltale replay --serve` in addresses.
const FILE: &str = "file";

/// The source of a replay, as it stands in its address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Subject {
    Incident(u64),
    /// The same by the configuration of this person's last what-if of it.
    WhatIf(u64),
    /// The content of the recorder's ring when it was opened.
    Recent,
    /// A file that this server shows, by its name.
    File(Arc<str>),
}

/// Behind the number of an incident in the address of its replay by an edited configuration.
const WHAT_IF: &str = "-what-if";

impl Subject {
    /// The incident of the store that it shows.
    pub(super) fn incident(&self) -> Option<u64> {
        match self {
            Subject::Incident(id) | Subject::WhatIf(id) => Some(*id),
            Subject::Recent | Subject::File(_) => None,
        }
    }

    /// It shows what was never shown.
    pub(super) fn is_edited(&self) -> bool {
        matches!(self, Subject::WhatIf(_))
    }
}

impl FromStr for Subject {
    type Err = HttpError;

    fn from_str(text: &str) -> Result<Subject, HttpError> {
        match text {
            "recent" => Ok(Subject::Recent),
            name if name == FILE || name.contains('.') => Ok(Subject::File(name.into())),
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
            Subject::File(name) => f.write_str(name),
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

/// The file of the server with this name.
pub(super) fn file(app: &AppState, name: &str) -> Result<ServedFile, HttpError> {
    app.settings.replayed.as_ref().and_then(|files| files.of(name)).ok_or(HttpError::NotFound)
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
            ("file", Subject::File("file".into())),
            ("shuttle-03.5", Subject::File("shuttle-03.5".into())),
        ] {
            assert_eq!((text.parse().ok(), &*subject.to_string()), (Some(subject.clone()), text));
        }
        for wrong in ["", "-what-if", "12-what", "x", "recent-what-if", "12-what-if-what-if", "-1"] {
            assert!(wrong.parse::<Subject>().is_err(), "{wrong}");
        }
    }
}
