//! A recording that is opened for a replay: what it says of itself, and its configuration.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use super::bag::Bag;
use telltale_clock::unix_ns;
use telltale_config::demo_patience::patient;
use telltale_config::{self as config, Loaded};
use telltale_engine::time::Timestamp;
use telltale_msg::fields::Definitions;
use telltale_record::file::{ABOUT, FileError, Reader};
use telltale_record::ring::ConfigurationText;
use telltale_record::writer::digest;
use telltale_yaml::Problems;

/// The folder of the attachments with the files of the configuration.
const CONFIGURATION: &str = "configuration/";

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("the recording has no configuration of its own: name one with --config")]
    NoConfiguration,
    #[error("the configuration in the recording is damaged: {0}; name the right one with --config")]
    DamagedConfiguration(String),
    #[error("the recorded configuration cannot be read by this version: {}; name one with --config", first(.0))]
    Configuration(Problems),
    #[error("the configuration needs what the recording does not define: {0}")]
    Definitions(String),
    #[error("the recording has no messages")]
    Empty,
    #[error("it was stopped")]
    Stopped,
    #[error("the edited configuration is wrong: {0}")]
    Edited(String),
}

/// The first of the problems, and how many more there are.
fn first(problems: &Problems) -> String {
    let lines = problems.lines();
    let first = lines.first().map_or("", |line| line);
    match lines.len().saturating_sub(1) + problems.more() {
        0 => first.to_owned(),
        more => format!("{first}, and {more} more"),
    }
}

/// A recording, and what it says of itself.
pub struct Recording {
    pub(super) reader: Bag,
    pub(super) facts: Facts,
}

/// The description of a recording in its file.
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
    /// The files of its configuration, the main one first. Of a damaged one there are none.
    pub configuration: Arc<[ConfigurationText]>,
    /// Why it cannot be used.
    pub configuration_damage: Option<String>,
}

impl Facts {
    /// Of a recording that says nothing but when it begins.
    #[cfg(test)]
    pub(super) fn at_zero(zero: SystemTime) -> Facts {
        Facts {
            has_journal: false,
            zero,
            from: Timestamp::ZERO,
            to: None,
            incident: None,
            vehicle: String::new(),
            is_demo: false,
            configuration: Arc::default(),
            configuration_damage: None,
        }
    }

    /// The wall time at an instant of the engine's clock.
    pub fn wall(&self, at: Timestamp) -> SystemTime {
        self.zero + Duration::from_nanos(at.as_nanos())
    }

    /// The instant of the engine's clock at this wall time.
    pub fn at_wall(&self, wall: SystemTime) -> Timestamp {
        self.at(unix_ns(wall))
    }

    /// The instant of the engine's clock at this wall time, in nanoseconds since 1970.
    pub fn at(&self, unix_ns: u64) -> Timestamp {
        let zero = self.zero.duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
        Timestamp::from_nanos(unix_ns.saturating_sub(u64::try_from(zero).unwrap_or(u64::MAX)))
    }

    /// The recorded configuration as it counted at the beginning.
    ///
    /// # Errors
    /// There is none, it is damaged, or this version cannot read it.
    pub fn recorded(&self) -> Result<Loaded, ReplayError> {
        if let Some(why) = &self.configuration_damage {
            return Err(ReplayError::DamagedConfiguration(why.clone()));
        }
        if self.configuration.is_empty() {
            return Err(ReplayError::NoConfiguration);
        }
        self.load(&self.configuration)
    }

    /// Reads a recorded configuration as it counted when it was recorded.
    ///
    /// # Errors
    /// This version cannot read it.
    pub fn load(&self, texts: &[ConfigurationText]) -> Result<Loaded, ReplayError> {
        let texts = texts.iter().map(|it| (it.name.clone(), it.text.clone()));
        let loaded = config::of_texts(texts).map_err(ReplayError::Configuration)?;
        Ok(self.as_counted(loaded))
    }

    /// A configuration as it would have counted when this was recorded.
    pub fn as_counted(&self, loaded: Loaded) -> Loaded {
        if self.is_demo { patient(loaded) } else { loaded }
    }
}

impl Recording {
    /// # Errors
    /// It is no recording with messages, or the disk cannot read it.
    pub fn open(path: &Path) -> Result<Recording, ReplayError> {
        let mut reader = Bag::open(path)?;
        let mut about = BTreeMap::new();
        let (mut has_journal, mut attached_texts) = (false, Ok(Vec::new()));
        if let Some(file) = reader.single() {
            let found = file.metadata().find(|(name, _)| *name == ABOUT).map(|(_, about)| about.clone());
            has_journal = found.is_some();
            about = found.unwrap_or_default();
            attached_texts = attached(file, about.get("configuration_sha256"));
        }
        let (texts, configuration_damage) = match attached_texts {
            Ok(texts) => (texts, None),
            Err(why) => (Vec::new(), Some(why)),
        };
        let number = |key: &str| about.get(key).and_then(|text| text.parse::<u64>().ok());
        let zero_ns = number("start_of_clock_ns").or(reader.first_ns()).ok_or(ReplayError::Empty)?;
        let mut facts = Facts {
            has_journal,
            zero: UNIX_EPOCH + Duration::from_nanos(zero_ns),
            from: Timestamp::from_nanos(number("shown_from_ns").unwrap_or_default()),
            to: None,
            incident: number("incident"),
            vehicle: about.get("vehicle").cloned().unwrap_or_default(),
            is_demo: about.get("demo").is_some_and(|demo| demo == "true"),
            configuration: texts.into(),
            configuration_damage,
        };
        facts.to = reader.last_ns().map(|last| facts.at(last));
        Ok(Recording { reader, facts })
    }

    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// Parts of the files that cannot be used, as far as they were read, in sentences.
    pub fn omissions(&self) -> Vec<String> {
        self.reader.omissions().0
    }

    /// Adds the definitions of the recording's own types, which come first.
    pub fn define(&self, mut definitions: Definitions) -> Definitions {
        for channel in self.reader.channels() {
            if let Some(text) = &channel.definition {
                definitions.give(&channel.type_name, text);
            }
        }
        definitions
    }
}

/// The attached files, in the order in which they were read, which have this hash together.
///
/// # Errors
/// The damage in them.
fn attached(reader: &mut Reader<File>, hash: Option<&String>) -> Result<Vec<ConfigurationText>, String> {
    let names: Vec<String> = reader.attachments().map(|(name, _)| name.to_owned()).collect();
    let mut texts: Vec<ConfigurationText> = Vec::new();
    for name in names {
        let Some(file) = name.strip_prefix(CONFIGURATION) else { continue };
        if texts.iter().any(|known| known.name == file) {
            continue;
        }
        let bytes = reader.attachment(&name).ok_or_else(|| format!("{file:?} is not as it was written"))?;
        let text = String::from_utf8(bytes).map_err(|_| format!("{file:?} is no text"))?;
        texts.push(ConfigurationText { name: file.to_owned(), text });
    }
    match hash {
        // Files may be missing, or may have been replaced.
        Some(hash) if digest(&texts) != *hash => {
            Err("it has not the hash that the recording names".to_owned())
        }
        _ => Ok(texts),
    }
}
