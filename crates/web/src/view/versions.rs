//! Decides whether a tap is too old, because its subject has changed since the page showed it.
//!
//! `seq` grows with every change of the vehicle's state, up to a thousand times a second. A tap that was
//! refused for any of them would never be in time, so each action depends on the `seq` of the last change
//! of its own subject.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::{Arc, Mutex, PoisonError};

use telltale_engine::model::{GroupId, NodeId};
use telltale_engine::snapshot::{Alarm, Snapshot};
use telltale_runtime::{Published, Version};

/// A part of the state on which an operator's decision depends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Aspect {
    /// The stage, the operator, the given position, and whether a stop is requested.
    Stage,
    /// Everything that a clearance depends on.
    Clearance,
    /// All that is judged before a release.
    Release,
    /// One alarm, by its number: which fault it is of, and whether it is there still.
    Alarm(u64),
    /// The state of a top-level group.
    Component(GroupId),
    /// No part: the action itself says what it may be about.
    Nothing,
}

/// The aspects of the newest snapshot that a page was shown.
#[derive(Debug, Default)]
pub struct Versions(Mutex<Latest>);

#[derive(Debug, Default)]
struct Latest {
    seq: Version,
    since: Arc<HashMap<Aspect, u64>>,
    digests: HashMap<Aspect, u64>,
}

/// The `seq` since which each aspect is as one snapshot shows it.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    seq: u64,
    since: Arc<HashMap<Aspect, u64>>,
}

impl Seen {
    pub fn seq(&self) -> u64 {
        self.seq
    }

    /// The version by which a command about this aspect is given.
    pub fn of(&self, aspect: Aspect) -> u64 {
        // For an aspect that is gone, only the present version holds.
        self.since.get(&aspect).map_or(self.seq, |&since| since.min(self.seq))
    }

    /// Whether a command that was shown with `version` was shown with this aspect as it is.
    pub fn holds(&self, aspect: Aspect, version: u64) -> bool {
        aspect == Aspect::Nothing || (self.of(aspect)..=self.seq).contains(&version)
    }
}

impl Versions {
    /// Takes each snapshot before a page shows it.
    pub fn observe(&self, published: &Published) -> Seen {
        let (seq, snapshot) = (published.seq(), &published.snapshot);
        let mut latest = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if seq.rewinds > latest.seq.rewinds {
            *latest = Latest::default();
        }
        if seq > latest.seq || latest.digests.is_empty() {
            let digests = digests(snapshot);
            let since = digests.iter().map(|(aspect, digest)| {
                let same = latest.digests.get(aspect) == Some(digest);
                let since = latest.since.get(aspect).copied().filter(|_| same);
                (*aspect, since.unwrap_or(snapshot.seq))
            });
            let since = Arc::new(since.collect());
            *latest = Latest { seq, since, digests };
        }
        // An older snapshot has no version that is newer than itself, or after a later rewind.
        let since = if seq.rewinds == latest.seq.rewinds { latest.since.clone() } else { Arc::default() };
        Seen { seq: snapshot.seq, since }
    }
}

fn digests(snapshot: &Snapshot) -> HashMap<Aspect, u64> {
    let mut digests = HashMap::new();
    let (stage, operator) = (snapshot.stage, &snapshot.operator);
    let steps = (stage, operator, snapshot.localization.number, snapshot.stop_requested());
    digests.insert(Aspect::Stage, digest(&steps));
    for alarm in snapshot.alarms.iter() {
        digests.insert(Aspect::Alarm(alarm.id), digest(&of_alarm(alarm)));
    }
    let mut tiles = Vec::new();
    for id in snapshot.tiles() {
        let (_, view) = snapshot.group(id);
        let shown = (view.state, view.own, view.since);
        digests.insert(Aspect::Component(id), digest(&shown));
        tiles.push((view.state, view.own));
    }
    let roots: Vec<NodeId> = snapshot.roots.iter().map(|root| root.node).collect();
    let alarms: Vec<_> = snapshot.alarms.iter().map(of_alarm).collect();
    // Refusals and countermeasures contain numbers with a fraction, which have no hash.
    let words = format!("{:?} {:?}", snapshot.clearance_refusals, snapshot.countermeasures);
    let stop = snapshot.last_stop;
    let judged = (steps, stop, tiles, roots, alarms, &snapshot.accepted, words);
    digests.insert(Aspect::Clearance, digest(&judged));
    let words = format!("{:?} {:?}", snapshot.release_refusals, snapshot.countermeasures);
    digests.insert(Aspect::Release, digest(&(steps, stop, words)));
    digests
}

fn of_alarm(alarm: &Alarm) -> (u64, NodeId, bool, bool) {
    (alarm.id, alarm.node, alarm.acknowledged, alarm.active)
}

fn digest(value: &impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    value.hash(&mut hasher);
    hasher.finish()
}
