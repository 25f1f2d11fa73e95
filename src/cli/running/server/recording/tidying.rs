//! Takes in recordings that the store does not know, and removes those that are too old or too many, or whose room is
//! needed for what is being recorded.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::runtime::Handle;
use tokio::sync::watch;
use tokio::task;

use crate::cli::running::server::left_over;
use crate::clock::Clock;
use crate::clock::unix_ms;
use crate::engine::time::{Span, Timestamp};
use crate::record::proof::is_changed;
use crate::record::recorder::Recorder;
use crate::record::retention::{Held, Policy, judged_ms, surplus_without_changed};
use crate::record::room::{Disk, Room};
use crate::record::summary::Summary;
use crate::record::{folder, found, note_file, removed};
use crate::store::audit::{Action, Record, TELLTALE};
use crate::store::{IncidentRecords, Store, StoreError};

/// Old and incomplete recordings are looked for this often.
const TIDY_EVERY: Span = Span::from_secs(600);

/// Further tries, of two seconds each, while another program has locked the database: it may be keeping a recording that
/// would go.
const TRIES_WHILE_LOCKED: usize = 4;

/// Incomplete recordings are looked for this soon after room was short, and so often: a full disk may have cut them off, and
/// still be full, or the recorder may still write them.
const WHOLE_AFTER: Span = Span::from_secs(10);
const WHOLE_TRIES: u32 = 6;

/// Where room is short, they are looked for again after this time.
const TIDY_AGAIN: Duration = Duration::from_millis(250);

/// What is to be looked after.
pub(super) struct Kept {
    pub store: Store,
    pub folder: PathBuf,
    pub recorder: Recorder,
    pub room: Room,
    pub clock: Clock,
}

/// Takes in the recordings of earlier runs that the store does not know, and removes those that are too old or
/// too many: every ten minutes, and whenever room is short.
pub(super) async fn look_after(
    mut policies: watch::Receiver<Policy>,
    kept: Kept,
    files: Vec<u64>,
    kept_too_much: watch::Sender<bool>,
) {
    let Kept { store, folder, recorder, room, clock } = &kept;
    left_over::take_in(store, folder, files).await;
    let mut told = BTreeSet::new();
    let (mut whole_at, mut tries) = (clock.now(), 0u32);
    loop {
        let policy = *policies.borrow_and_update();
        room.follow(&policy);
        match remove_surplus(store, folder, &policy, *clock, &mut told).await {
            Ok(over) => {
                room.tidied(over.is_kept_over);
                kept_too_much.send_replace(over.is_too_much);
            }
            Err(error) => tracing::error!(%error, "old recordings are not removed"),
        }
        if clock.now() >= whole_at {
            // After a fault of the disk. What is not interrupted is being written, or its row soon is.
            let is_left = |it: &Summary| !it.recording.interrupted || recorder.writes(it.id);
            left_over::make_whole(store, folder, &policy, is_left).await;
            whole_at = clock.now() + if tries > 0 { WHOLE_AFTER } else { TIDY_EVERY };
            tries = tries.saturating_sub(1);
        }
        tokio::time::sleep(TIDY_AGAIN).await;
        tokio::select! {
            changed = policies.changed() => match changed {
                Ok(()) => whole_at = clock.now(),
                Err(_) => return,
            },
            () = room.short() => {
                whole_at = whole_at.min(clock.now() + WHOLE_AFTER);
                tries = WHOLE_TRIES;
            }
            () = tokio::time::sleep_until(clock.instant(whole_at).into()) => {}
        }
    }
}

/// What remains beyond the policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Over {
    /// Kept recordings leave less to the others than is theirs.
    is_kept_over: bool,
    /// All together take more than they may, because they are kept.
    is_too_much: bool,
}

/// `told`: the changed recordings that the log has named.
async fn remove_surplus(
    store: &Store,
    folder: &Path,
    policy: &Policy,
    clock: Clock,
    told: &mut BTreeSet<u64>,
) -> anyhow::Result<Over> {
    record_removed(store, folder).await;
    let known = match (store.incidents_held().await, store.incident_records().await) {
        (Ok(held), Ok(records)) => Some((held, records)),
        (Err(error), _) | (_, Err(error)) => {
            tracing::error!(%error, "the database does not say which recordings are kept: their files do");
            None
        }
    };
    let is_known = known.is_some();
    let wall_ms = unix_ms(clock.wall());
    let now_ms = judged_ms(wall_ms, unix_ms(store.floor()), clock.now().since(Timestamp::ZERO));
    if now_ms < wall_ms && known.as_ref().is_some_and(|(held, _)| !held.is_empty()) {
        tracing::info!(
            "the clock is far ahead of the newest record: no recording is removed for its age by it"
        );
    }
    let (recordings, policy) = (folder.to_owned(), *policy);
    let (rows, runtime) = (store.clone(), Handle::current());
    // Only what would go is read.
    let judged = task::spawn_blocking(move || {
        let disk = Disk::of(&recordings)?;
        let (mut held, records) = match known {
            Some(known) => known,
            None => (held_by_files(&recordings)?, IncidentRecords::default()),
        };
        for it in &mut held {
            // The row of one that is being written does not know how long it is by now.
            it.bytes = folder::file_in(&recordings, &folder::file_name(it.id))
                .and_then(|path| path.metadata().ok())
                .map_or(0, |meta| meta.len());
        }
        let bytes = |of: &dyn Fn(&&Held) -> bool| held.iter().filter(of).map(|it| it.bytes).sum::<u64>();
        let (all, kept) = (bytes(&|_| true), bytes(&|it| it.kept));
        let mut bound = disk.bound(&policy);
        bound.disk = bound.disk.saturating_sub(disk.taken.saturating_sub(all));
        let stays = |it: &Held| match is_known {
            true => {
                let row = || runtime.block_on(rows.stored_incident(it.id)).ok().flatten();
                is_changed(&recordings, it, &records.hashes)
                    || row().is_none_or(|row| records.contradiction(&row).is_some())
            }
            false => is_marked(&recordings, it),
        };
        let (surplus, changed) = surplus_without_changed(&held, &bound, now_ms, stays);
        let left = disk.taken.saturating_sub(all - surplus.bytes.min(all));
        let over = Over {
            is_kept_over: kept > policy.disk.saturating_sub(policy.reserved),
            is_too_much: left > policy.disk || surplus.incidents_over > 0,
        };
        let is_needed = disk.bound(&policy).disk < disk.taken;
        anyhow::Ok((surplus.remove, changed, over, is_needed))
    });
    let (remove, changed, over, is_needed) = judged.await??;
    for id in changed.into_iter().filter(|id| is_known && told.insert(*id)) {
        tracing::warn!(
            "the recording of incident {id}, or what the database says of it, is not as it was recorded. It is evidence and stays, though it is too old \
             or too much: look at it with `telltale incident verify {id}`; `telltale incident prune --changed` \
             removes it"
        );
    }
    if remove.is_empty() {
        return Ok(over);
    }
    let record = Record::of(Action::IncidentRemoved, TELLTALE);
    let mut tries = TRIES_WHILE_LOCKED;
    let forgotten = loop {
        match store.forget_incidents(remove.clone(), record.clone()).await {
            Err(error) if error.is_locked() && tries > 0 => tries -= 1,
            done => break done,
        }
    };
    match forgotten {
        Ok(gone) => {
            for gone in gone {
                let path = folder.join(folder::file_name(gone.id));
                if let Err(error) = std::fs::remove_file(&path) {
                    tracing::warn!(%error, "the recording {} is not removed", path.display());
                }
                remove_beside(folder, gone.id);
            }
        }
        // A full disk takes no record before it has room. A recording that somebody has kept by now is judged again.
        Err(error) if is_needed && !matches!(error, StoreError::NoSuchIncident(_)) => {
            tracing::warn!(%error, "room is made before the removal of recordings is recorded");
            for id in remove {
                if let Err(error) = removed::free(folder, id) {
                    tracing::warn!(%error, "the recording of incident {id} is not removed");
                }
            }
            record_removed(store, folder).await;
        }
        Err(error) => return Err(error.into()),
    }
    Ok(over)
}

/// Records the removal of recordings whose room was needed before.
async fn record_removed(store: &Store, folder: &Path) {
    for id in removed::unrecorded(folder).unwrap_or_default() {
        let record = Record::of(Action::IncidentRemoved, TELLTALE);
        if let Err(error) = store.forget_incidents(vec![id], record).await {
            return tracing::warn!(%error, "the removal of incident {id} is not recorded yet");
        }
        if let Err(error) = removed::recorded(folder, id) {
            tracing::warn!(%error, "the empty file of incident {id} is not removed");
        }
        remove_beside(folder, id);
    }
}

fn remove_beside(folder: &Path, id: u64) {
    if let Err(error) = note_file::remove(folder, id) {
        tracing::warn!(%error, "the file beside incident {id} is not removed");
    }
}

/// What the files alone say, while the database says nothing.
fn held_by_files(folder: &Path) -> anyhow::Result<Vec<Held>> {
    let held = |id| Held {
        id,
        since_ms: i64::MAX,
        kept: note_file::read(folder, id).is_some_and(|it| it.kept == Some(true)),
        finished: true,
        ..Held::default()
    };
    Ok(folder::numbers(folder)?.into_iter().map(held).collect())
}

/// Whether a file alone says that somebody marked its incident, and nobody said since that it may go.
fn is_marked(recordings: &Path, it: &Held) -> bool {
    let said = note_file::read(recordings, it.id).and_then(|it| it.kept);
    let path = recordings.join(folder::file_name(it.id));
    said.unwrap_or_else(|| match found::summary(&path, it.id) {
        Ok(summary) => summary.is_none_or(|summary| summary.is_marked()),
        Err(_) => true,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::summary;
    use crate::record::writer::hash_file;
    use crate::store::DemoSecrets;

    #[tokio::test]
    async fn old_recordings_are_removed_but_not_those_that_were_changed() {
        let temporary = tempfile::tempdir().unwrap();
        let data = temporary.path();
        let (store, folder, clock) = recorded(data, &[1, 2, 3]).await;
        std::fs::write(folder.join(folder::file_name(1)), "forged!!").unwrap();
        // A sixteenth of it is kept free.
        let policy = Policy { disk: 18, reserved: 0, ..Policy::default() };
        let mut told = BTreeSet::new();
        for _ in 0..2 {
            remove_surplus(&store, &folder, &policy, clock, &mut told).await.unwrap();
            assert_eq!(folder::numbers(&folder).unwrap(), [1, 3]);
        }
        assert_eq!(told, BTreeSet::from([1]));
        // Nor is one whose row was changed, and no row names another file.
        let policy = Policy { disk: 0, reserved: 0, ..Policy::default() };
        let mut forged = store.incident(3).await.unwrap().unwrap().summary;
        forged.recording.file = folder::file_name(1);
        store.incident_updated(&forged).await.unwrap();
        remove_surplus(&store, &folder, &policy, clock, &mut told).await.unwrap();
        assert_eq!((folder::numbers(&folder).unwrap(), told), (vec![1, 3], BTreeSet::from([1, 3])));
    }

    /// A store with recordings of eight bytes.
    async fn recorded(data: &Path, ids: &[u64]) -> (Store, PathBuf, Clock) {
        let (folder, clock) = (folder::folder_in(data), Clock::start());
        std::fs::create_dir_all(&folder).unwrap();
        let store = Store::open(data, clock, DemoSecrets::Refused).unwrap();
        for &id in ids {
            let path = folder.join(folder::file_name(id));
            std::fs::write(&path, "recorded").unwrap();
            let recording = summary::Recording {
                file: folder::file_name(id),
                bytes: 8,
                finished: true,
                sha256: Some(hash_file(&path).unwrap()),
                ..summary::Recording::default()
            };
            let summary = Summary { id, since_ms: unix_ms(clock.wall()), recording, ..Summary::default() };
            store.incident_finished(&summary).await.unwrap();
        }
        (store, folder, clock)
    }

    #[tokio::test]
    async fn room_is_made_also_where_the_database_takes_nothing_and_recorded_when_it_does() {
        let temporary = tempfile::tempdir().unwrap();
        let data = temporary.path();
        let (store, folder, clock) = recorded(data, &[1, 2, 3]).await;
        let record = Record::of(Action::IncidentKept, TELLTALE);
        store.keep_incident(1, true, record).await.unwrap();
        let beside = rusqlite::Connection::open(data.join(crate::store::FILE_NAME)).unwrap();
        let refuse = "CREATE TRIGGER full BEFORE DELETE ON incidents BEGIN SELECT RAISE(ABORT, 'full'); END";
        beside.execute_batch(refuse).unwrap();
        let (policy, mut told) = (Policy { disk: 18, reserved: 0, ..Policy::default() }, BTreeSet::new());
        remove_surplus(&store, &folder, &policy, clock, &mut told).await.unwrap();
        assert_eq!(folder::numbers(&folder).unwrap(), [1, 3], "the oldest that nobody keeps");
        assert_eq!(Disk::of(&folder).unwrap().taken, 16);
        assert!(removed::is_unrecorded(&folder, 2) && store.incident(2).await.unwrap().is_some());
        beside.execute_batch("DROP TRIGGER full").unwrap();
        remove_surplus(&store, &folder, &policy, clock, &mut told).await.unwrap();
        assert!(!removed::is_unrecorded(&folder, 2) && store.incident(2).await.unwrap().is_none());
        assert_eq!(store.incident_records().await.unwrap().removed, [2]);
    }

    #[tokio::test]
    async fn a_recording_that_is_written_makes_older_ones_go_and_files_alone_say_what_is_kept() {
        let temporary = tempfile::tempdir().unwrap();
        let data = temporary.path();
        let (store, folder, clock) = recorded(data, &[1, 2]).await;
        // No row knows how long it is by now.
        std::fs::write(folder.join(folder::file_name(3)), [0; 20]).unwrap();
        let (policy, mut told) = (Policy { disk: 32, reserved: 0, ..Policy::default() }, BTreeSet::new());
        let over = remove_surplus(&store, &folder, &policy, clock, &mut told).await.unwrap();
        assert_eq!(folder::numbers(&folder).unwrap(), [2, 3]);
        assert_eq!(over, Over { is_kept_over: false, is_too_much: false });
        let kept = note_file::Beside { note: None, kept: Some(true) };
        note_file::write(&folder, 2, &kept).unwrap();
        let held = held_by_files(&folder).unwrap();
        assert_eq!(held.iter().map(|it| (it.id, it.kept)).collect::<Vec<_>>(), [(2, true), (3, false)]);
        assert!(is_marked(&folder, &held[1]), "a file that says nothing stays");
    }
}
