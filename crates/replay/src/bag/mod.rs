//! The files of a recording, one after the other: one MCAP file, one database of rosbag2, or a folder of them.

mod database;
mod folder;
mod survey;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, UNIX_EPOCH};

use database::Database;
use folder::Part;
use humantime::format_rfc3339_millis;
use survey::Survey;

use telltale_record::file::{self, Channel, Entry, FileError, Missing, Omissions, Reader};
use telltale_yaml::input_file;

/// More sentences are counted only.
const SAID_MAX: usize = 100;

/// A recording that is read from its first message to its last, whatever its files are.
pub struct Bag {
    /// Those that can be read, in their order.
    files: Vec<PathBuf>,
    /// Files that cannot be read are missing before the file with this number; behind the last one, by their count.
    lacks: BTreeMap<usize, Missing>,
    /// The gap behind the last file was told.
    is_over: bool,
    /// The number of the open one.
    at: usize,
    open: Storage,
    survey: Survey,
    said: Said,
}

/// A place in a recording, between two entries.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    file: usize,
    within: Within,
}

#[derive(Debug, Clone, Copy)]
enum Within {
    Mcap(file::Place),
    Rows((i64, i64)),
}

/// Sentences, each once.
#[derive(Default)]
struct Said {
    list: Vec<String>,
    more: u64,
}

impl Said {
    fn say(&mut self, sentence: String) {
        if self.list.contains(&sentence) {
            return;
        }
        if self.list.len() < SAID_MAX {
            self.list.push(sentence);
        } else {
            self.more += 1;
        }
    }
}

/// One file.
enum Storage {
    Mcap(Box<Reader<File>>),
    Database(Box<Database>),
}

impl Storage {
    fn open(path: &Path) -> Result<Storage, FileError> {
        let failed = |error| FileError::io(path, "read", error);
        let mut file = input_file::open(path).map_err(|error| FileError::io(path, "opened", error))?;
        let mut start = Vec::new();
        file.by_ref().take(database::MAGIC.len() as u64).read_to_end(&mut start).map_err(failed)?;
        if start == database::MAGIC {
            return Ok(Storage::Database(Box::new(Database::open(path)?)));
        }
        if start.starts_with(mcap::MAGIC) {
            return Ok(Storage::Mcap(Box::new(Reader::new(path, file)?)));
        }
        if start.starts_with(&zstd::zstd_safe::MAGICNUMBER.to_le_bytes()) {
            let plain = path.with_extension("");
            let why = format!(
                "it is compressed as a whole: decompress it first, `zstd -d {} -o {}`",
                path.display(),
                plain.display()
            );
            return Err(FileError::format(path, why));
        }
        Err(FileError::format(path, "it is no recording: neither an MCAP file nor a database of rosbag2"))
    }

    fn next_entry(&mut self) -> Option<Entry> {
        match self {
            Storage::Mcap(reader) => reader.next_entry(),
            Storage::Database(database) => database.next_entry(),
        }
    }

    fn omissions(&self) -> &Omissions {
        match self {
            Storage::Mcap(reader) => reader.omissions(),
            Storage::Database(database) => database.omissions(),
        }
    }
}

impl Bag {
    /// # Errors
    /// No file can be read as a recording, or several are of Telltale, which do not follow one another.
    pub fn open(path: &Path) -> Result<Bag, FileError> {
        let mut said = Said::default();
        let parts = if path.is_dir() {
            let found = folder::files(path)?;
            found.said.into_iter().for_each(|sentence| said.say(sentence));
            found.parts
        } else {
            vec![Part::alone(path.to_owned())]
        };
        let (mut files, mut survey, mut first_error) = (Vec::new(), Survey::default(), None);
        let mut lacks = BTreeMap::new();
        for Part { path, span_ns } in parts {
            match survey.take(&path) {
                Ok(()) => files.push(path),
                Err(error) => {
                    said.say(error.to_string());
                    first_error.get_or_insert(error);
                    let missing = Missing { span_ns };
                    let all = |before: &mut Missing| *before = together(*before, missing);
                    lacks.entry(files.len()).and_modify(all).or_insert(missing);
                }
            }
        }
        // A replay begins with the first message that there is.
        if let Some(Missing { span_ns: Some((from, to)) }) = lacks.remove(&0).filter(|_| !files.is_empty()) {
            let wall = |ns| format_rfc3339_millis(UNIX_EPOCH + Duration::from_nanos(ns));
            let s = (to - from) as f64 / 1e9;
            said.say(format!(
                "missing {} to {} ({s:.3} s): no file has it, and the replay begins later",
                wall(from),
                wall(to)
            ));
        }
        if survey.is_ours && files.len() > 1 {
            let why = "it has recordings of Telltale, which do not follow one another: name one of them";
            return Err(FileError::format(path, why));
        }
        match (files.first(), first_error) {
            (Some(first), _) => {
                let open = Storage::open(first)?;
                Ok(Bag { open, files, lacks, is_over: false, at: 0, survey, said })
            }
            (None, Some(error)) => Err(error),
            (None, None) => Err(FileError::format(path, "it has no recording")),
        }
    }

    /// The file, if it is one MCAP file: only these are of Telltale.
    pub fn single(&mut self) -> Option<&mut Reader<File>> {
        match &mut self.open {
            Storage::Mcap(reader) if self.files.len() == 1 => Some(reader),
            _ => None,
        }
    }

    /// The time of the first message that has one.
    pub fn first_ns(&self) -> Option<u64> {
        self.survey.first_ns
    }

    /// The last time of a message; `None` if a file does not say it.
    pub fn last_ns(&self) -> Option<u64> {
        self.survey.last_ns
    }

    /// The topics of all files.
    pub fn channels(&self) -> &[Arc<Channel>] {
        &self.survey.channels
    }

    /// The next entry, in the order of the files.
    pub fn next_entry(&mut self) -> Option<Entry> {
        loop {
            if let Some(entry) = self.open.next_entry() {
                return Some(entry);
            }
            let missing = self.lacks.get(&(self.at + 1)).copied().map(Entry::Missing);
            let Some(path) = self.files.get(self.at + 1).cloned() else {
                return missing.filter(|_| !std::mem::replace(&mut self.is_over, true));
            };
            self.close();
            self.at += 1;
            match Storage::open(&path) {
                Ok(storage) => self.open = storage,
                Err(error) => self.said.say(error.to_string()),
            }
            if missing.is_some() {
                return missing;
            }
        }
    }

    /// Keeps what is to be said of the open file.
    fn close(&mut self) {
        let (sentences, more) = self.said_of_open();
        sentences.into_iter().for_each(|sentence| self.said.say(sentence));
        self.said.more += more;
    }

    fn said_of_open(&self) -> (Vec<String>, u64) {
        let omissions = self.open.omissions();
        let name = self.files[self.at].file_name().unwrap_or_default().to_string_lossy();
        let sentence = |omission: &dyn std::fmt::Display| match self.files.len() {
            1 => omission.to_string(),
            _ => format!("{name}: {omission}"),
        };
        (omissions.list().iter().map(|omission| sentence(omission)).collect(), omissions.more())
    }

    /// The place of the next entry.
    pub fn place(&self) -> Place {
        let within = match &self.open {
            Storage::Mcap(reader) => Within::Mcap(reader.place()),
            Storage::Database(database) => Within::Rows(database.place()),
        };
        Place { file: self.at, within }
    }

    /// Goes back or forwards to a place, whose entry is the next one.
    pub fn go_to(&mut self, place: Place) {
        self.is_over = false;
        if place.file != self.at {
            match Storage::open(&self.files[place.file]) {
                Ok(storage) => {
                    self.close();
                    (self.at, self.open) = (place.file, storage);
                }
                Err(error) => return self.said.say(error.to_string()),
            }
        }
        match (&mut self.open, place.within) {
            (Storage::Mcap(reader), Within::Mcap(within)) => reader.go_to(within),
            (Storage::Database(database), Within::Rows(within)) => database.go_to(within),
            // Another file stands there now.
            (Storage::Mcap(_), Within::Rows(_)) | (Storage::Database(_), Within::Mcap(_)) => {}
        }
    }

    /// The unusable parts so far, in sentences; and the number of further ones.
    pub fn omissions(&self) -> (Vec<String>, u64) {
        let (mut sentences, mut more) = (self.said.list.clone(), self.said.more);
        let (of_open, more_of_open) = self.said_of_open();
        sentences.extend(of_open.into_iter().filter(|sentence| !self.said.list.contains(sentence)));
        more += more_of_open;
        (sentences, more)
    }
}

/// The message where neither of two is there.
fn together(first: Missing, second: Missing) -> Missing {
    let span_ns = first.span_ns.zip(second.span_ns);
    Missing { span_ns: span_ns.map(|(first, second)| (first.0.min(second.0), first.1.max(second.1))) }
}

#[cfg(test)]
mod tests;
