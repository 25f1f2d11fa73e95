//! Fetches recordings: asks vehicles for them, reads their pieces at the hub, and stores a file when its size and hash are
//! those that were told.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::{FileExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use telltale_clock::unix_ms;
use telltale_engine::time::{Span, Timestamp};
use telltale_fleet::fetching;
use telltale_fleet::message::{PIECE_BYTES, Pieces, VehicleId};
use telltale_record::folder::{file_name, number_of};
use telltale_record::writer::hash_file;
use telltale_store::Store;
use telltale_store::audit::{Action, Record, TELLTALE};
use telltale_yaml::private_file::make_folder;

use crate::follow::Shared;
use crate::state::recordings::Step;

/// The folder of the recordings, in the data folder.
pub const FOLDER: &str = "recordings";

/// Bytes of all recordings here, as many as a hub has for its logs and pieces by default. Beyond it the oldest are removed.
pub const STORED_BYTES_MAX: u64 = 10_000_000_000;

/// When no piece comes it is looked again after this time.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// A vehicle that does not answer is asked again after the first of these times, and one that sends no pieces after the
/// second: the hub may have lost them.
const ASK_AGAIN: Span = Span::from_secs(10);
const MISSED_FOR: Span = Span::from_secs(60);

/// So many pieces are on the disk here before they leave the hub.
const REMOVED_AT_ONCE: u64 = 16;

/// Why a recording does not go on.
enum Trouble {
    /// The pieces are not those of the recording that the vehicle announced.
    Vehicle(&'static str),
    /// The hub or the disk does not answer. It goes on when that works again.
    Here(String),
}

impl From<io::Error> for Trouble {
    fn from(error: io::Error) -> Trouble {
        Trouble::Here(error.to_string())
    }
}

/// One recording that comes.
struct Coming {
    id: VehicleId,
    number: u64,
    pieces: Pieces,
    is_asked: bool,
}

/// The path of the recording of an incident. Nothing in it comes from a vehicle but its id, which has no slash.
pub fn path_of(folder: &Path, id: &VehicleId, number: u64) -> PathBuf {
    folder.join(id.as_str()).join(file_name(number))
}

struct Fetching {
    shared: Shared,
    audit: Store,
    folder: PathBuf,
    /// When a vehicle was asked last, or its last piece came.
    last: BTreeMap<(VehicleId, u64), Timestamp>,
    /// The hub or the disk refused, which was said.
    has_failed: bool,
}

impl Shared {
    /// Fetches the recordings that are asked for, and those that vehicles send by themselves, into a folder, until it is
    /// aborted.
    pub async fn fetch(self, folder: PathBuf, audit: Store) {
        let last = BTreeMap::new();
        let mut fetching = Fetching { shared: self, audit, folder, last, has_failed: false };
        loop {
            if !fetching.round().await {
                tokio::time::sleep(LOOK_EVERY).await;
            }
        }
    }
}

impl Fetching {
    /// Takes one piece of each recording that comes. Returns whether there was one.
    async fn round(&mut self) -> bool {
        let Some(hub) = self.shared.logs().map(|it| it.pieces()) else { return false };
        let clock = self.shared.clock;
        let (asked, coming) = {
            let mut fleet = self.shared.fleet();
            fleet.give_up_recordings(unix_ms(clock.wall()));
            self.last.retain(|(id, number), _| fleet.vehicle(id).is_some_and(|it| it.is_open(*number)));
            open(&fleet)
        };
        for (id, numbers) in asked {
            self.ask(&hub, &id, &numbers, ASK_AGAIN).await;
        }
        let mut has_come = false;
        for it in &coming {
            match self.take_piece(&hub, it, &coming).await {
                Ok(true) => {
                    self.last.insert((it.id.clone(), it.number), clock.now());
                    (has_come, self.has_failed) = (true, false);
                }
                Ok(false) if it.is_asked => {
                    self.last.entry((it.id.clone(), it.number)).or_insert(clock.now());
                    self.ask(&hub, &it.id, &[it.number], MISSED_FOR).await;
                }
                Ok(false) => {}
                Err(Trouble::Vehicle(why)) => self.refuse(&hub, it, why).await,
                Err(Trouble::Here(why)) => {
                    if !std::mem::replace(&mut self.has_failed, true) {
                        tracing::error!("the recordings of vehicles do not go on: {why}");
                    }
                }
            }
        }
        has_come
    }

    /// Asks a vehicle for those that it was not asked for in this time.
    async fn ask(&mut self, hub: &fetching::Pieces, id: &VehicleId, numbers: &[u64], every: Span) {
        let now = self.shared.clock.now();
        let mut due = numbers.to_vec();
        due.retain(|number| {
            self.last.get(&(id.clone(), *number)).is_none_or(|last| now.since(*last) >= every)
        });
        if due.is_empty() {
            return;
        }
        self.last.extend(due.iter().map(|number| ((id.clone(), *number), now)));
        // On a line that is cut it is asked again later.
        let _ = hub.want(id, &due).await;
    }

    /// Takes the next piece, and the whole file after the last one. `false`: it is not there.
    async fn take_piece(&self, hub: &fetching::Pieces, it: &Coming, all: &[Coming]) -> Result<bool, Trouble> {
        let (pieces, part) = (&it.pieces, self.part_of(it));
        let (file, have) = opened(&part)?;
        if have < pieces.pieces {
            let read = hub.read(&it.id, &pieces.sha256, have).await.map_err(Trouble::Here)?;
            let Some(piece) = read else { return Ok(false) };
            if piece.bytes.len() != pieces.len_of(have) {
                return Err(Trouble::Vehicle("a piece has a wrong size"));
            }
            if have == 0 && !self.make_room(it, all)? {
                return Ok(false);
            }
            file.write_all_at(&piece.bytes, have * PIECE_BYTES as u64)?;
            if (have + 1).is_multiple_of(REMOVED_AT_ONCE) {
                file.sync_data()?;
                let removed = hub.remove(&it.id, &pieces.sha256, Some(piece.sequence + 1)).await;
                removed.map_err(Trouble::Here)?;
            }
            if have + 1 < pieces.pieces {
                self.now_is(it, Step::Coming { pieces: pieces.clone(), have: have + 1 });
                return Ok(true);
            }
        }
        let more = hub.read(&it.id, &pieces.sha256, pieces.pieces).await.map_err(Trouble::Here)?;
        if more.is_some() {
            return Err(Trouble::Vehicle("there are more pieces than it was said to have"));
        }
        let hashed = part.clone();
        let hashed = tokio::task::spawn_blocking(move || {
            file.sync_all()?;
            hash_file(&hashed)
        });
        let hash = hashed.await.map_err(io::Error::other)??;
        if hash != pieces.sha256 || fs::metadata(&part)?.len() != pieces.bytes {
            return Err(Trouble::Vehicle("its content has another hash"));
        }
        fs::rename(&part, path_of(&self.folder, &it.id, it.number))?;
        let target = format!("{}/{} sha256:{hash}", it.id, it.number);
        self.audit.record(Record::of(Action::RecordingStored, TELLTALE).on(target), None).await;
        self.now_is(it, Step::Here(pieces.clone()));
        hub.remove(&it.id, &pieces.sha256, None).await.map_err(Trouble::Here)?;
        Ok(true)
    }

    fn now_is(&self, it: &Coming, step: Step) {
        self.shared.fleet().recording_is(&it.id, it.number, &it.pieces, step);
    }

    /// The pieces are not those of the recording that the vehicle announced: they are removed, counted, and reported.
    async fn refuse(&self, hub: &fetching::Pieces, it: &Coming, why: &'static str) {
        let _ = fs::remove_file(self.part_of(it));
        let record = Record::of(Action::RecordingStored, TELLTALE).on(format!("{}/{}", it.id, it.number));
        self.audit.record(record.refused(why), None).await;
        self.shared.fleet().refuse_recording(&it.id, it.number, &it.pieces, why);
        // What stays at the hub leaves it with its age.
        let _ = hub.remove(&it.id, &it.pieces.sha256, None).await;
    }

    fn part_of(&self, it: &Coming) -> PathBuf {
        path_of(&self.folder, &it.id, it.number).with_extension(format!("{}.part", it.pieces.sha256))
    }

    /// Removes the oldest recordings, and parts of others than come. One that nobody asked for pushes out no recording of
    /// another vehicle. `false`: it has no room now.
    fn make_room(&self, it: &Coming, all: &[Coming]) -> io::Result<bool> {
        let (mut stored, mut bytes) = (Vec::new(), it.pieces.bytes);
        for vehicle in fs::read_dir(&self.folder)? {
            for file in fs::read_dir(vehicle?.path())? {
                let (path, about) = file.and_then(|it| Ok((it.path(), it.metadata()?)))?;
                let is_part = path.extension().is_some_and(|it| it == "part");
                match all.iter().find(|it| is_part && self.part_of(it) == path) {
                    Some(other) if about.len() > 0 => bytes += other.pieces.bytes,
                    Some(_) => {}
                    None if is_part => fs::remove_file(&path)?,
                    None => stored.push((about.modified()?, about.len(), path)),
                }
            }
        }
        let own = self.folder.join(it.id.as_str());
        bytes += stored.iter().map(|(_, size, _)| size).sum::<u64>();
        stored.retain(|(.., path)| it.is_asked || path.starts_with(&own));
        let free: u64 = stored.iter().map(|(_, size, _)| size).sum();
        if bytes - free > STORED_BYTES_MAX {
            return Ok(false);
        }
        stored.sort();
        for (_, size, path) in stored {
            if bytes <= STORED_BYTES_MAX {
                break;
            }
            fs::remove_file(&path)?;
            bytes -= size;
            let name = |path: &Path| path.file_name()?.to_str().map(str::to_owned);
            let id = path.parent().and_then(name).and_then(|it| VehicleId::new(&it));
            let number = name(&path).and_then(|it| number_of(&it));
            if let Some((id, number)) = id.zip(number) {
                self.shared.fleet().recording_removed(&id, number);
            }
        }
        Ok(true)
    }
}

/// The recordings that were asked for, by their vehicles, and those that come.
fn open(fleet: &crate::state::Fleet) -> (BTreeMap<VehicleId, Vec<u64>>, Vec<Coming>) {
    let (mut asked, mut coming) = (BTreeMap::<_, Vec<u64>>::new(), Vec::new());
    for vehicle in fleet.vehicles() {
        for (number, transfer) in vehicle.open_recordings() {
            let id = vehicle.id.clone();
            match &transfer.step {
                Step::Coming { pieces, .. } => {
                    let (pieces, is_asked) = (pieces.clone(), transfer.is_asked);
                    coming.push(Coming { id, number, pieces, is_asked });
                }
                _ => asked.entry(id).or_default().push(number),
            }
        }
    }
    (asked, coming)
}

/// A file that is not whole yet, and how many pieces it has.
fn opened(part: &Path) -> io::Result<(File, u64)> {
    if let Some(folder) = part.parent() {
        make_folder(folder)?;
    }
    let mut options = OpenOptions::new();
    let file = options.read(true).write(true).create(true).truncate(false).mode(0o600).open(part)?;
    let have = file.metadata()?.len() / PIECE_BYTES as u64;
    file.set_len(have * PIECE_BYTES as u64)?;
    Ok((file, have))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::SystemTime;
    use telltale_clock::Clock;
    use telltale_store::DemoSecrets;

    #[tokio::test]
    async fn the_oldest_make_room_and_those_of_others_only_for_one_that_is_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let (clock, _hand) = Clock::standing();
        let store = crate::kept::Store::open(folder.path(), clock).unwrap();
        let fetching = Fetching {
            shared: Shared::new(store.fleet().unwrap(), clock),
            audit: Store::in_memory(clock, DemoSecrets::Refused).unwrap(),
            folder: folder.path().join(FOLDER),
            last: BTreeMap::new(),
            has_failed: false,
        };
        let [a, b] = ["a", "b"].map(|id| VehicleId::new(id).unwrap());
        let coming = |is_asked| Coming {
            id: a.clone(),
            number: 9,
            pieces: Pieces::of(&"ab".repeat(32), 1 << 30).unwrap(),
            is_asked,
        };
        // Files of holes, the oldest first.
        let make = |path: &Path, gigabytes: u64, age_s: u64| {
            make_folder(path.parent().unwrap()).unwrap();
            let file = File::create(path).unwrap();
            file.set_len(gigabytes * 1_000_000_000).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(1_780_000_000 - age_s)).unwrap();
        };
        let path = |id: &VehicleId, number| path_of(&fetching.folder, id, number);
        make(&path(&b, 1), 6, 30);
        make(&path(&b, 2), 2, 20);
        make(&path(&a, 3), 1, 10);
        let stale = path(&b, 2).with_extension("part");
        make(&stale, 9, 0);
        assert!(fetching.make_room(&coming(false), &[]).unwrap());
        let there = || [path(&b, 1), path(&b, 2), path(&a, 3), stale.clone()].map(|it| it.exists());
        assert_eq!(there(), [true, true, false, false], "its own went");
        make(&path(&b, 4), 1, 0);
        assert!(!fetching.make_room(&coming(false), &[]).unwrap());
        assert_eq!(there(), [true, true, false, false]);
        assert!(fetching.make_room(&coming(true), &[]).unwrap());
        assert_eq!(there(), [false, true, false, false]);
    }
}
