//! The thread that writes incidents into files. It reads the ring; when the disk is slower than the world, the
//! ring forgets the oldest messages of large topics first, and the file counts what it lacks.

mod left_out;
mod open_file;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{mpsc, watch};

use super::file::{FileError, IncidentFile};
use super::folder::file_name;
use super::job::Job;
use super::recorder::{Recorder, Shared};
use super::ring::Entry;
use super::room::{FREE_MIN, Part, Room, check_room, free_bytes};
use super::summary::Summary;
use open_file::OpenFile;
pub use open_file::{digest, hash_file, unix_ms};
use telltale_clock::Clock;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::fields::Definitions;

/// Bytes that are taken from the ring at once.
const BATCH_BYTES: usize = 4 << 20;

/// The writer looks this often whether there is something to write.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// After a failure the disk is tried again this often.
const TRY_EVERY: Span = Span::from_secs(5);

/// Without a failure it is tried this often: nobody learns otherwise that it has become useless.
const LOOK_AFTER_DISK_EVERY: Span = Span::from_secs(60);

/// News that may wait for their receiver.
pub const NEWS_MAX: usize = 64;

/// The fact that names the vehicle.
pub const VEHICLE: &str = "vehicle";

/// The news of the writer.
#[derive(Debug, Clone, PartialEq)]
pub enum News {
    /// A recording began: what is known of it is on the disk.
    Begun(Summary),
    /// It has another trigger, which is on the disk.
    Extended(Summary),
    /// Its file is whole, or was given up.
    Ended(Summary),
}

/// Why nothing can be recorded; `None`: it can. It is told apart from the news, which wait for the database.
pub type Fault = Option<Arc<str>>;

/// The folder, definitions and facts that the writer needs in addition to the recorder.
#[derive(Debug, Clone)]
pub struct Place {
    /// The folder of the files.
    pub folder: PathBuf,
    pub definitions: Definitions,
    /// Facts that every file states of itself.
    pub about: BTreeMap<String, String>,
}

/// Starts the writer of a recorder's incidents. It ends with the recorder, when all is written.
pub fn start(
    recorder: &Recorder,
    place: Place,
    room: Room,
    news: mpsc::Sender<News>,
    fault: watch::Sender<Fault>,
) -> std::io::Result<std::thread::JoinHandle<()>> {
    let shared = recorder.0.clone();
    let writer =
        Writer { clock: shared.clock(), shared, place, room, news, untold: Vec::new(), fault, tried: None };
    std::thread::Builder::new().name("incidents".into()).spawn(move || writer.run())
}

struct Writer {
    shared: Arc<Shared>,
    clock: Clock,
    place: Place,
    room: Room,
    news: mpsc::Sender<News>,
    /// Ends of recordings that the receiver of news had no room for.
    untold: Vec<News>,
    fault: watch::Sender<Fault>,
    /// When the disk was tried last, or failed.
    tried: Option<Timestamp>,
}

impl Writer {
    fn run(mut self) {
        // A folder that takes no recordings is known before anybody needs one.
        self.try_the_disk();
        loop {
            let (job, ended) = {
                let mut state = self.shared.lock();
                if state.jobs.is_empty() && !state.ended {
                    state = self.shared.wait(state, LOOK_EVERY);
                }
                (state.jobs.front().cloned(), state.ended)
            };
            match job {
                Some(job) => {
                    self.write(&job);
                    let mut state = self.shared.lock();
                    state.jobs.retain(|it| it.number != job.number);
                }
                None if ended => return,
                None => self.try_the_disk_again(),
            }
            self.tell_again();
        }
    }

    /// Writes an incident from its beginning to its end.
    fn write(&mut self, job: &Job) {
        let mut part = Part::of(self.room.clone());
        let begun = self.shared.on_disk(|| {
            let most = part.most(&self.place.folder, 0, self.clock.now())?;
            OpenFile::begin(&self.place, job, most, self.clock)
        });
        let mut file = match begun {
            Ok(file) => file,
            Err(error) => return self.fail(&error),
        };
        self.tell(News::Begun(file.summary.clone()));
        let mut is_extended = false;
        loop {
            let (job, entries, gone, is_up_to_date) = {
                let state = self.shared.lock();
                let Some(job) = state.jobs.iter().find(|it| it.number == job.number).cloned() else { return };
                let (entries, gone) = state.ring.read(file.next, BATCH_BYTES);
                // A message beyond its end belongs to the next one.
                let most = job.end.map(|end| end.saturating_sub(file.next + gone));
                let most = most.and_then(|most| usize::try_from(most).ok()).unwrap_or(usize::MAX);
                let entries: Vec<Entry> = entries.into_iter().take(most).collect();
                let is_up_to_date = file.next + gone + entries.len() as u64 == state.ring.next();
                (job, entries, gone, is_up_to_date)
            };
            is_extended |= file.follow(&job);
            // A trigger is told once it is on the disk, after everything that came before it.
            let is_told = is_extended && is_up_to_date;
            let is_all = entries.is_empty();
            let written = self.shared.on_disk(|| {
                file.take(&entries, gone, &self.place)?;
                if is_told { file.save_triggers(self.clock) } else { file.end_chunk_if_due(self.clock) }
            });
            if let Err(error) = written {
                return self.give_up(file.abandon(self.clock), &error);
            }
            self.look_after_room(&mut part, &mut file);
            if is_told {
                is_extended = false;
                self.tell(News::Extended(file.summary.clone()));
            }
            match job.end {
                Some(_) if is_all => break,
                _ if is_all => {
                    let state = self.shared.lock();
                    let ends = |it: &Job| it.number == job.number && it.end.is_some();
                    // A message since the ring was read has been notified already.
                    if state.ring.next() == file.next && !state.jobs.iter().any(ends) {
                        drop(self.shared.wait(state, LOOK_EVERY));
                    }
                }
                _ => {}
            }
        }
        let (mut summary, finished) = self.shared.on_disk(|| file.finish(self.clock));
        match finished {
            Ok(()) => {
                // That of a long recording takes its time, which is no fault of the disk.
                let path = self.place.folder.join(&summary.recording.file);
                summary.recording.sha256 = hash_file(&path).ok();
                self.judge_room();
                self.tell_surely(News::Ended(summary));
            }
            Err(error) => self.give_up(summary, &error),
        }
    }

    /// The file grows no further than its room. On a full disk it waits for room, and lacks what comes meanwhile.
    fn look_after_room(&mut self, part: &mut Part, file: &mut OpenFile) {
        let (length, now) = (file.length(), self.clock.now());
        match self.shared.on_disk(|| part.most(&self.place.folder, length, now)) {
            Ok(most) => {
                file.grow_to(most);
                self.recover();
            }
            Err(error) => {
                file.grow_to(length);
                if self.fault.borrow().is_none() {
                    self.fail(&error);
                }
            }
        }
    }

    /// The disk refused more: what is there can be read.
    fn give_up(&mut self, summary: Summary, error: &FileError) {
        self.tell_surely(News::Ended(summary));
        self.fail(error);
    }

    fn fail(&mut self, error: &FileError) {
        tracing::error!(%error, "an incident cannot be recorded");
        self.tried = Some(self.clock.now());
        // If it is full, older recordings make room.
        self.room.want();
        let fault: Fault = Some(error.to_string().into());
        self.fault.send_if_modified(|said| {
            let is_new = *said != fault;
            *said = fault;
            is_new
        });
    }

    fn recover(&mut self) {
        if self.fault.borrow().is_some() {
            tracing::info!("incidents can be recorded again");
            // First: once this is told, the end of the engine may come, and ends what is open.
            self.shared.lock().take_up();
            self.fault.send_replace(None);
        }
    }

    /// Without an incident, only a trial shows whether the disk takes recordings, still or again.
    fn try_the_disk_again(&mut self) {
        let every = if self.fault.borrow().is_some() { TRY_EVERY } else { LOOK_AFTER_DISK_EVERY };
        let waits = |tried| self.clock.now().since(tried) < every;
        if !self.tried.is_some_and(waits) {
            self.try_the_disk();
        }
    }

    fn try_the_disk(&mut self) {
        let path = self.place.folder.join("trial.mcap");
        self.tried = Some(self.clock.now());
        let trial = self.shared.on_disk(|| {
            // One that a crash left behind is no fault of the disk.
            let _ = std::fs::remove_file(&path);
            let trial = IncidentFile::create(&path, BTreeMap::new()).and_then(IncidentFile::finish);
            // A trial that was never made need not be removed.
            let _ = std::fs::remove_file(&path);
            trial
        });
        match trial {
            Ok(_) => self.judge_room(),
            Err(error) => self.fail(&error),
        }
    }

    /// The disk took a file. Whether it takes a recording is another question.
    fn judge_room(&mut self) {
        match self.shared.on_disk(|| check_room(&self.place.folder)) {
            Ok(()) => self.recover(),
            Err(error) => self.fail(&error),
        }
    }

    /// News that are lost if their receiver is behind: the next ones say the same.
    fn tell(&mut self, news: News) {
        let _ = self.news.try_send(news);
    }

    fn tell_surely(&mut self, news: News) {
        self.untold.push(news);
        self.tell_again();
    }

    fn tell_again(&mut self) {
        while let Some(news) = self.untold.first() {
            match self.news.try_send(news.clone()) {
                Ok(()) | Err(mpsc::error::TrySendError::Closed(_)) => drop(self.untold.remove(0)),
                Err(mpsc::error::TrySendError::Full(_)) => break,
            }
        }
        // Incidents open once a minute: this many only wait if the receiver is gone for an hour.
        self.untold.truncate(NEWS_MAX);
    }
}

/// Writes what the ring holds at once, for a look at the last minutes, which is no incident: into a file of this folder, of the vehicle and its definitions at `place`. Blocks.
/// `None` if the ring holds no state of the engine yet.
///
/// # Errors
/// If the disk takes no such file.
pub fn write_recent(recorder: &Recorder, place: &Place, folder: &Path) -> Result<Option<PathBuf>, FileError> {
    let shared = &recorder.0;
    let Some(job) = shared.lock().everything() else { return Ok(None) };
    let place = Place { folder: folder.to_owned(), ..place.clone() };
    let most = free_bytes(folder)?.saturating_sub(FREE_MIN);
    let mut file = OpenFile::begin(&place, &job, most, shared.clock())?;
    // A piece after the other: all of it at once would keep a second ring in memory. The ring forgets the
    // oldest entries next, so they are written first; entries that a slow disk loses are counted in the file.
    while job.end.is_some_and(|end| file.next < end) {
        let (entries, gone) = shared.lock().ring.read(file.next, BATCH_BYTES);
        if entries.is_empty() {
            break;
        }
        file.take(&entries, gone, &place)?;
    }
    file.finish(shared.clock()).1?;
    Ok(Some(folder.join(file_name(job.number))))
}

#[cfg(test)]
mod tests;
