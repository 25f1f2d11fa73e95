//! Learns dependencies from the history in the background, once at a time and within bounds. Nothing of it touches the
//! vehicle.

use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::AppState;
use crate::http::readers::lower_priority;
use crate::texts::HttpError;
use telltale_clock::unix_ms;
use telltale_engine::model::{Model, ModuleId, NodeId};
use telltale_engine::snapshot::Snapshot;
use telltale_engine::time::Span;
use telltale_learn::Proposals;
use telltale_record::summary::Summary;
use telltale_runtime::ConfigurationText;
use telltale_store::{History, INCIDENTS_PAGE_MAX, Incident, IncidentFilter};

/// A history that takes longer is not evaluated here.
const WITHIN: Span = Span::from_secs(60);
/// Nor one with more bytes of evidence.
const BYTES_MAX: usize = 128 << 20;
/// The newest incidents are named beside what happened in them.
const INCIDENTS_MAX: usize = 2_000;

/// Learns from a history for a configuration of these texts, while it may go on: it asks with the bytes that it takes.
pub struct Learner(pub Box<Learn>);

type GoOn<'a> = &'a dyn Fn(usize) -> bool;
type Learn = dyn Fn(&[ConfigurationText], &History, GoOn<'_>) -> Result<Learned, NotLearned> + Send + Sync;

impl fmt::Debug for Learner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Learner")
    }
}

/// What the history proposes.
#[derive(Debug)]
pub struct Learned {
    pub model: Arc<Model>,
    pub proposals: Proposals,
    /// Modules that ever failed.
    pub failed: usize,
    /// `None` where nothing is proposed.
    pub patched: Option<Patched>,
}

/// The configuration with the proposals.
#[derive(Debug)]
pub struct Patched {
    pub texts: Vec<ConfigurationText>,
    pub patch: String,
    /// Nodes with dependencies that have to be changed by hand.
    pub left: Vec<String>,
    /// What `check` says: its warnings, or its errors.
    pub checked: Result<Option<String>, String>,
}

/// Why nothing is learned.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NotLearned {
    /// The history has nothing of these modules.
    Nothing,
    /// Of time or memory.
    TooMuch,
    Bad(String),
}

/// The last evaluation.
#[derive(Debug)]
pub struct Outcome {
    /// In milliseconds since 1970.
    pub at_ms: i64,
    /// The configuration that it is for.
    pub texts: Arc<[ConfigurationText]>,
    /// The newest incidents, the newest first: what they are called, from when to when they lasted, and their recordings.
    pub incidents: Vec<Summary>,
    pub result: Result<Learned, NotLearned>,
}

/// Whether one is under way, and what the last one found.
#[derive(Debug, Clone, Default)]
pub struct Progress {
    pub is_running: bool,
    pub last: Option<Arc<Outcome>>,
}

#[derive(Debug, Default)]
pub struct Learning(Mutex<Progress>);

impl Learning {
    fn locked(&self) -> MutexGuard<'_, Progress> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn progress(&self) -> Progress {
        self.locked().clone()
    }
}

impl Outcome {
    /// The dependencies to be added: the cause, and what depends on it, as far as these nodes are there.
    pub fn added(&self, snapshot: &Snapshot) -> Vec<(NodeId, NodeId)> {
        let Ok(Learned { model, proposals, .. }) = &self.result else { return Vec::new() };
        let node = |id: ModuleId| snapshot.node(model.node_name(NodeId::Module(id)));
        let edges = proposals.add.iter().map(|index| &proposals.learned[*index]);
        edges.filter_map(|edge| Some((node(edge.cause)?, node(edge.dependent)?))).collect()
    }

    pub fn patched(&self) -> Option<&Patched> {
        self.result.as_ref().ok()?.patched.as_ref()
    }
}

/// Held while one runs.
struct Turn(AppState);

impl Turn {
    fn of(app: &AppState) -> Option<Turn> {
        let is_free = !std::mem::replace(&mut app.learning.locked().is_running, true);
        is_free.then(|| Turn(app.clone()))
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        self.0.learning.locked().is_running = false;
    }
}

/// Starts one, unless one is under way.
///
/// # Errors
/// There is nothing to evaluate here, or the incidents cannot be read.
pub async fn start(app: &AppState) -> Result<(), HttpError> {
    let (Some(_), Some(history), Some(texts)) = (&app.settings.learner, &app.settings.history, running(app))
    else {
        return Err(HttpError::NotFound);
    };
    let Some(turn) = Turn::of(app) else { return Ok(()) };
    let (history, incidents) = (history.clone(), incidents(app).await?);
    let work = move || {
        lower_priority();
        let Turn(app) = &turn;
        let Some(Learner(learn)) = &app.settings.learner else { return };
        let until = app.clock.now() + WITHIN;
        let go_on = |bytes: usize| bytes <= BYTES_MAX && app.clock.now() < until;
        let result = learn(&texts, &history, &go_on);
        let at_ms = unix_ms(app.clock.wall());
        app.learning.locked().last = Some(Arc::new(Outcome { at_ms, texts, incidents, result }));
    };
    std::thread::Builder::new().name("learn".into()).spawn(work).map_err(|_| HttpError::Unavailable)?;
    Ok(())
}

/// The texts of the running configuration.
pub fn running(app: &AppState) -> Option<Arc<[ConfigurationText]>> {
    Some(app.settings.written.as_ref()?.borrow().texts.clone())
}

async fn incidents(app: &AppState) -> Result<Vec<Summary>, HttpError> {
    let mut all: Vec<Summary> = Vec::new();
    loop {
        let before = all.last().map(|it| it.id);
        let filter = IncidentFilter { before, ..IncidentFilter::default() };
        let page = app.store.incidents(filter).await.map_err(HttpError::from)?;
        let is_last = page.len() < INCIDENTS_PAGE_MAX as usize;
        // Only the fields that the page shows.
        all.extend(page.into_iter().map(|Incident { summary: it, .. }| Summary {
            id: it.id,
            since_ms: it.since_ms,
            until_ms: it.until_ms,
            recording: it.recording,
            ..Summary::default()
        }));
        if is_last || all.len() >= INCIDENTS_MAX {
            return Ok(all);
        }
    }
}
