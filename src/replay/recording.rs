//! A recording that is opened for a replay: what it says of itself, and its configuration.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use crate::config::patience::patient;
use crate::config::{self, Loaded};
use crate::engine::time::Timestamp;
use crate::msg::fields::Definitions;
use crate::record::file::{ABOUT, FileError, Reader};
use crate::record::ring::ConfigurationText;
use crate::yaml::Problems;

/// The folder of the attachments with the files of the configuration.
const CONFIGURATION: &str = "configuration/";

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("the recording has no configuration of its own: name one with --config")]
    NoConfiguration,
    #[error("the recorded configuration cannot be read by this version; name one with --config\n{0}")]
    Configuration(Problems),
    #[error("the configuration needs what the recording does not define: {0}")]
    Definitions(String),
    #[error("the recording has no messages")]
    Empty,
}

/// A recording, and what it says of itself.
pub struct Recording {
    pub(super) reader: Reader<File>,
    pub(super) facts: Facts,
}

/// What a recording says of itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Facts {
    /// It was made by Telltale: it has a journal, and the states of the engine.
    pub has_journal: bool,
    /// The wall time at which the engine's clock was zero.
    pub zero: SystemTime,
    /// The first instant that is shown.
    pub from: Timestamp,
    /// The last time in the file; `None` if it was not completed.
    pub to: Option<Timestamp>,
    /// The number of the incident.
    pub incident: Option<u64>,
    pub vehicle: String,
    /// The demo's vehicle has more time than its configuration says.
    is_demo: bool,
    /// The files of its configuration, the main one first.
    pub configuration: Arc<[ConfigurationText]>,
}

impl Facts {
    /// The wall time at an instant of the engine's clock.
    pub fn wall(&self, at: Timestamp) -> SystemTime {
        self.zero + Duration::from_nanos(at.as_nanos())
    }

    /// The instant of the engine's clock at this wall time, in nanoseconds since 1970.
    pub fn at(&self, unix_ns: u64) -> Timestamp {
        let zero = self.zero.duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
        Timestamp::from_nanos(unix_ns.saturating_sub(u64::try_from(zero).unwrap_or(u64::MAX)))
    }

    /// Reads a recorded configuration as it counted when it was recorded.
    ///
    /// # Errors
    /// This version cannot read it.
    pub fn load(&self, texts: &[ConfigurationText]) -> Result<Loaded, ReplayError> {
        let texts = texts.iter().map(|it| (it.name.clone(), it.text.clone()));
        let loaded = config::of_texts(texts).map_err(ReplayError::Configuration)?;
        Ok(if self.is_demo { patient(loaded) } else { loaded })
    }
}

impl Recording {
    /// # Errors
    /// It is no MCAP file with messages, or the disk cannot read it.
    pub fn open(path: &Path) -> Result<Recording, ReplayError> {
        let mut reader = Reader::open(path)?;
        let none = BTreeMap::new();
        let about = reader.metadata().find(|(name, _)| *name == ABOUT).map(|(_, about)| about.clone());
        let has_journal = about.is_some();
        let about = about.unwrap_or(none);
        let number = |key: &str| about.get(key).and_then(|text| text.parse::<u64>().ok());
        let span = reader.span_ns();
        let first = span.map(|(first, _)| first).or_else(|| first_time(path)).ok_or(ReplayError::Empty)?;
        let zero_ns = number("start_of_clock_ns").unwrap_or(first);
        let configuration = configuration(&mut reader);
        let mut facts = Facts {
            has_journal,
            zero: UNIX_EPOCH + Duration::from_nanos(zero_ns),
            from: Timestamp::from_nanos(number("shown_from_ns").unwrap_or_default()),
            to: None,
            incident: number("incident"),
            vehicle: about.get("vehicle").cloned().unwrap_or_default(),
            is_demo: about.get("demo").is_some_and(|demo| demo == "true"),
            configuration,
        };
        facts.to = span.map(|(_, last)| facts.at(last));
        Ok(Recording { reader, facts })
    }

    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// Adds the definitions of the recording's own types, which come first.
    pub fn define(&mut self, mut definitions: Definitions) -> Definitions {
        for channel in self.reader.channels() {
            if let Some(text) = &channel.definition {
                definitions.give(&channel.type_name, text);
            }
        }
        definitions
    }
}

/// The time of the first message of a file without chunks.
fn first_time(path: &Path) -> Option<u64> {
    Reader::open(path).ok()?.next_entry().map(|entry| entry.stamps().log_time_ns)
}

/// The attached files, in the order in which they were read.
fn configuration(reader: &mut Reader<File>) -> Arc<[ConfigurationText]> {
    let names: Vec<String> = reader.attachments().map(|(name, _)| name.to_owned()).collect();
    let mut texts: Vec<ConfigurationText> = Vec::new();
    for attached in names {
        let Some(name) = attached.strip_prefix(CONFIGURATION) else { continue };
        if texts.iter().any(|known| known.name == name) {
            continue;
        }
        if let Some(text) = reader.attachment(&attached).and_then(|bytes| String::from_utf8(bytes).ok()) {
            texts.push(ConfigurationText { name: name.to_owned(), text });
        }
    }
    texts.into()
}
