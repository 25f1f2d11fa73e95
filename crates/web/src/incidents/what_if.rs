//! What-ifs of developers: incidents run by another configuration, in the background and within bounds. Nothing of it
//! touches the vehicle.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde_json::{Value, json};
use tokio::task;

use crate::AppState;
use crate::http::readers::lower_priority;
use crate::texts::HttpError;
use telltale_engine::time::{Span, Timestamp};
use telltale_record::folder;
use telltale_record::ring::ConfigurationText;
use telltale_record::summary::Summary;
use telltale_replay::compare::{Candidate, Comparison, Mistake, judged};
use telltale_replay::{self as replay, Recording, ReplayError};
use telltale_store::{Incident, IncidentFilter, Session};

use super::failed;

/// Persons whose last what-if is kept. Another one takes the place of the oldest.
const RUNS_MAX: usize = 8;
/// Incidents of one run.
const INCIDENTS_MAX: u32 = 50;
/// A larger recording is not run.
const RECORDING_BYTES_MAX: u64 = 256 << 20;
/// All recordings of a run must be done within this time.
pub const RUN_WITHIN: Span = Span::from_secs(120);
/// Mistakes that are told.
const MISTAKES_MAX: usize = 50;

/// Reads the texts of a configuration for a recording: what is to be judged by it, or what is wrong.
pub struct Examiner(pub Box<Examine>);

impl Examiner {
    /// What a recording is to be judged by, and what that means otherwise than the configuration in the recording.
    ///
    /// # Errors
    /// The configuration is wrong, or the recording cannot be read.
    pub fn examined(
        &self,
        texts: &[ConfigurationText],
        path: &Path,
    ) -> Result<(Candidate, Vec<String>), Stop> {
        let recording = Recording::open(path).map_err(Stop::of)?;
        let candidate = (self.0)(texts, &recording).map_err(|mut mistakes| {
            mistakes.truncate(MISTAKES_MAX);
            Stop::Mistakes(mistakes)
        })?;
        let differences = candidate.differences(recording.facts()).map_err(Stop::of)?;
        Ok((candidate, differences))
    }
}

type Examine = dyn Fn(&[ConfigurationText], &Recording) -> Result<Candidate, Vec<Mistake>> + Send + Sync;

impl fmt::Debug for Examiner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Examiner")
    }
}

/// The last what-if of each person.
#[derive(Debug, Default)]
pub struct WhatIfs(Mutex<Runs>);

#[derive(Debug, Default)]
struct Runs {
    /// The newest at the end. Those that wait are run in this order, and nothing else waits.
    all: Vec<Arc<Run>>,
    /// One after the other: the vehicle has the rest of the machine.
    is_running: bool,
}

/// Held while one runs; then it is the next one's turn.
struct Turn(AppState);

impl Drop for Turn {
    fn drop(&mut self) {
        self.0.what_ifs.runs().is_running = false;
        run_next(&self.0);
    }
}

/// A what-if of one person.
#[derive(Debug)]
pub struct Run {
    /// The incident on whose page it was started.
    pub incident: u64,
    /// It runs the kept incidents too.
    pub is_all: bool,
    /// The texts that were sent.
    pub texts: Vec<ConfigurationText>,
    /// The incidents that are run, that one first.
    summaries: Vec<Summary>,
    session: Session,
    is_cancelled: AtomicBool,
    state: Mutex<State>,
}

/// How far it is, and what is known so far.
#[derive(Debug, Default)]
pub struct State {
    pub progress: Progress,
    /// Incidents that are to be compared.
    pub count: usize,
    /// The differences in meaning of both configurations.
    pub differences: Vec<String>,
    pub compared: Vec<Compared>,
}

#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Progress {
    /// Others are run.
    #[default]
    Waiting,
    Running,
    /// The configuration is wrong.
    Wrong(Vec<Mistake>),
    Done,
}

#[derive(Debug)]
pub struct Compared {
    pub incident: u64,
    pub result: Result<Comparison, Trouble>,
}

/// Why an incident is not compared.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Trouble {
    Missing,
    TooLarge,
    /// The time for all of them was over.
    Late,
    Bad(String),
}

impl Run {
    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether somebody still wants it.
    fn is_wanted(&self) -> bool {
        !self.is_cancelled.load(Ordering::Relaxed) && self.session.is_open()
    }
}

impl WhatIfs {
    fn runs(&self) -> MutexGuard<'_, Runs> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The last what-if of this person, if it was started from the page of this incident.
    pub fn of(&self, session: &Session, incident: u64) -> Option<Arc<Run>> {
        let mut runs = self.runs();
        runs.all.retain(|run| run.is_wanted());
        runs.all.iter().find(|run| run.incident == incident && run.session.user == session.user).cloned()
    }

    /// Adds one in place of the person's last one, which ends.
    fn add(&self, run: Arc<Run>) {
        let Runs { all, .. } = &mut *self.runs();
        let own = all.iter().position(|it| it.session.user == run.session.user);
        if let Some(index) = own.or((all.len() >= RUNS_MAX).then_some(0)) {
            all.remove(index).is_cancelled.store(true, Ordering::Relaxed);
        }
        all.push(run);
    }

    /// The next one that waits, if it is its turn.
    fn next(&self) -> Option<Arc<Run>> {
        let mut runs = self.runs();
        runs.all.retain(|run| run.is_wanted());
        let waits = |run: &&Arc<Run>| run.state().progress == Progress::Waiting;
        let next = runs.all.iter().find(waits).filter(|_| !runs.is_running).cloned()?;
        next.state().progress = Progress::Running;
        runs.is_running = true;
        Some(next)
    }
}

/// Runs the next one that waits, if none is run.
fn run_next(app: &AppState) {
    let Some(run) = app.what_ifs.next() else { return };
    let (turn, started) = (Turn(app.clone()), run.clone());
    let work = move || {
        lower_priority();
        run.run(&turn.0);
    };
    if let Err(error) = std::thread::Builder::new().name("what-if".into()).spawn(work) {
        let result = Err(Trouble::Bad(error.to_string()));
        let mut state = started.state();
        state.compared.push(Compared { incident: started.incident, result });
        state.progress = Progress::Done;
    }
}

/// Starts a what-if of this incident, and with `is_all` of all that are kept. It replaces the person's last one.
///
/// # Errors
/// Nothing can be run here, or the incidents cannot be read.
pub async fn start(
    app: &AppState,
    incident: &Incident,
    session: &Session,
    texts: Vec<ConfigurationText>,
    is_all: bool,
) -> Result<(), HttpError> {
    if app.settings.recordings.is_none() || app.settings.what_if.is_none() {
        return Err(HttpError::NotFound);
    }
    let id = incident.summary.id;
    let mut summaries = vec![incident.summary.clone()];
    if is_all {
        let filter = IncidentFilter { kept: Some(true), count: INCIDENTS_MAX, ..IncidentFilter::default() };
        let kept = app.store.incidents(filter).await.map_err(failed)?;
        summaries.extend(kept.into_iter().map(|it| it.summary).filter(|it| it.id != id));
    }
    let state = State { count: summaries.len(), ..State::default() };
    app.what_ifs.add(Arc::new(Run {
        incident: id,
        is_all,
        texts,
        summaries,
        session: session.clone(),
        is_cancelled: AtomicBool::new(false),
        state: Mutex::new(state),
    }));
    run_next(app);
    Ok(())
}

impl Run {
    /// Runs all of them. Blocks.
    fn run(&self, app: &AppState) {
        let until = app.clock.now() + RUN_WITHIN;
        for summary in &self.summaries {
            let result = self.one(app, summary, until);
            let mut state = self.state();
            match result {
                // Nobody looks at it.
                _ if !self.is_wanted() => return,
                Err(Stop::Mistakes(mistakes)) => {
                    state.progress = Progress::Wrong(mistakes);
                    return;
                }
                Err(Stop::Trouble(trouble)) => {
                    state.compared.push(Compared { incident: summary.id, result: Err(trouble) });
                }
                Ok(comparison) => {
                    state.compared.push(Compared { incident: summary.id, result: Ok(comparison) });
                }
            }
        }
        self.state().progress = Progress::Done;
    }

    /// Opens the recording of its incident as its configuration judges it.
    ///
    /// # Errors
    /// The configuration is known to be wrong, or there is no recording to run.
    pub fn judged(
        self: &Arc<Run>,
        app: &AppState,
        summary: &Summary,
    ) -> Result<impl FnOnce() -> Result<replay::Run, ReplayError> + Send + use<>, HttpError> {
        if matches!(self.state().progress, Progress::Wrong(_)) {
            return Err(HttpError::NotFound);
        }
        let folder = app.settings.recordings.as_deref().ok_or(HttpError::NoRecording)?;
        let path = recording(folder, summary).map_err(|_| HttpError::NoRecording)?;
        if app.settings.what_if.is_none() {
            return Err(HttpError::NotFound);
        }
        let (run, app) = (self.clone(), app.clone());
        Ok(move || {
            let wrong = |mistakes: Vec<Mistake>| {
                let first = mistakes.into_iter().next().map(|mistake| mistake.message);
                ReplayError::Edited(first.unwrap_or_default())
            };
            let Some(Examiner(examine)) = &app.settings.what_if else {
                return Err(ReplayError::NoConfiguration);
            };
            let Candidate { loaded, definitions } =
                examine(&run.texts, &Recording::open(&path)?).map_err(wrong)?;
            judged(&path, &loaded, &definitions, None)
        })
    }

    fn one(&self, app: &AppState, summary: &Summary, until: Timestamp) -> Result<Comparison, Stop> {
        let folder = app.settings.recordings.as_deref().ok_or(Trouble::Missing)?;
        let path = recording(folder, summary)?;
        let examiner = app.settings.what_if.as_ref().ok_or(Trouble::Missing)?;
        let (candidate, differences) = examiner.examined(&self.texts, &path)?;
        if summary.id == self.incident {
            self.state().differences = differences;
        }
        let go_on = || self.is_wanted() && app.clock.now() < until;
        candidate.compare(&path, &go_on).map_err(Stop::of)
    }
}

/// Why a comparison ends early.
#[derive(Debug)]
pub enum Stop {
    Mistakes(Vec<Mistake>),
    Trouble(Trouble),
}

impl Stop {
    pub fn of(error: ReplayError) -> Stop {
        Stop::Trouble(match error {
            ReplayError::Stopped => Trouble::Late,
            error => Trouble::Bad(error.to_string()),
        })
    }
}

impl From<Trouble> for Stop {
    fn from(trouble: Trouble) -> Stop {
        Stop::Trouble(trouble)
    }
}

/// The file of an incident, if it can be run.
fn recording(folder: &Path, summary: &Summary) -> Result<PathBuf, Trouble> {
    runnable(folder, &summary.recording.file, summary.recording.bytes)
}

/// The path of a recording of so many bytes, if it can be run.
///
/// # Errors
/// It is not there, or too large.
pub fn runnable(folder: &Path, file: &str, bytes: u64) -> Result<PathBuf, Trouble> {
    match folder::file_in(folder, file) {
        None => Err(Trouble::Missing),
        Some(_) if bytes > RECORDING_BYTES_MAX => Err(Trouble::TooLarge),
        Some(path) => Ok(path),
    }
}

/// The texts of the recorded configuration; none if the recording has none, or cannot be read.
pub async fn texts(app: &AppState, summary: &Summary) -> Vec<ConfigurationText> {
    let Some(folder) = app.settings.recordings.clone() else { return Vec::new() };
    let Ok(path) = recording(&folder, summary) else { return Vec::new() };
    texts_in(path).await
}

/// The same of the recording at a path.
pub async fn texts_in(path: PathBuf) -> Vec<ConfigurationText> {
    let read =
        task::spawn_blocking(move || Recording::open(&path).map(|it| it.facts().configuration.to_vec()));
    read.await.ok().and_then(Result::ok).unwrap_or_default()
}

impl State {
    /// For programs.
    pub fn json(&self) -> Value {
        let progress = match &self.progress {
            Progress::Waiting => "waiting",
            Progress::Running => "running",
            Progress::Wrong(_) => "wrong",
            Progress::Done => "done",
        };
        let compared = |it: &Compared| {
            let mut value = match &it.result {
                Ok(comparison) => comparison.json(),
                Err(trouble) => json!({ "error": trouble.word() }),
            };
            value["incident"] = it.incident.into();
            value
        };
        let mistakes = match &self.progress {
            Progress::Wrong(mistakes) => json!(mistakes),
            _ => json!([]),
        };
        json!({
            "progress": progress, "count": self.count, "differences": self.differences, "problems": mistakes,
            "compared": self.compared.iter().map(compared).collect::<Vec<_>>(),
        })
    }
}

impl Trouble {
    /// For programs and logs.
    fn word(&self) -> &str {
        match self {
            Trouble::Missing => "the recording is missing",
            Trouble::TooLarge => "the recording is too large",
            Trouble::Late => "the time for all of them was over",
            Trouble::Bad(why) => why,
        }
    }
}
