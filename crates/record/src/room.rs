//! How much room the recordings have: never more than the configuration says, nor than the disk has, at every
//! instant. The writer asks before it writes, and wakes the task that removes old recordings before room is short.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use tokio::sync::Notify;

use super::file::FileError;
use super::retention::Policy;
use telltale_engine::time::{Span, Timestamp};

/// Free bytes of the disk that recordings leave to the database, which proves them. With less, nothing is recorded.
pub const FREE_MIN: u64 = 4 << 20;

/// One incident takes at most this part of what all may take: a storm of faults leaves the recordings before it.
const SHARE_OF_ONE: u64 = 2;

/// So much more is always kept free for the next seconds: a part of all, but no more than this.
const AHEAD_SHARE: u64 = 16;
const AHEAD_MAX: u64 = 256 << 20;

/// The folder is summed up at most this often, unless recordings were removed.
const LOOK_EVERY: Span = Span::from_secs(2);

/// The room of the recordings in one folder. Clones are of the same one.
#[derive(Debug, Clone)]
pub struct Room(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    /// [`Policy::disk`], and the part of it that kept recordings leave to the others.
    disk: AtomicU64,
    reserved: AtomicU64,
    /// Kept recordings take more than they may: the others have their part all the same.
    is_kept_over: AtomicBool,
    short: Notify,
    /// The folder is not as it was.
    is_changed: AtomicBool,
}

/// Bytes of a disk and of the recordings on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Disk {
    /// Of all files in the folder of the recordings.
    pub taken: u64,
    /// That anybody may still write.
    pub free: u64,
}

impl Disk {
    pub fn of(folder: &Path) -> Result<Disk, FileError> {
        let taken = folder_bytes(folder).map_err(|why| FileError::io(folder, "examined", why))?;
        Ok(Disk { taken, free: free_bytes(folder)? })
    }

    /// Whether another file of this length has room.
    pub fn has_room_for(self, bytes: u64, policy: &Policy) -> bool {
        let free = self.free.saturating_sub(FREE_MIN).min(policy.disk.saturating_sub(self.taken));
        bytes <= free
    }

    /// The bytes that the recordings may take by a policy: no more than this disk has for them, and with some room
    /// ahead for the next recording.
    pub fn bound(self, policy: &Policy) -> Policy {
        let has = self.taken.saturating_add(self.free.saturating_sub(FREE_MIN));
        // A disk that is full already: what lacks of its last reserve is made free too.
        let has = has.saturating_sub(FREE_MIN.saturating_sub(self.free));
        let disk = policy.disk.min(has);
        let ahead = (disk / AHEAD_SHARE).min(AHEAD_MAX);
        let reserved = policy.reserved.min(disk / 10).saturating_sub(ahead);
        Policy { disk: disk - ahead, reserved, keep: policy.keep }
    }
}

impl Room {
    pub fn new(policy: &Policy) -> Room {
        let room = Room(Arc::new(Inner {
            disk: AtomicU64::new(0),
            reserved: AtomicU64::new(0),
            is_kept_over: AtomicBool::new(false),
            short: Notify::new(),
            is_changed: AtomicBool::new(false),
        }));
        room.follow(policy);
        room
    }

    /// Another policy counts.
    pub fn follow(&self, policy: &Policy) {
        self.0.disk.store(policy.disk, Ordering::Relaxed);
        self.0.reserved.store(policy.reserved, Ordering::Relaxed);
        self.0.is_changed.store(true, Ordering::Relaxed);
    }

    /// Waits until room becomes short.
    pub async fn short(&self) {
        self.0.short.notified().await;
    }

    /// Room is short.
    pub(super) fn want(&self) {
        self.0.short.notify_one();
    }

    /// All that could be removed is removed.
    pub fn tidied(&self, is_kept_over: bool) {
        self.0.is_kept_over.store(is_kept_over, Ordering::Relaxed);
        self.0.is_changed.store(true, Ordering::Relaxed);
    }
}

/// The part of one file of the room.
#[derive(Debug)]
pub(super) struct Part {
    room: Room,
    /// Bytes of the other files.
    others: u64,
    looked: Option<Timestamp>,
}

impl Part {
    pub fn of(room: Room) -> Part {
        Part { room, others: 0, looked: None }
    }

    /// The length to which a file of this folder may grow that has `length` now.
    ///
    /// # Errors
    /// The disk does not say, or is full.
    pub fn most(&mut self, folder: &Path, length: u64, now: Timestamp) -> Result<u64, FileError> {
        let Inner { disk, reserved, is_kept_over, short, is_changed } = &*self.room.0;
        let is_due = self.looked.is_none_or(|looked| now.since(looked) >= LOOK_EVERY);
        if is_changed.swap(false, Ordering::Relaxed) || is_due {
            self.looked = Some(now);
            let all = folder_bytes(folder).map_err(|why| FileError::io(folder, "examined", why))?;
            self.others = all.saturating_sub(length);
        }
        let disk = disk.load(Ordering::Relaxed);
        let free = free_bytes(folder)?;
        let left = disk.saturating_sub(self.others);
        let on_disk = length.saturating_add(free.saturating_sub(FREE_MIN));
        let ahead = (disk / AHEAD_SHARE).min(AHEAD_MAX);
        let has_no_more = |most: u64| most.saturating_sub(length) < ahead;
        if has_no_more(left) || has_no_more(on_disk) {
            short.notify_one();
        }
        check_free(folder, free)?;
        // Each new recording may be kept in turn: all of them together stay within the room that is held back ahead.
        let beyond = disk.saturating_add(ahead).saturating_sub(self.others);
        let part = match is_kept_over.load(Ordering::Relaxed) {
            true => left.max(reserved.load(Ordering::Relaxed).min(beyond)),
            false => left,
        };
        Ok(part.min(disk / SHARE_OF_ONE).min(on_disk))
    }
}

/// # Errors
/// The disk is full, or does not say.
pub(super) fn check_room(folder: &Path) -> Result<(), FileError> {
    check_free(folder, free_bytes(folder)?)
}

fn check_free(folder: &Path, free: u64) -> Result<(), FileError> {
    if free >= FREE_MIN {
        return Ok(());
    }
    Err(FileError::format(folder, format!("the disk is full: {} KiB are free", free / 1024)))
}

pub(super) fn free_bytes(folder: &Path) -> Result<u64, FileError> {
    let system = rustix::fs::statvfs(folder);
    let system = system.map_err(|error| FileError::io(folder, "examined", error.into()))?;
    Ok(system.f_bavail.saturating_mul(system.f_frsize))
}

fn folder_bytes(folder: &Path) -> io::Result<u64> {
    let mut bytes = 0;
    for entry in std::fs::read_dir(folder)? {
        // One that was removed meanwhile takes nothing.
        bytes += entry?.metadata().map_or(0, |meta| meta.len());
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MB: u64 = 1_000_000;

    fn policy(disk: u64) -> Policy {
        Policy::new(disk, Span::from_secs(3600))
    }

    #[test]
    fn a_full_disk_counts_as_a_smaller_bound() {
        let disk = |taken, free| Disk { taken: taken * MB, free: free * MB };
        let bound = |taken, free| disk(taken, free).bound(&policy(3_200 * MB));
        assert_eq!((bound(0, 90_000).disk, bound(0, 90_000).reserved), (3_000 * MB, 120 * MB));
        assert!(bound(1_000, 100).disk < 1_100 * MB, "no more than the disk has");
        assert!(bound(1_000, 0).disk < 1_000 * MB - FREE_MIN, "something has to go");
        assert_eq!(bound(0, 0), Policy { disk: 0, reserved: 0, keep: policy(0).keep });
    }

    #[test]
    fn a_file_grows_within_its_part_and_says_when_room_is_short() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        std::fs::create_dir_all(folder).unwrap();
        std::fs::write(folder.join("incident-1.mcap"), vec![0; 60_000]).unwrap();
        let room = Room::new(&policy(100_000));
        let mut part = Part::of(room.clone());
        let is_short = || {
            let waits = std::pin::pin!(room.short());
            let mut context = std::task::Context::from_waker(std::task::Waker::noop());
            std::future::Future::poll(waits, &mut context).is_ready()
        };
        let at = |seconds: u64| Timestamp::from_millis(1000 * seconds);
        assert_eq!(part.most(folder, 0, at(0)).unwrap(), 40_000);
        assert!(!is_short());
        std::fs::write(folder.join("incident-2.mcap"), vec![0; 39_000]).unwrap();
        assert_eq!(part.most(folder, 39_000, at(10)).unwrap(), 40_000);
        assert!(is_short());
        std::fs::remove_file(folder.join("incident-1.mcap")).unwrap();
        room.tidied(false);
        assert_eq!(part.most(folder, 39_000, at(10)).unwrap(), 50_000, "half of all");
        // Kept recordings leave a tenth to the next one, but all together stay within the room that is held back ahead.
        std::fs::write(folder.join("incident-3.mcap"), vec![0; 55_000]).unwrap();
        room.tidied(true);
        assert_eq!(part.most(folder, 0, at(20)).unwrap(), 10_000);
        std::fs::write(folder.join("incident-4.mcap"), vec![0; 10_000]).unwrap();
        room.tidied(true);
        assert_eq!(part.most(folder, 0, at(30)).unwrap(), 2_250);
    }
}
