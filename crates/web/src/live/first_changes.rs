//! Finds the changes of a state that every page shows at once, even where many changes came just before.

use tokio::sync::watch;

use crate::AppState;
use telltale_engine::model::{GroupId, Stage};
use telltale_engine::state::State;
use telltale_engine::time::{Span, Timestamp};
use telltale_runtime::{Published, Version};

/// A change of a state is the first one if none came before it for this long.
const CALM: Span = Span::from_millis(30);
/// A change of one tile is the first one if that tile showed its state for this long.
const TILE_CALM: Span = Span::from_secs(1);

/// The number of first changes so far.
#[derive(Debug)]
pub struct FirstChanges(watch::Sender<u64>);

impl Default for FirstChanges {
    fn default() -> FirstChanges {
        FirstChanges(watch::channel(0).0)
    }
}

impl FirstChanges {
    pub fn subscribe(&self) -> watch::Receiver<u64> {
        self.0.subscribe()
    }
}

/// Runs for as long as the server does: once for all pages.
pub async fn watch(app: AppState) {
    let mut snapshots = app.afterwards().clone();
    let mut shown = Shown::default();
    while snapshots.changed().await.is_ok() {
        let published = snapshots.borrow_and_update().clone();
        if shown.is_first_change(&published, app.clock.now()) {
            app.first_changes.0.send_modify(|count| *count += 1);
        }
    }
}

/// The states that pages show, and since when.
#[derive(Debug, Default)]
struct Shown {
    seq: Version,
    changed: Timestamp,
    stage: Option<Stage>,
    tiles: Vec<(GroupId, State, Timestamp)>,
}

impl Shown {
    /// Words without a change of a state are none. A flood of changes has one first change, and one more for
    /// each tile that was calm: at most one a second for each.
    fn is_first_change(&mut self, published: &Published, now: Timestamp) -> bool {
        if published.seq() == self.seq {
            return false;
        }
        let snapshot = &published.snapshot;
        let mut is_first = now.since(self.changed) >= CALM || self.stage != Some(snapshot.stage);
        (self.seq, self.changed, self.stage) = (published.seq(), now, Some(snapshot.stage));
        let before = std::mem::take(&mut self.tiles);
        for (index, id) in snapshot.tiles().enumerate() {
            let state = snapshot.group(id).1.state;
            let tile = match before.get(index) {
                Some(&(of, shown, since)) if of == id && shown == state => (id, state, since),
                Some(&(of, _, since)) if of == id => {
                    is_first |= now.since(since) >= TILE_CALM;
                    (id, state, now)
                }
                _ => (id, state, now),
            };
            self.tiles.push(tile);
        }
        is_first
    }
}

#[cfg(test)]
mod tests {
    use std::time::SystemTime;

    use super::*;
    use crate::view::tests::sample::Sample;

    /// Whether each is a first change: milliseconds since the one before, a status and its level.
    fn first_changes(changes: &[(u64, &str, u8)]) -> Vec<bool> {
        let (mut vehicle, mut shown, mut now_ms) = (Sample::shuttle(true), Shown::default(), 10_000);
        let mut judge = |vehicle: &mut Sample, now_ms| {
            let published = Published::recorded(vehicle.snapshot(), SystemTime::UNIX_EPOCH);
            shown.is_first_change(&published, Timestamp::from_millis(now_ms))
        };
        assert!(judge(&mut vehicle, now_ms));
        let mut found = Vec::new();
        for &(later_ms, status, level) in changes {
            now_ms += later_ms;
            vehicle = vehicle.report(status, level, &format!("at {now_ms}"), &[]).pass(1);
            found.push(judge(&mut vehicle, now_ms));
        }
        found
    }

    #[test]
    fn the_first_change_of_a_state_is_found_in_a_flood_and_words_are_none() {
        let (camera, battery) = ("sensors/camera_front", "can/battery");
        // Twenty changes a second have a calm before each.
        let calm: Vec<_> = (1..41).map(|number| (50, camera, number % 2)).collect();
        assert_eq!(first_changes(&calm), [true; 40]);
        // A hundred have not.
        let flood: Vec<_> = (0..200).map(|number| (10, camera, number % 2)).collect();
        let found = first_changes(&flood);
        assert!(found.iter().filter(|it| **it).count() <= 2, "{found:?}");
        // Another tile is calm until then.
        let other = [flood, vec![(10, battery, 1), (10, battery, 0), (10, battery, 1)]].concat();
        assert_eq!(first_changes(&other)[200..], [true, false, false]);
        assert_eq!(first_changes(&[(2000, camera, 0), (2000, camera, 0)]), [false; 2]);
    }
}
