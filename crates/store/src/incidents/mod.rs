//! Incidents: the summary of each, its note, and whether it is kept.
//!
//! The hashes of a finished recording and of its summary are written with its row in one transaction, into the audit
//! log, so that the chain proves both.

mod bounds;
mod logged;
mod read;
mod write;

use telltale_record::note_file::Beside;
pub use telltale_record::note_file::Note;
use telltale_record::summary::Summary;

pub use bounds::note as clean_note;
pub(crate) use logged::said_again;
pub use logged::{IncidentRecords, Logged, StoredIncident};
pub use read::{INCIDENTS_PAGE_MAX, IncidentFilter, Incidents, OnDisk};
pub use write::Forgotten;
pub(crate) use write::note_largest;

/// An incident in the store.
#[derive(Debug, Clone, PartialEq)]
pub struct Incident {
    pub summary: Summary,
    /// It is never removed. A marked one is kept until somebody says otherwise.
    pub kept: bool,
    pub note: Option<Note>,
}

impl Incident {
    /// The content of the file beside its recording.
    pub fn beside(&self) -> Beside {
        Beside { note: self.note.clone(), kept: Some(self.kept) }
    }
}

#[cfg(test)]
mod tests;
