//! Reloads the configuration while the vehicle runs: the file is read once, shown as a difference, and taken
//! completely or not at all. Modules that stay keep their state.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use sha2::{Digest as _, Sha256};
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::timeout;

use crate::cli::configuration::init::unconfigured;
use crate::cli::fields;
use crate::config::{self, Difference, Loaded};
use crate::engine::model::monitors::Watched;
use crate::engine::model::{FieldSource, Model};
use crate::engine::text::hex;
use crate::msg::fields::Definitions;
use crate::runtime::{ConfigurationText, Reload, Reread, Rereading, Written};
use crate::yaml::Problems;

/// Requests that may wait. A full queue makes the senders wait: each reads a file and a person reads
/// the answer.
const REQUESTS: usize = 4;

/// A reading that takes longer is given up; its thread may hang for ever.
const READ_WITHIN: Duration = Duration::from_secs(20);
/// Readings that may hang.
const READINGS_MAX: usize = 4;

/// The answer to a reload waits for the judgement of every situation for this long.
const JUDGED_WITHIN: Duration = Duration::from_secs(2);

/// A configuration that was read while another one runs.
#[derive(Debug, Clone)]
pub struct Outcome {
    pub loaded: Loaded,
    /// Empty if it means the same as the one that runs.
    pub differences: Vec<Difference>,
    /// The bridge has to listen to other topics.
    pub topics_changed: bool,
}

#[derive(Debug, thiserror::Error)]
pub enum ReloadError {
    /// Everything that is wrong with the file. The old configuration stays.
    #[error("{0}")]
    Configuration(#[from] Problems),
    #[error("the engine has ended")]
    Ended,
    #[error(
        "the configuration was not read within {} s: a disk or a network does not answer, or there is too much to \
         read. The old configuration stays; ask again when that is mended", READ_WITHIN.as_secs()
    )]
    Slow,
    #[error(
        "{READINGS_MAX} earlier readings have not ended: a disk does not answer, or there is too much to read. Restart \
         when that is mended"
    )]
    Stuck,
}

/// Reads a configuration and compares it with the one that runs.
///
/// # Errors
/// Everything that is wrong with the file.
async fn read(
    path: &Path,
    current: &Loaded,
    definitions: &Definitions,
    readings: &Readings,
) -> Result<Outcome, ReloadError> {
    let (path, current, definitions) = (path.to_owned(), current.clone(), definitions.clone());
    let read = move || {
        if current.sources().are_unchanged() {
            let differences = Vec::new();
            return Ok(Outcome { loaded: current, differences, topics_changed: false });
        }
        // By the folders of the start: what reads the messages knows no others.
        let loaded = fields::whole(config::examine(&path), |_| definitions)?;
        let differences = config::difference(&current, &loaded);
        let topics_changed = sources(&current.model) != sources(&loaded.model);
        Ok(Outcome { loaded, differences, topics_changed })
    };
    readings.read(read).await
}

/// The readings that go on, each in a thread of its own.
#[derive(Debug, Clone, Default)]
struct Readings(Arc<()>);

impl Readings {
    /// Waits for a reading, and gives it up if it hangs: the next one may work.
    async fn read<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> Result<T, ReloadError> + Send + 'static,
    ) -> Result<T, ReloadError> {
        if Arc::strong_count(&self.0) > READINGS_MAX {
            return Err(ReloadError::Stuck);
        }
        let place = self.0.clone();
        let done = aside(move || {
            let _place = place;
            work()
        });
        timeout(READ_WITHIN, done)
            .await
            .map_or(Err(ReloadError::Slow), |it| it.unwrap_or(Err(ReloadError::Ended)))
    }
}

/// Lets the engine run by a configuration.
///
/// # Errors
/// If the engine has ended.
async fn take(outcome: Outcome, engine: &mpsc::Sender<Reload>) -> Result<Outcome, ReloadError> {
    if !outcome.differences.is_empty() {
        let (done, taken) = oneshot::channel();
        let texts = texts(&outcome.loaded);
        let reload = Reload { model: outcome.loaded.model.clone(), texts, done };
        engine.send(reload).await.map_err(|_| ReloadError::Ended)?;
        taken.await.map_err(|_| ReloadError::Ended)?;
    }
    Ok(outcome)
}

/// Runs work on files, which may take too long for a thread that others wait for. The end of the program does not
/// wait for it. `None` if it failed.
async fn aside<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    let (done, result) = oneshot::channel();
    let thread = std::thread::Builder::new().name("configuration".to_owned());
    // The asker may have gone.
    thread.spawn(move || done.send(work()).is_ok()).ok()?;
    result.await.ok()
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
    take(read(path, current, definitions, &Readings::default()).await?, engine).await
}

/// The topics from which signals come, and what monitors watch.
fn sources(model: &Model) -> (Vec<&FieldSource>, &Watched) {
    (model.signals.iter().filter_map(|signal| signal.source.field()).collect(), &model.watched)
}

/// The channels to the task that [`start`] starts.
#[derive(Debug, Clone)]
pub struct Reloads {
    /// For the developer's page.
    pub requests: mpsc::Sender<Reread>,
    /// The configuration that runs, for the bridge, which listens to its topics, and the pages, which show its stops.
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
    let running = texts(&loaded);
    let (publish, followed) = watch::channel(loaded);
    let readings = Readings::default();
    let task = Task { path, definitions, readings, engine, publish, running, shown: None, judging: None };
    tokio::spawn(task.run(waiting, hangups));
    Ok(Reloads { requests, running: followed })
}

/// Lets the engine run by one text after the other, until it ends. Returns the configuration that runs. SIGHUP
/// finds no file to read.
///
/// # Errors
/// If the operating system refuses the handler of the signal.
pub fn follow(
    mut drafts: mpsc::Receiver<String>,
    loaded: Loaded,
    engine: mpsc::Sender<Reload>,
) -> anyhow::Result<watch::Receiver<Loaded>> {
    let mut hangups = signal(SignalKind::hangup()).context("signals cannot be handled")?;
    let (publish, followed) = watch::channel(loaded);
    tokio::spawn(async move {
        loop {
            let text = tokio::select! {
                Some(()) = hangups.recv() => {
                    tracing::warn!("there is no configuration to read again: `serve` was started without one");
                    continue;
                }
                text = drafts.recv() => text,
                () = engine.closed() => None,
            };
            let Some(text) = text else { return };
            let loaded = match unconfigured::parse(&text) {
                Ok(loaded) => loaded,
                Err(problems) => {
                    tracing::error!("what was heard cannot be shown by node:\n{problems}");
                    continue;
                }
            };
            let differences = config::difference(&publish.borrow(), &loaded);
            let outcome = Outcome { loaded, differences, topics_changed: false };
            match take(outcome, &engine).await {
                Ok(outcome) => drop(publish.send_replace(outcome.loaded)),
                Err(_) => return,
            }
        }
    });
    Ok(followed)
}

/// The files of a configuration.
pub fn texts(loaded: &Loaded) -> Arc<[ConfigurationText]> {
    let text =
        |(name, text): (&str, &str)| ConfigurationText { name: name.to_owned(), text: text.to_owned() };
    loaded.sources().texts().map(text).collect()
}

/// The files of a configuration, with the line of each node.
pub fn written(loaded: &Loaded) -> Arc<Written> {
    let lines = loaded.lines().map(|(node, file, line)| (node.into(), (file, line)));
    Arc::new(Written { texts: texts(loaded), lines: lines.collect() })
}

/// The situations that should not occur with a configuration, found by a thread of its own: that may take long.
struct Judging {
    of: Loaded,
    said: watch::Receiver<Option<Judged>>,
}

/// What was found; it may be taken all the same.
type Judged = Option<String>;

impl Judging {
    fn start(of: Loaded) -> Judging {
        let (saying, said) = watch::channel(None);
        let loaded = of.clone();
        let judge = move || saying.send_replace(Some(loaded.soundness().1.map(|found| found.render(false))));
        if let Err(error) = std::thread::Builder::new().name("configuration".to_owned()).spawn(judge) {
            tracing::error!(%error, "the configuration cannot be judged");
        }
        Judging { of, said }
    }

    fn is_of(&self, loaded: &Loaded) -> bool {
        self.of.sources().texts().eq(loaded.sources().texts())
    }
}

struct Task {
    path: PathBuf,
    definitions: Definitions,
    readings: Readings,
    /// Not the whole link, which would keep the engine alive.
    engine: mpsc::Sender<Reload>,
    publish: watch::Sender<Loaded>,
    running: Arc<[ConfigurationText]>,
    /// What was read and not taken: exactly that is taken if a request names its digest.
    shown: Option<Outcome>,
    /// One at a time: the page asks again for another configuration.
    judging: Option<Judging>,
}

impl Task {
    async fn run(mut self, mut waiting: mpsc::Receiver<Reread>, mut hangups: Signal) {
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
            let judged = match &read {
                Ok(it) => self.judge(&it.loaded, if taken { JUDGED_WITHIN } else { Duration::ZERO }).await,
                Err(_) => None,
            };
            if taken || (take && read.is_err()) {
                self.log(&read, judged.as_ref());
            }
            if let Some(request) = request {
                // The asker may have gone.
                let _ = request.reply.send(self.rereading(taken, &read, judged));
            }
        }
    }

    /// Returns whether a configuration was taken, and which one was read. One that differs from the one that
    /// was shown is not taken.
    async fn read(&mut self, take_it: bool, shown: Option<&str>) -> (bool, Result<Outcome, ReloadError>) {
        let current = self.publish.borrow().clone();
        let is_shown = |outcome: &Outcome| shown.is_none_or(|shown| shown == digest(outcome));
        let before = self.shown.take().filter(|outcome| take_it && shown.is_some() && is_shown(outcome));
        let outcome = match before {
            Some(outcome) => outcome,
            None => match read(&self.path, &current, &self.definitions, &self.readings).await {
                Ok(outcome) => outcome,
                Err(error) => return (false, Err(error)),
            },
        };
        if !take_it || !is_shown(&outcome) {
            self.shown = Some(outcome.clone());
            return (false, Ok(outcome));
        }
        let taken = take(outcome, &self.engine).await;
        if let Ok(outcome) = &taken {
            self.running = texts(&outcome.loaded);
            self.publish.send_replace(outcome.loaded.clone());
        }
        (taken.is_ok(), taken)
    }

    fn rereading(
        &self,
        taken: bool,
        read: &Result<Outcome, ReloadError>,
        judged: Option<Judged>,
    ) -> Rereading {
        let running = self.running.clone();
        match read {
            Ok(outcome) => Rereading {
                taken: taken && !outcome.differences.is_empty(),
                differences: outcome.differences.iter().map(ToString::to_string).collect(),
                problems: None,
                judged: judged.is_some(),
                warnings: judged.flatten(),
                running,
                digest: digest(outcome),
            },
            Err(error) => Rereading {
                taken: false,
                differences: Vec::new(),
                problems: Some(error.to_string()),
                warnings: None,
                judged: true,
                running,
                digest: String::new(),
            },
        }
    }

    /// The situations that should not occur with a configuration; `None` while they are being found.
    async fn judge(&mut self, loaded: &Loaded, within: Duration) -> Option<Judged> {
        let judge = async {
            if let Some(other) = self.judging.as_mut().filter(|it| !it.is_of(loaded)) {
                let _ = other.said.wait_for(Option::is_some).await;
            }
            let judging = match &mut self.judging {
                Some(judging) if judging.is_of(loaded) => judging,
                other => other.insert(Judging::start(loaded.clone())),
            };
            judging.said.wait_for(Option::is_some).await.ok()?.clone()
        };
        timeout(within, judge).await.ok()?
    }

    fn log(&self, read: &Result<Outcome, ReloadError>, judged: Option<&Judged>) {
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
                match judged {
                    Some(None) => {}
                    Some(Some(warnings)) => tracing::warn!("{file} can be used, but:\n{warnings}"),
                    None => tracing::warn!(
                        "its situations are not judged yet; `telltale check {file}` tells them"
                    ),
                }
            }
            Err(problems @ ReloadError::Configuration(_)) => {
                tracing::error!(
                    "{file} was read again and refused; the old configuration stays until the end of the program, which \
                     does not start with this file:\n{problems}"
                );
            }
            Err(error) => tracing::error!("{file} was not taken: {error}"),
        }
    }
}

fn bullets(differences: &[Difference]) -> String {
    differences.iter().map(|difference| format!("\n  {difference}")).collect()
}

/// A digest of the files and of the differences, which change with the running configuration.
fn digest(outcome: &Outcome) -> String {
    let mut hash = Sha256::new();
    for text in outcome.loaded.sources().texts().flat_map(|(name, text)| [name, text]) {
        hash.update((text.len() as u64).to_le_bytes());
        hash.update(text);
    }
    hash.update(bullets(&outcome.differences));
    hex(&hash.finalize())
}

#[cfg(test)]
mod tests;
