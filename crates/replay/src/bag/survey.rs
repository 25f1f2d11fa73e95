//! The facts of a recording before it is read through.

use std::path::Path;
use std::sync::Arc;

use super::Storage;
use telltale_record::file::{ABOUT, Channel, Entry, FileError};

/// Further topics have no definition.
const CHANNELS_MAX: usize = 100_000;

#[derive(Default)]
pub(super) struct Survey {
    pub channels: Vec<Arc<Channel>>,
    pub first_ns: Option<u64>,
    /// `None` once it is not known of a file.
    pub last_ns: Option<u64>,
    /// A file is of Telltale.
    pub is_ours: bool,
    is_cut: bool,
}

impl Survey {
    /// Looks at the next file.
    ///
    /// # Errors
    /// It is no recording.
    pub fn take(&mut self, path: &Path) -> Result<(), FileError> {
        let mut storage = Storage::open(path)?;
        let (channels, last, is_whole) = match &mut storage {
            Storage::Mcap(reader) => {
                self.is_ours |= reader.metadata().any(|(name, _)| name == ABOUT);
                (reader.channels(), reader.span_ns().map(|(_, last)| last), reader.is_complete())
            }
            Storage::Database(database) => (database.channels(), database.last_ns(), true),
        };
        // The times in the index of a file may be those of a message without a time.
        let first = self.first_ns.is_none();
        let mut found = None;
        while let Some(entry) = storage.next_entry() {
            found = found.or(time(&entry));
            // A file that was not completed has its topics in its chunks.
            if is_whole && !channels.is_empty() && (!first || found.is_some()) {
                break;
            }
        }
        if first {
            self.first_ns = found;
        }
        let channels = match &mut storage {
            Storage::Mcap(reader) => reader.channels(),
            Storage::Database(_) => channels,
        };
        self.channels.extend(channels.into_iter().take(CHANNELS_MAX.saturating_sub(self.channels.len())));
        self.is_cut |= last.is_none();
        self.last_ns = if self.is_cut { None } else { self.last_ns.max(last) };
        Ok(())
    }
}

/// When a message was received, or else published.
fn time(entry: &Entry) -> Option<u64> {
    let stamps = entry.stamps()?;
    [stamps.log_time_ns, stamps.publish_time_ns].into_iter().find(|time| *time > 0)
}
