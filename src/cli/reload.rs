//! Another configuration while the vehicle runs: read whole, shown as a difference, and taken whole
//! or not at all. Modules that stay keep their state.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use sha2::{Digest as _, Sha256};
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::{mpsc, oneshot, watch};

use super::fields;
use crate::config::{self, Difference, Loaded};
use crate::engine::model::{FieldSource, Model};
use crate::engine::monitor::spec::Watched;
use crate::ros::fields::Definitions;
use crate::runtime::{Reload, Reread, Rereading};
use crate::yaml::Problems;

/// Requests that may wait. A full queue makes the senders wait: each reads a file and a person reads
/// the answer.
const REQUESTS: usize = 4;

/// A configuration that was read while another one runs.
#[derive(Debug)]
pub struct Outcome {
    pub loaded: Loaded,
    /// Empty if it means the same as the one that runs.
    pub differences: Vec<Difference>,
    /// What can happen with it and should not; it may be taken all the same.
    pub warnings: Option<Problems>,
    /// Whoever listens to topics has to listen to others.
    pub topics_changed: bool,
}

#[derive(Debug, thiserror::Error)]
pub enum ReloadError {
    /// Everything that is wrong with the file. The old configuration stays.
    #[error("{0}")]
    Configuration(#[from] Problems),
    /// Every field that cannot be read. The old configuration stays.
    #[error("the engine has ended")]
    Ended,
}

/// Reads a configuration and says what would be different. Nothing is taken.
///
/// # Errors
/// Everything that is wrong with the file.
pub async fn preview(
    path: &Path,
    current: &Loaded,
    definitions: &Definitions,
) -> Result<Outcome, ReloadError> {
    let (path, current, definitions) = (path.to_owned(), current.clone(), definitions.clone());
    // Files, and a judgement of every situation: too long for a thread that others wait for.
    let read = tokio::task::spawn_blocking(move || {
        let loaded = config::load(&path)?;
        // By the folders of the start: what reads the messages knows no others.
        if let Some(problems) = fields::check(&loaded, &definitions) {
            return Err(ReloadError::Configuration(problems));
        }
        let differences = config::difference(&current, &loaded);
        let topics_changed = sources(&current.model) != sources(&loaded.model);
        let (_, warnings) = loaded.soundness();
        Ok(Outcome { loaded, differences, warnings, topics_changed })
    });
    // It ends early only if the whole program does.
    read.await.unwrap_or(Err(ReloadError::Ended))
}

/// Reads a configuration and lets the engine run by it.
///
/// # Errors
/// Everything that is wrong with the file; then the old one stays as it is.
pub async fn reload(
    path: &Path,
    current: &Loaded,
    definitions: &Definitions,
    engine: &mpsc::Sender<Reload>,
) -> Result<Outcome, ReloadError> {
    let outcome = preview(path, current, definitions).await?;
    take(&outcome, engine).await?;
    Ok(outcome)
}

async fn take(outcome: &Outcome, engine: &mpsc::Sender<Reload>) -> Result<(), ReloadError> {
    if !outcome.differences.is_empty() {
        let (done, taken) = oneshot::channel();
        let reload = Reload { model: outcome.loaded.model.clone(), done };
        engine.send(reload).await.map_err(|_| ReloadError::Ended)?;
        taken.await.map_err(|_| ReloadError::Ended)?;
    }
    Ok(())
}

/// The topics from which signals come, and what monitors watch.
fn sources(model: &Model) -> (Vec<&FieldSource>, &Watched) {
    (model.signals.iter().map(|signal| &signal.source).collect(), &model.watched)
}

/// What the rest of the program holds of the task that [`start`] starts.
#[derive(Debug, Clone)]
pub struct Reloads {
    /// For the developer's page.
    pub requests: mpsc::Sender<Reread>,
    /// The configuration that runs: for whoever listens to its topics or shows its stops.
    pub running: watch::Receiver<Loaded>,
}

/// Reads the file again at each SIGHUP and at each request, one after the other, until the engine ends.
///
/// # Errors
/// If the operating system refuses the handler of the signal.
pub fn start(
    path: PathBuf,
    loaded: Loaded,
    definitions: Definitions,
    engine: mpsc::Sender<Reload>,
) -> anyhow::Result<Reloads> {
    let hangups = signal(SignalKind::hangup()).context("signals cannot be handled")?;
    let (requests, waiting) = mpsc::channel(REQUESTS);
    let (publish, running) = watch::channel(loaded);
    tokio::spawn(Task { path, definitions, engine, publish }.run(waiting, hangups));
    Ok(Reloads { requests, running })
}

struct Task {
    path: PathBuf,
    definitions: Definitions,
    /// Not the whole link, which would keep the engine alive.
    engine: mpsc::Sender<Reload>,
    publish: watch::Sender<Loaded>,
}

impl Task {
    async fn run(self, mut waiting: mpsc::Receiver<Reread>, mut hangups: Signal) {
        let mut requests_end = false;
        loop {
            let request = tokio::select! {
                Some(()) = hangups.recv() => None,
                request = waiting.recv(), if !requests_end => match request {
                    Some(request) => Some(request),
                    None => {
                        requests_end = true;
                        continue;
                    }
                },
                () = self.engine.closed() => return,
            };
            let take = request.as_ref().is_none_or(|request| request.take);
            let shown = request.as_ref().and_then(|request| request.shown.as_deref());
            let (taken, read) = self.read(take, shown).await;
            if taken || (take && read.is_err()) {
                self.log(&read);
            }
            if let Some(request) = request {
                // Who asked may have gone.
                let _ = request.reply.send(rereading(taken, &read));
            }
        }
    }

    /// Whether the file was taken, and what it is. What differs from what was shown is not taken.
    async fn read(&self, take_it: bool, shown: Option<&str>) -> (bool, Result<Outcome, ReloadError>) {
        let current = self.publish.borrow().clone();
        let outcome = match preview(&self.path, &current, &self.definitions).await {
            Ok(outcome) => outcome,
            Err(error) => return (false, Err(error)),
        };
        if !take_it || shown.is_some_and(|shown| shown != digest(&outcome)) {
            return (false, Ok(outcome));
        }
        if let Err(error) = take(&outcome, &self.engine).await {
            return (false, Err(error));
        }
        self.publish.send_replace(outcome.loaded.clone());
        (true, Ok(outcome))
    }

    fn log(&self, read: &Result<Outcome, ReloadError>) {
        let file = self.path.display();
        match read {
            Ok(outcome) if outcome.differences.is_empty() => {
                tracing::info!("{file} was read again and means the same as before");
            }
            Ok(outcome) => {
                tracing::info!("{file} was read again and taken:{}", bullets(&outcome.differences));
                if outcome.topics_changed {
                    tracing::info!(
                        "other topics are listened to, or other fields of them, or other hosts asked"
                    );
                }
                if let Some(warnings) = &outcome.warnings {
                    tracing::warn!("{file} can be used, but:\n{warnings}");
                }
            }
            Err(problems @ ReloadError::Configuration(_)) => {
                tracing::error!(
                    "{file} was read again and refused; the old configuration stays:\n{problems}"
                );
            }
            Err(error) => tracing::error!("{file} was not taken: {error}"),
        }
    }
}

fn bullets(differences: &[Difference]) -> String {
    differences.iter().map(|difference| format!("\n  {difference}")).collect()
}

/// What was read, and against what: the differences change with what runs.
fn digest(outcome: &Outcome) -> String {
    let mut hash = Sha256::new();
    hash.update(outcome.loaded.digest());
    hash.update(bullets(&outcome.differences));
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

fn rereading(taken: bool, read: &Result<Outcome, ReloadError>) -> Rereading {
    match read {
        Ok(outcome) => Rereading {
            taken: taken && !outcome.differences.is_empty(),
            differences: outcome.differences.iter().map(ToString::to_string).collect(),
            problems: None,
            warnings: outcome.warnings.as_ref().map(|warnings| warnings.render(false)),
            digest: digest(outcome),
        },
        Err(error) => Rereading {
            taken: false,
            differences: Vec::new(),
            problems: Some(error.to_string()),
            warnings: None,
            digest: String::new(),
        },
    }
}

#[cfg(test)]
mod tests;
