//! The recording of a simulated drive: its incident can be fetched, replayed and judged by another configuration.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context as _;

use super::simulated::Simulated;
use crate::cli::running::server::reload;
use crate::config::Loaded;
use crate::engine::input::Input;
use crate::engine::time::{Span, Timestamp};
use crate::fleet::recordings::Finished;
use crate::record::file::{IncidentFile, JOURNAL, KEYFRAMES};
use crate::record::journal::{Line, Took};
use crate::record::writer::hash_file;

/// A recording that is being written.
pub struct Tape {
    file: IncidentFile,
    /// When the drive began, in nanoseconds since 1970.
    began_ns: u64,
}

impl Tape {
    /// Begins with a vehicle that has not moved yet. It is shown from a while after that.
    ///
    /// # Errors
    /// Of the disk.
    pub fn begin(
        path: &Path,
        vehicle: &Simulated,
        loaded: &Loaded,
        began_ms: i64,
        shown_from: Span,
    ) -> anyhow::Result<Tape> {
        let began_ns = u64::try_from(began_ms).context("the clock is wrong")? * 1_000_000;
        let about = [
            ("start_of_clock_ns".to_owned(), began_ns.to_string()),
            ("shown_from_ns".to_owned(), shown_from.as_nanos().to_string()),
        ];
        let mut file = IncidentFile::create(path, BTreeMap::from(about))?;
        for it in reload::texts(loaded).iter() {
            let name = format!("configuration/{}", it.name);
            file.attach(&name, "application/yaml", began_ns, it.text.as_bytes())?;
        }
        file.json(&KEYFRAMES, began_ns, &vehicle.keyframe())?;
        Ok(Tape { file, began_ns })
    }

    /// Takes what the engine hears.
    ///
    /// # Errors
    /// Of the disk.
    pub fn take(&mut self, at: Timestamp, input: &Input) -> anyhow::Result<()> {
        let took = Took::Input(Cow::Borrowed(input));
        let line = Line { at_ns: at, took, message: None, left_out: None };
        self.file.json(&JOURNAL, self.began_ns + at.as_nanos(), &line)?;
        Ok(())
    }

    /// # Errors
    /// Of the disk.
    pub fn end(self, incident: u64) -> anyhow::Result<Finished> {
        let path = self.file.path().to_owned();
        self.file.finish()?;
        let (sha256, bytes) = (hash_file(&path)?, path.metadata()?.len());
        Ok(Finished { incident, path, sha256, bytes, by_itself: false })
    }
}
