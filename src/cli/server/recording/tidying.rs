//! Takes in recordings that the store does not know, and removes those that are too old or too many.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::runtime::Handle;
use tokio::sync::watch;
use tokio::task;

use crate::cli::server::left_over;
use crate::clock::Clock;
use crate::engine::time::Timestamp;
use crate::record::proof::is_changed;
use crate::record::recorder::Recorder;
use crate::record::retention::{Policy, judged_ms, surplus_without_changed};
use crate::record::summary::Summary;
use crate::record::writer::unix_ms;
use crate::record::{beside, folder};
use crate::store::Store;
use crate::store::audit::{Action, Record, TELLTALE};

/// Old recordings are looked for this often.
const TIDY_EVERY: Duration = Duration::from_secs(600);

/// Takes in the recordings of earlier runs that the store does not know, and removes those that are too old or
/// too many.
pub(super) async fn look_after(
    mut policies: watch::Receiver<Policy>,
    store: Store,
    folder: PathBuf,
    files: Vec<u64>,
    recorder: Recorder,
    kept_too_much: watch::Sender<bool>,
    clock: Clock,
) {
    left_over::take_in(&store, &folder, files).await;
    let mut told = BTreeSet::new();
    loop {
        let policy = *policies.borrow_and_update();
        // After a fault of the disk. What is not interrupted is being written, or its row soon is.
        let is_left = |it: &Summary| !it.recording.interrupted || recorder.writes(it.id);
        left_over::make_whole(&store, &folder, is_left).await;
        match remove_surplus(&store, &folder, &policy, clock, &mut told).await {
            Ok(is_over) => drop(kept_too_much.send_replace(is_over)),
            Err(error) => tracing::error!(%error, "old recordings are not removed"),
        }
        tokio::select! {
            changed = policies.changed() => if changed.is_err() { return },
            () = tokio::time::sleep(TIDY_EVERY) => {}
        }
    }
}

/// `told`: the changed recordings that the log has named. Returns whether kept recordings are more than the policy
/// permits.
async fn remove_surplus(
    store: &Store,
    folder: &Path,
    policy: &Policy,
    clock: Clock,
    told: &mut BTreeSet<u64>,
) -> anyhow::Result<bool> {
    let held = store.incidents_held().await?;
    let wall_ms = unix_ms(clock.wall());
    let now_ms = judged_ms(wall_ms, unix_ms(store.floor()), clock.now().since(Timestamp::ZERO));
    if now_ms < wall_ms && !held.is_empty() {
        tracing::info!(
            "the clock is far ahead of the newest record: no recording is removed for its age by it"
        );
    }
    let records = store.incident_records().await?;
    let (recordings, policy) = (folder.to_owned(), *policy);
    let (rows, runtime) = (store.clone(), Handle::current());
    // Only what would go is read.
    let (surplus, changed) = task::spawn_blocking(move || {
        let is_forged = |id| {
            let row = runtime.block_on(rows.stored_incident(id)).ok().flatten();
            row.is_none_or(|row| records.contradiction(&row).is_some())
        };
        surplus_without_changed(&held, &policy, now_ms, |it| {
            is_changed(&recordings, it, &records.hashes) || is_forged(it.id)
        })
    })
    .await?;
    for id in changed.into_iter().filter(|id| told.insert(*id)) {
        tracing::warn!(
            "the recording of incident {id}, or what the database says of it, is not as it was recorded. It is evidence and stays, though it is too old \
             or too much: look at it with `telltale incident verify {id}`; `telltale incident prune --changed` \
             removes it"
        );
    }
    let is_over = surplus.is_over();
    if surplus.remove.is_empty() {
        return Ok(is_over);
    }
    let record = Record::of(Action::IncidentRemoved, TELLTALE);
    for gone in store.forget_incidents(surplus.remove, record).await? {
        let path = folder.join(folder::file_name(gone.id));
        if let Err(error) = std::fs::remove_file(&path) {
            tracing::warn!(%error, "the recording {} is not removed", path.display());
        }
        if let Err(error) = beside::remove(folder, gone.id) {
            tracing::warn!(%error, "the file beside incident {} is not removed", gone.id);
        }
    }
    Ok(is_over)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::summary;
    use crate::record::writer::hash_file;
    use crate::store::{DemoSecrets, TestFolder};

    #[tokio::test]
    async fn old_recordings_are_removed_but_not_those_that_were_changed() {
        let data = TestFolder::new("recording-changed");
        let folder = folder::folder_in(&data);
        std::fs::create_dir_all(&folder).unwrap();
        let clock = Clock::start();
        let store = Store::open(&data, clock, DemoSecrets::Refused).unwrap();
        for id in [1, 2, 3] {
            let path = folder.join(folder::file_name(id));
            std::fs::write(&path, "recorded").unwrap();
            let recording = summary::Recording {
                file: folder::file_name(id),
                bytes: 8,
                finished: true,
                sha256: Some(hash_file(&path).unwrap()),
                ..summary::Recording::default()
            };
            let since_ms = unix_ms(clock.wall());
            let summary = Summary { id, since_ms, recording, ..Summary::default() };
            store.incident_finished(&summary).await.unwrap();
        }
        std::fs::write(folder.join(folder::file_name(1)), "forged!!").unwrap();
        let policy = Policy { disk: 16, reserved: 0, ..Policy::default() };
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
}
