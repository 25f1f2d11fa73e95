//! What-ifs over a group of incidents: the recordings of the group that were fetched are judged by another configuration,
//! one after the other in the background. The result stays on the disk.

use std::collections::BTreeSet;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};
use telltale_clock::{Clock, unix_ms};
use telltale_engine::time::{Span, Timestamp};
use telltale_record::folder::file_name;
use telltale_record::ring::ConfigurationText;
use telltale_record::writer::digest;
use telltale_web::Examiner;
use telltale_web::common::{JudgedRow, lower_priority};
use telltale_web::incidents::{Compared, Comparison, Mistake, RUN_WITHIN, Stop, Trouble, runnable};
use telltale_web::texts::Lang;
use telltale_yaml::private_file::{make_folder, write_private};

use crate::state::incidents::{GroupBy, IncidentRow};

/// The folder of the what-ifs, in the data folder.
pub const FOLDER: &str = "what-ifs";

/// What-ifs that are kept. A new one takes the place of the oldest that is over.
pub const KEPT_MAX: usize = 20;

/// Recordings of one what-if, the newest ones.
pub const RECORDINGS_MAX: usize = 200;

/// All recordings of one must be done within this time; each has as long as those of a vehicle's what-if.
const ALL_WITHIN: Span = Span::from_secs(3600);

/// A larger file is none of them.
const FILE_BYTES_MAX: u64 = 32 << 20;

/// A what-if, as it lies on the disk.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct WhatIf {
    pub number: u64,
    pub by: GroupBy,
    /// The cause, version or configuration of these incidents.
    pub group: String,
    pub who: String,
    pub began_ms: i64,
    /// The vehicles of all incidents of the group.
    #[serde(default)]
    pub vehicles: BTreeSet<String>,
    /// All incidents of the group, and those with a recording here.
    pub incidents: usize,
    pub fetched: usize,
    pub texts: Vec<ConfigurationText>,
    /// The SHA-256 of that.
    pub config: String,
    pub progress: Progress,
    /// The recordings to judge, the newest first.
    pub chosen: Vec<Chosen>,
    /// The differences in meaning from the configuration of the first recording that was judged.
    pub differences: Vec<String>,
    /// In the order of `chosen`.
    pub judged: Vec<Judged>,
}

/// An incident with a recording here.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Chosen {
    pub vehicle: String,
    pub number: u64,
    pub since: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Progress {
    Waiting,
    Running,
    /// The configuration is wrong.
    Wrong(Vec<Mistake>),
    Done,
    Cancelled,
    /// The console ended before all were judged.
    Ended,
}

/// The result for one recording.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Judged {
    pub of: Chosen,
    /// In each language.
    rows: [JudgedRow; Lang::ALL.len()],
}

impl Judged {
    fn of(of: Chosen, result: Result<Comparison, Trouble>) -> Judged {
        let number = of.number;
        let compared = Compared { incident: number, result };
        Judged { of, rows: Lang::ALL.map(|lang| JudgedRow::of(lang, &compared, number, number)) }
    }

    pub fn row(&self, lang: Lang) -> &JudgedRow {
        let [en, de] = &self.rows;
        lang.choose(en, de)
    }

    /// `differs`, `same` or `unread`.
    pub fn result(&self) -> &'static str {
        match &self.rows[0] {
            JudgedRow { trouble: Some(_), .. } => "unread",
            JudgedRow { differs: true, .. } => "differs",
            _ => "same",
        }
    }
}

impl WhatIf {
    /// Not started, over the incidents of a group.
    pub fn over(by: GroupBy, group: &str, incidents: &[IncidentRow], who: &str) -> WhatIf {
        let fetched = incidents.iter().filter(|it| it.is_fetched).count();
        let chosen = incidents.iter().filter(|it| it.is_fetched).take(RECORDINGS_MAX).map(|it| Chosen {
            vehicle: it.vehicle.clone(),
            number: it.number,
            since: it.since.clone(),
        });
        WhatIf {
            number: 0,
            by,
            group: group.to_owned(),
            who: who.to_owned(),
            began_ms: 0,
            vehicles: incidents.iter().map(|it| it.vehicle.clone()).collect(),
            incidents: incidents.len(),
            fetched,
            texts: Vec::new(),
            config: String::new(),
            progress: Progress::Waiting,
            chosen: chosen.collect(),
            differences: Vec::new(),
            judged: Vec::new(),
        }
    }

    pub fn is_open(&self) -> bool {
        matches!(self.progress, Progress::Waiting | Progress::Running)
    }

    pub fn count(&self, result: &str) -> usize {
        self.judged.iter().filter(|it| it.result() == result).count()
    }
}

impl Progress {
    pub fn word(&self) -> &'static str {
        match self {
            Progress::Waiting => "waiting",
            Progress::Running => "running",
            Progress::Wrong(_) => "wrong",
            Progress::Done => "done",
            Progress::Cancelled => "cancelled",
            Progress::Ended => "ended",
        }
    }
}

/// All that are kept.
#[derive(Debug)]
pub struct WhatIfs {
    folder: PathBuf,
    recordings: PathBuf,
    clock: Clock,
    examiner: Examiner,
    all: Mutex<All>,
}

#[derive(Debug, Default)]
struct All {
    /// The oldest first.
    what_ifs: Vec<WhatIf>,
    /// A thread judges. It ends when none waits.
    is_working: bool,
}

impl All {
    fn has_room(&self, who: &str) -> bool {
        let open = || self.what_ifs.iter().filter(|it| it.is_open());
        open().count() < KEPT_MAX && open().all(|it| it.who != who)
    }
}

impl WhatIfs {
    /// Reads those that are kept in a data folder.
    pub fn open(data: &Path, clock: Clock, examiner: Examiner) -> Arc<WhatIfs> {
        let folder = data.join(FOLDER);
        let files = fs::read_dir(&folder).into_iter().flatten().flatten();
        let mut what_ifs: Vec<WhatIf> = files.filter_map(|file| read(&file.path())).collect();
        what_ifs.sort_by_key(|it| it.number);
        let recordings = data.join(crate::recordings::FOLDER);
        let all = Mutex::new(All { what_ifs, is_working: false });
        Arc::new(WhatIfs { folder, recordings, clock, examiner, all })
    }

    fn all(&self) -> MutexGuard<'_, All> {
        self.all.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes something of all, the newest first.
    pub fn each<T>(&self, of: impl FnMut(&WhatIf) -> T) -> Vec<T> {
        self.all().what_ifs.iter().rev().map(of).collect()
    }

    /// Makes something of one; `None` if it is not, or no longer, kept.
    pub fn with<T>(&self, number: u64, of: impl FnOnce(&WhatIf) -> T) -> Option<T> {
        self.all().what_ifs.iter().find(|it| it.number == number).map(of)
    }

    /// Whether this user may start another one: each has one that is open, and there is room.
    pub fn has_room(&self, who: &str) -> bool {
        self.all().has_room(who)
    }

    /// Starts one, and returns its number. `None`: there is no room. It writes to the disk.
    pub fn start(self: &Arc<Self>, what_if: WhatIf) -> Option<u64> {
        let mut all = self.all();
        if !all.has_room(&what_if.who) {
            return None;
        }
        while all.what_ifs.len() >= KEPT_MAX {
            let index = all.what_ifs.iter().position(|it| !it.is_open())?;
            let oldest = all.what_ifs.remove(index);
            let _ = fs::remove_file(self.path_of(oldest.number));
        }
        let number = all.what_ifs.last().map_or(0, |it| it.number) + 1;
        let (began_ms, config) = (unix_ms(self.clock.wall()), digest(&what_if.texts));
        let what_if = WhatIf { number, began_ms, config, ..what_if };
        self.write(&what_if);
        all.what_ifs.push(what_if);
        if !std::mem::replace(&mut all.is_working, true) {
            let shared = self.clone();
            let work = move || {
                lower_priority();
                shared.work();
            };
            if let Err(error) = std::thread::Builder::new().name("what-if".into()).spawn(work) {
                tracing::error!(%error, "no what-if is run");
                all.is_working = false;
                drop(all);
                self.change(number, |it| it.progress = Progress::Ended);
            }
        }
        Some(number)
    }

    /// Ends a what-if. Returns whether it was open.
    pub fn cancel(&self, number: u64) -> bool {
        self.change(number, |it| it.progress = Progress::Cancelled)
    }

    /// Changes an open what-if, and writes it to the disk if that ends it. Returns whether it was open.
    fn change(&self, number: u64, change: impl FnOnce(&mut WhatIf)) -> bool {
        let mut all = self.all();
        let open = all.what_ifs.iter_mut().find(|it| it.number == number && it.is_open());
        let Some(what_if) = open else { return false };
        change(what_if);
        if !what_if.is_open() {
            self.write(what_if);
        }
        true
    }

    /// Judges until none waits. Blocks.
    fn work(&self) {
        while let Some(what_if) = self.next() {
            // A fault of one must not keep the others waiting for ever.
            if catch_unwind(AssertUnwindSafe(|| self.judge(&what_if))).is_err() {
                self.change(what_if.number, |it| it.progress = Progress::Ended);
            }
        }
    }

    fn next(&self) -> Option<WhatIf> {
        let mut all = self.all();
        let next = all.what_ifs.iter_mut().find(|it| it.progress == Progress::Waiting);
        let next = next.map(|it| {
            it.progress = Progress::Running;
            it.clone()
        });
        all.is_working = next.is_some();
        next
    }

    fn judge(&self, what_if: &WhatIf) {
        let until = self.clock.now() + ALL_WITHIN;
        for of in &what_if.chosen {
            let result = self.one(what_if, of, until);
            let goes_on = self.change(what_if.number, |it| {
                let result = match result {
                    // None could be read with it so far.
                    Err(Stop::Mistakes(mistakes)) if it.count("unread") == it.judged.len() => {
                        it.progress = Progress::Wrong(mistakes);
                        return;
                    }
                    Err(Stop::Mistakes(mistakes)) => {
                        Err(Trouble::Bad(mistakes.first().map(|it| it.message.clone()).unwrap_or_default()))
                    }
                    Err(Stop::Trouble(trouble)) => Err(trouble),
                    Ok((comparison, differences)) => {
                        if it.count("unread") == it.judged.len() {
                            it.differences = differences;
                        }
                        Ok(comparison)
                    }
                };
                it.judged.push(Judged::of(of.clone(), result));
            });
            if !goes_on {
                return;
            }
        }
        self.change(what_if.number, |it| it.progress = Progress::Done);
    }

    fn one(
        &self,
        what_if: &WhatIf,
        of: &Chosen,
        until: Timestamp,
    ) -> Result<(Comparison, Vec<String>), Stop> {
        let until = until.min(self.clock.now() + RUN_WITHIN);
        let (folder, name) = (self.recordings.join(&of.vehicle), file_name(of.number));
        let bytes = fs::metadata(folder.join(&name)).map_or(0, |it| it.len());
        let path = runnable(&folder, &name, bytes)?;
        let go_on =
            || self.clock.now() < until && self.with(what_if.number, |it| it.is_open()).unwrap_or_default();
        if !go_on() {
            return Err(Trouble::Late.into());
        }
        let (candidate, differences) = self.examiner.examined(&what_if.texts, &path)?;
        let comparison = candidate.compare(&path, &go_on).map_err(Stop::of)?;
        Ok((comparison, differences))
    }

    fn path_of(&self, number: u64) -> PathBuf {
        self.folder.join(format!("what-if-{number}.json"))
    }

    /// Without the disk it stays in memory.
    fn write(&self, what_if: &WhatIf) {
        let write = || {
            make_folder(&self.folder)?;
            write_private(&self.path_of(what_if.number), &serde_json::to_vec(what_if)?)
        };
        if let Err(error) = write() {
            tracing::error!("what-if {} is not kept: {error}", what_if.number);
        }
    }
}

/// Reads a what-if from the disk. The console ended while it ran, if it is open there.
fn read(path: &Path) -> Option<WhatIf> {
    let about = fs::symlink_metadata(path).ok()?;
    if path.extension()? != "json" || !about.is_file() || about.len() > FILE_BYTES_MAX {
        return None;
    }
    let read = fs::read(path).map_err(|it| it.to_string());
    let read = read.and_then(|text| serde_json::from_slice(&text).map_err(|it| it.to_string()));
    let mut what_if: WhatIf = read.inspect_err(|error| tracing::warn!("{}: {error}", path.display())).ok()?;
    if what_if.is_open() {
        what_if.progress = Progress::Ended;
    }
    Some(what_if)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;
    use std::sync::mpsc;
    use telltale_record::file::IncidentFile;

    /// A console's folder with the recording 1 of vehicle `a`, a file with nothing but its beginning.
    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let own = folder.path().join(crate::recordings::FOLDER).join("a");
        fs::create_dir_all(&own).unwrap();
        let about = BTreeMap::from([("start_of_clock_ns".to_owned(), "1".to_owned())]);
        IncidentFile::create(&own.join(file_name(1)), about).unwrap().finish().unwrap();
        folder
    }

    fn wrong() -> Vec<Mistake> {
        let (file, message, help) = ("vehicle.yaml".into(), "not a key".into(), "write groups".into());
        vec![Mistake { file, line: Some(3), column: Some(1), message, help }]
    }

    /// Over these incidents of vehicle `a`.
    fn over(who: &str, numbers: &[u64]) -> WhatIf {
        let of = |number: &u64| Chosen { vehicle: "a".into(), number: *number, since: String::new() };
        let texts = vec![ConfigurationText { name: "vehicle.yaml".into(), text: "a\nb\nc".into() }];
        let planned = WhatIf::over(GroupBy::Cause, "lidar", &[], who);
        WhatIf { chosen: numbers.iter().map(of).collect(), incidents: 9, texts, ..planned }
    }

    fn progress(what_ifs: &WhatIfs) -> Vec<(u64, Progress)> {
        what_ifs.each(|it| (it.number, it.progress.clone()))
    }

    fn until(what_ifs: &WhatIfs, number: u64, progress: &Progress) {
        for _ in 0..2000 {
            if what_ifs.with(number, |it| it.progress == *progress) == Some(true) {
                return;
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        panic!("{number} is not {progress:?}: {:?}", what_ifs.each(WhatIf::clone));
    }

    #[test]
    fn they_run_one_after_the_other_and_one_that_is_cancelled_or_ended_says_so_after_a_restart() {
        let folder = folder();
        let (tell, read) = mpsc::channel();
        let (end, held) = mpsc::channel::<()>();
        let held = Mutex::new(held);
        let examiner = Examiner(Box::new(move |_, _| {
            tell.send(()).unwrap();
            // Until the other end is dropped.
            let _ = held.lock().unwrap().recv();
            Err(wrong())
        }));
        let what_ifs = WhatIfs::open(folder.path(), Clock::start(), examiner);
        assert_eq!(what_ifs.start(over("anna", &[1])), Some(1));
        read.recv().unwrap();
        assert_eq!(what_ifs.start(over("anna", &[1])), None, "each has one that is open");
        assert_eq!(what_ifs.start(over("ben", &[2, 1])), Some(2));
        assert_eq!(progress(&what_ifs), [(2, Progress::Waiting), (1, Progress::Running)]);
        let again = || {
            let examiner = Examiner(Box::new(|_, _| Err(Vec::new())));
            progress(&WhatIfs::open(folder.path(), Clock::start(), examiner))
        };
        assert_eq!(again(), [(2, Progress::Ended), (1, Progress::Ended)], "the console ended");
        assert!(what_ifs.cancel(1) && !what_ifs.cancel(1) && !what_ifs.cancel(3));
        drop(end);
        until(&what_ifs, 2, &Progress::Wrong(wrong()));
        assert_eq!(again(), [(2, Progress::Wrong(wrong())), (1, Progress::Cancelled)]);
        assert_eq!(what_ifs.with(1, |it| it.judged.len()), Some(0), "nothing comes after the end");
        let [row] = &what_ifs.with(2, |it| it.judged.clone()).unwrap()[..] else { panic!("one is missing") };
        assert_eq!((row.of.number, row.result()), (2, "unread"));
        assert_eq!(row.row(Lang::De).trouble.as_deref(), Some("Die Aufzeichnung fehlt."));
    }

    #[test]
    fn the_oldest_go_and_no_number_comes_twice() {
        let folder = folder();
        let open = || {
            let examiner = Examiner(Box::new(|_, _| panic!("a fault of the program")));
            WhatIfs::open(folder.path(), Clock::start(), examiner)
        };
        let what_ifs = open();
        assert_eq!(what_ifs.start(over("anna", &[1])), Some(1));
        until(&what_ifs, 1, &Progress::Ended);
        for number in 2..KEPT_MAX as u64 + 4 {
            assert_eq!(what_ifs.start(over("anna", &[7])), Some(number));
            until(&what_ifs, number, &Progress::Done);
        }
        let again = open();
        let numbers = again.each(|it| it.number);
        assert_eq!((numbers.len(), numbers[0], numbers[KEPT_MAX - 1]), (KEPT_MAX, 23, 4));
        assert_eq!(fs::read_dir(folder.path().join(FOLDER)).unwrap().count(), KEPT_MAX);
        assert_eq!(again.start(over("anna", &[7])), Some(24));
        until(&again, 24, &Progress::Done);
    }
}
