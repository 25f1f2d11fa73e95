//! The configuration: from YAML files to a [`Model`] that cannot be wrong. Every problem is found in one pass,
//! with file, line and a help.

pub mod changeable;
pub mod decode;
pub mod demo_patience;
pub mod describe;
pub mod expression;
pub mod fields;
mod file;
pub mod fleet;
mod glob;
pub mod publishing;
pub mod recording;
mod resolve;
pub mod services;
pub mod soundness;

pub use describe::difference::{Change, Difference, difference};
pub use describe::named::{Named, What};
pub use describe::places::ModelPlace;
pub use file::monitors::system::resource;

use std::collections::HashSet;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use self::fleet::Fleet;
use self::publishing::Publishing;
use self::recording::Recording;
use self::services::Services;
use self::soundness::Soundness;
use crate::decode::{FromNode, Spanned};
use describe::places::Places;
use telltale_engine::model::{ACTIVE_SIGNAL, Model, StageModel};
use telltale_yaml::{Log, Node, Problem, Problems, Schema, Sources, Span, tree};

/// The largest number of included files.
const FILES_MAX: usize = 64;

/// The JSON Schema of a configuration, for editors.
pub fn schema() -> String {
    Schema::document(file::File::from_node)
}

/// A configuration that was checked.
#[derive(Debug, Clone)]
pub struct Loaded {
    pub model: Arc<Model>,
    pub publishing: Publishing,
    /// `None`: the recording is switched off.
    pub recording: Option<Recording>,
    pub services: Services,
    /// `None`: the vehicle belongs to none.
    pub fleet: Option<Fleet>,
    /// Folders with definitions of messages, in addition to the built-in ones.
    pub message_folders: Vec<PathBuf>,
    places: Arc<Places>,
}

impl Loaded {
    /// The files that it was read from, with their texts.
    pub fn sources(&self) -> &Sources {
        &self.places.sources
    }

    /// Each node with the position of its file in [`sources`](Self::sources), and its line there, counted from 1.
    pub fn lines(&self) -> impl Iterator<Item = (&str, u16, usize)> {
        self.places.lines().map(|(node, file, line)| (self.model.node_name(node), file, line))
    }

    /// Whether it counts as a shuttle only because it does not say what it is: nothing tells whether it drives.
    pub fn is_shuttle_unsaid(&self) -> bool {
        let is_told = self.model.signals.iter().any(|signal| &*signal.name == ACTIVE_SIGNAL);
        self.model.stages == StageModel::Shuttle && self.places.stages.is_none() && !is_told
    }

    /// Situations that this configuration permits and should not: see [`soundness`].
    pub fn soundness(&self) -> (Soundness, Option<Problems>) {
        let found = soundness::look(&self.model);
        let problems: Vec<Problem> = found
            .findings
            .iter()
            .map(|finding| soundness::problem(&self.model, &self.places, finding))
            .collect();
        let problems = (!problems.is_empty()).then(|| Problems::new(self.places.sources.clone(), problems));
        (found, problems)
    }

    /// The place of a part of it, if the file has one.
    pub fn place(&self, place: ModelPlace) -> Option<Span> {
        self.places.span(place)
    }

    /// Problems that the definitions of messages show: each with its place, a sentence without a full stop, and
    /// a help.
    pub fn problems(
        &self,
        found: impl IntoIterator<Item = (ModelPlace, String, String)>,
    ) -> Option<Problems> {
        let problem = |(place, text, help): (ModelPlace, String, String)| {
            let problem = self.places.span(place).map(|span| Problem::at(span, text.as_str()));
            let whole = || Problem { file: None, ..Problem::of_file("the configuration", &text, "") };
            problem.unwrap_or_else(whole).help(help)
        };
        let problems: Vec<Problem> = found.into_iter().map(problem).collect();
        (!problems.is_empty()).then(|| Problems::new(self.places.sources.clone(), problems))
    }
}

/// A configuration as far as it can be read, for a caller that reports all problems at once.
#[derive(Debug)]
pub struct Examined {
    /// No vehicle may run with it if there are problems.
    pub loaded: Option<Loaded>,
    pub problems: Option<Problems>,
}

impl Examined {
    fn of(problem: Problem) -> Examined {
        Examined { loaded: None, problems: Some(Problems::new(Sources::default(), vec![problem])) }
    }

    fn whole(self) -> Result<Loaded, Problems> {
        match self {
            Examined { loaded: Some(loaded), problems: None } => Ok(loaded),
            Examined { problems, .. } => {
                Err(problems.unwrap_or_else(|| Problems::new(Sources::default(), Vec::new())))
            }
        }
    }
}

/// Reads a configuration and the files that it includes.
pub fn load(path: &Path) -> Result<Loaded, Problems> {
    examine(path).whole()
}

/// The same, with the readable part of a wrong configuration.
pub fn examine(path: &Path) -> Examined {
    let mut sources = Sources::default();
    match sources.read(path) {
        Ok(file) => of_source(sources, file),
        Err(problem) => Examined::of(problem),
    }
}

/// The same for the text of a reader; included files are relative to the working directory.
pub fn examine_from(name: &str, reader: impl Read) -> Examined {
    let mut sources = Sources::default();
    match sources.read_from(name, reader) {
        Ok(file) => of_source(sources, file),
        Err(problem) => Examined::of(problem),
    }
}

/// Reads a configuration from a text; messages call it `name`.
pub fn parse(name: &str, text: &str) -> Result<Loaded, Problems> {
    let mut sources = Sources::default();
    let file = sources.add(name, text);
    of_source(sources, file).whole()
}

/// Reads a configuration from the texts of its files, by the names that they had. The first one includes the
/// others. Folders with definitions of messages need not exist.
pub fn of_texts(texts: impl IntoIterator<Item = (String, String)>) -> Result<Loaded, Problems> {
    let texts: Vec<(String, String)> = texts.into_iter().collect();
    let first = texts.first().map(|(name, _)| PathBuf::from(name)).unwrap_or_default();
    let mut sources = Sources::kept(texts);
    match sources.read(&first) {
        Ok(file) => of_source(sources, file).whole(),
        Err(problem) => Examined::of(problem).whole(),
    }
}

/// Reads a configuration that is part of another file.
pub fn of_node(sources: Sources, node: &Node) -> Result<Loaded, Problems> {
    finish(sources, Log::default(), Some(node)).whole()
}

fn of_source(sources: Sources, file: u16) -> Examined {
    let mut log = Log::default();
    let node = tree::parse(&sources, file, &mut log);
    finish(sources, log, node.as_ref())
}

fn finish(mut sources: Sources, mut log: Log, node: Option<&Node>) -> Examined {
    let file = node.and_then(|node| file::File::from_node(node, &mut log).map(|file| (file, node.span.file)));
    let loaded = file.and_then(|(mut file, number)| {
        include(&mut file, number, &mut sources, &mut log);
        let folders = message_folders(&file, &sources, &mut log);
        let base = Path::new(sources.name(number)).parent().unwrap_or(Path::new("")).to_owned();
        resolve::resolve(&file, &base, folders, &mut log)
    });
    let problems =
        (loaded.is_none() || !log.is_empty()).then(|| Problems::new(sources.clone(), log.into_problems()));
    let loaded = loaded.map(|loaded| {
        let places = Arc::new(Places { sources, ..Arc::unwrap_or_clone(loaded.places) });
        Loaded { places, ..loaded }
    });
    Examined { loaded, problems }
}

/// The folders with definitions of messages, each relative to the file that names it.
fn message_folders(file: &file::File, sources: &Sources, log: &mut Log) -> Vec<PathBuf> {
    let mut folders = Vec::new();
    for written in &file.message_folders {
        let base = Path::new(sources.name(written.span.file)).parent().unwrap_or(Path::new(""));
        let folder = base.join(&written.value);
        if !sources.is_kept() && !folder.is_dir() {
            let problem = Problem::at(written.span, format!("there is no folder `{}`", folder.display()));
            log.push(problem.help(
                "name a folder that holds `package/msg/Name.msg`, such as a ROS installation's `share`",
            ));
        }
        if folders.contains(&folder) {
            log.push(Problem::at(written.span, "this folder is named twice").help("remove one of the two"));
        }
        folders.push(folder);
    }
    folders
}

/// Adds the lists of the included files to those of the main file, in the order of inclusion.
fn include(main: &mut file::File, number: u16, sources: &mut Sources, log: &mut Log) {
    let mut seen: HashSet<PathBuf> = HashSet::new();
    seen.extend(Path::new(sources.name(number)).canonicalize());
    let mut waiting: Vec<(Spanned<String>, u16)> = includes(main, number);
    while let Some((path, from)) = waiting.pop() {
        let base = Path::new(sources.name(from)).parent().unwrap_or(Path::new(""));
        let full = base.join(&path.value);
        if full.canonicalize().is_ok_and(|canonical| !seen.insert(canonical)) {
            let problem = Problem::at(path.span, format!("`{}` is included twice", path.value));
            log.push(problem.help("include each file once, and no file from itself"));
            continue;
        }
        if sources.len() >= FILES_MAX {
            log.push(Problem::at(path.span, format!("more than {FILES_MAX} files are included")));
            return;
        }
        let Some((file, number)) = read_included(&full, path.span, sources, log) else { continue };
        waiting.extend(includes(&file, number));
        main.signals.0.extend(file.signals.0);
        main.stops.extend(file.stops);
        main.groups.extend(file.groups);
        main.countermeasures.extend(file.countermeasures);
        main.message_folders.extend(file.message_folders);
    }
}

/// In reverse order, because the last one is taken first.
fn includes(file: &file::File, number: u16) -> Vec<(Spanned<String>, u16)> {
    file.include.iter().rev().map(|path| (path.clone(), number)).collect()
}

fn read_included(path: &Path, from: Span, sources: &mut Sources, log: &mut Log) -> Option<(file::File, u16)> {
    let number = match sources.read(path) {
        Ok(number) => number,
        Err(problem) => {
            log.push(Problem { span: Some(from), label: "included here".into(), ..problem });
            return None;
        }
    };
    let node = tree::parse(sources, number, log)?;
    let file = file::File::from_node(&node, log)?;
    for &(key, span) in &file.main_only {
        let problem = Problem::at(span, format!("`{key}` in a file that is included"));
        log.push(problem.help(format!("move `{key}` to `{}`", sources.name(from.file))));
    }
    Some((file, number))
}

#[cfg(test)]
mod tests;
