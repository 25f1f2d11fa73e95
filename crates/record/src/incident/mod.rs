//! When an incident begins, how long it lasts, and why: decided from snapshots alone.

use std::sync::Arc;

use super::noticed::Noticed;
use telltale_engine::model::countermeasure::RequestKind;
use telltale_engine::model::{NodeId, Stage};
use telltale_engine::snapshot::{Moving, Reason, Snapshot};
use telltale_engine::state::State;
use telltale_engine::time::{Span, Timestamp};

/// An incident is closed after this time even if further triggers follow. A storm of them opens the next one
/// only then.
pub const LENGTH_MAX: Span = Span::from_secs(60);

/// Telltale's own statuses open an incident at most this often, and only where nothing else fails: a recorder that
/// is short of room must not fill what it has with recordings of that.
const OWN_EVERY: Span = Span::from_secs(3600);

/// An arrival: the end of autonomous driving at walking pace, if the vehicle is known to stand so soon. That is known
/// only after it has been slow for a moment.
const ARRIVES_WITHIN: Span = Span::from_millis(700);

/// Triggers of one incident that are kept; more are counted.
pub(super) const TRIGGERS_MAX: usize = 256;

/// Marks of one incident, and those of one user among them: a program leaves room for the operator. More only make it
/// last longer, so that they take no place of what failed, and the notes are kept whole.
pub const MARKS_MAX: usize = 24;
pub const MARKS_OF_ONE_MAX: usize = 8;

/// Errors behind other faults that are kept of one incident: one fault may explain hundreds. More are counted.
const OWN_ERRORS_MAX: usize = 64;

/// Bytes of a note.
pub const NOTE_BYTES_MAX: usize = 2000;

/// A reason that begins an incident or makes it last longer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Trigger {
    /// A root cause raised an alarm, or a module shows a WARNING, which raises none.
    Root { alarm: Option<u64>, node: Arc<str> },
    /// A module that matters is in ERROR itself, behind a fault that explains it: no alarm tells of it.
    OwnError { node: Arc<str> },
    /// Autonomous driving ended although the vehicle was not known to stand.
    LostActive { stage: Stage },
    /// A request to the vehicle became stronger.
    Countermeasure { kind: RequestKind },
    /// Somebody marked this moment.
    Mark { by: Box<str>, note: Box<str> },
}

/// Times before the first and after the last trigger that belong to an incident.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Margins {
    pub before: Span,
    pub after: Span,
}

impl Default for Margins {
    fn default() -> Margins {
        Margins { before: Span::from_secs(30), after: Span::from_secs(10) }
    }
}

/// An incident that is not over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Open {
    /// The time of its first trigger.
    pub since: Timestamp,
    /// It ends then unless another trigger follows.
    pub until: Timestamp,
    pub triggers: Vec<(Timestamp, Trigger)>,
    /// Triggers that are only counted.
    pub more: u64,
    /// It follows an incident that reached its greatest length.
    pub storm: bool,
}

impl Open {
    /// All triggers.
    pub fn count(&self) -> u64 {
        self.triggers.len() as u64 + self.more
    }

    /// Whether a trigger of this kind has a place.
    fn has_place_for(&self, trigger: &Trigger) -> bool {
        // Marks keep their places.
        let of_others = TRIGGERS_MAX - MARKS_MAX.saturating_sub(self.marks());
        match trigger {
            Trigger::Mark { .. } => self.triggers.len() < TRIGGERS_MAX,
            Trigger::OwnError { .. } => {
                let is_same = |(_, it): &&(Timestamp, Trigger)| matches!(it, Trigger::OwnError { .. });
                self.triggers.len() < of_others
                    && self.triggers.iter().filter(is_same).count() < OWN_ERRORS_MAX
            }
            _ => self.triggers.len() < of_others,
        }
    }

    /// The oldest marks of these users make room for another one; they are counted.
    fn drop_marks(&mut self, marks_max: usize, mut is_of: impl FnMut(&str) -> bool) {
        let mut is_one =
            |(_, trigger): &(Timestamp, Trigger)| matches!(trigger, Trigger::Mark { by, .. } if is_of(by));
        let surplus = (self.triggers.iter().filter(|it| is_one(it)).count() + 1).saturating_sub(marks_max);
        let mut left = surplus;
        self.triggers.retain(|it| {
            let goes = left > 0 && is_one(it);
            left -= usize::from(goes);
            !goes
        });
        self.more += surplus as u64;
    }

    fn marks(&self) -> usize {
        self.markers().count()
    }

    fn marks_of(&self, user: &str) -> usize {
        self.markers().filter(|by| *by == user).count()
    }

    fn markers(&self) -> impl Iterator<Item = &str> {
        self.triggers.iter().filter_map(|(_, trigger)| match trigger {
            Trigger::Mark { by, .. } => Some(&**by),
            _ => None,
        })
    }
}

/// A change of the present incident.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Change {
    Opened(Open),
    Extended(Open),
    Closed(Open),
}

/// Follows the snapshots of one engine.
#[derive(Debug)]
pub struct Tracker {
    margins: Margins,
    /// The last alarm that was seen.
    last_alarm: u64,
    stage: Stage,
    requests: Vec<RequestKind>,
    /// When autonomous driving ended at walking pace, while it may still be an arrival.
    slow_end: Option<(Timestamp, Stage)>,
    open: Option<Open>,
    /// The present incident was to last longer than it may.
    is_cut: bool,
    /// The last incident reached its greatest length at this time.
    cut_at: Option<Timestamp>,
    /// When a status of Telltale itself opened one last.
    own_at: Option<Timestamp>,
}

impl Tracker {
    /// Everything in this snapshot was there before, and is no trigger.
    pub fn new(margins: Margins, first: &Snapshot) -> Tracker {
        Tracker {
            margins,
            last_alarm: first.last_alarm,
            stage: first.stage,
            requests: requests(first),
            slow_end: None,
            open: None,
            is_cut: false,
            cut_at: None,
            own_at: None,
        }
    }

    pub fn set_margins(&mut self, margins: Margins) {
        self.margins = margins;
    }

    /// Takes the next snapshot, and what was [noticed](super::noticed::Watch) since the one before.
    pub fn follow(&mut self, snapshot: &Snapshot, noticed: &[Noticed]) -> Vec<Change> {
        let mut triggers = Vec::new();
        let raised = snapshot.alarms.iter().filter(|alarm| alarm.id > self.last_alarm);
        triggers.extend(raised.map(|alarm| {
            let node = snapshot.node_name(alarm.node).clone();
            Trigger::Root { alarm: Some(alarm.id), node }
        }));
        let has_alarm = |node: &str, triggers: &[Trigger]| {
            triggers.iter().any(|it| matches!(it, Trigger::Root { node: of, .. } if **of == *node))
        };
        for it in noticed {
            match it {
                Noticed::Warning(node) => triggers.push(Trigger::Root { alarm: None, node: node.clone() }),
                // One that nothing explains has raised its alarm.
                Noticed::OwnError(node) if has_alarm(node, &triggers) => {}
                Noticed::OwnError(node) => triggers.push(Trigger::OwnError { node: node.clone() }),
            }
        }
        let (own, mut triggers) = triggers.into_iter().partition::<Vec<_>, _>(|it| is_own(it, snapshot));
        self.last_alarm = self.last_alarm.max(snapshot.last_alarm);
        let has_ended = self.stage == Stage::Active && snapshot.stage != Stage::Active;
        match (snapshot.motion.moving, snapshot.motion.speed_kmh) {
            (Moving::No, _) => self.slow_end = None,
            (Moving::Yes, Some(..=1)) if has_ended => self.slow_end = Some((snapshot.now, snapshot.stage)),
            _ if has_ended => triggers.push(Trigger::LostActive { stage: snapshot.stage }),
            _ => {}
        }
        self.stage = snapshot.stage;
        let requests = requests(snapshot);
        let new = requests.iter().filter(|kind| !self.requests.contains(kind));
        triggers.extend(new.map(|&kind| Trigger::Countermeasure { kind }));
        self.requests = requests;
        let mut changes = self.due(snapshot.now);
        if let Some(only) = own.into_iter().next()
            && triggers.is_empty()
            && self.open.is_none()
            && self.own_at.is_none_or(|at| snapshot.now.since(at) >= OWN_EVERY)
            && !others_fail(snapshot)
        {
            self.own_at = Some(snapshot.now);
            triggers.push(only);
        }
        for trigger in triggers {
            changes.extend(self.trigger(snapshot.now, trigger));
        }
        changes
    }

    /// Begins an incident, or makes the present one last longer.
    pub fn trigger(&mut self, now: Timestamp, trigger: Trigger) -> Vec<Change> {
        let mut changes = self.close(now);
        let until = now + self.margins.after;
        match &mut self.open {
            Some(open) => {
                self.is_cut |= extend(open, until, self.margins);
                if open.has_place_for(&trigger) {
                    open.triggers.push((now, trigger));
                } else {
                    open.more += 1;
                }
                changes.push(Change::Extended(open.clone()));
            }
            None => {
                let storm = self.cut_at.is_some_and(|cut| now.since(cut) <= LENGTH_MAX);
                let open = Open { since: now, until, triggers: vec![(now, trigger)], more: 0, storm };
                self.open = Some(open.clone());
                self.is_cut = false;
                changes.push(Change::Opened(open));
            }
        }
        changes
    }

    /// Marks this moment. Returns whether the mark has a place among those of the present incident, which lasts longer in
    /// any case. While the disk takes no recording of it (`is_recorded`), the marks take half of their places at most, and
    /// the newest ones stay: a user who tapped in vain has places left when the disk is back.
    pub fn mark(&mut self, now: Timestamp, by: &str, note: &str, is_recorded: bool) -> (Vec<Change>, bool) {
        let mut changes = self.due(now);
        let until = now + self.margins.after;
        if let Some(open) = self.open.as_mut().filter(|_| !is_recorded) {
            open.drop_marks(MARKS_OF_ONE_MAX / 2, |of| of == by);
            open.drop_marks(MARKS_MAX / 2, |_| true);
        }
        if let Some(open) = &mut self.open
            && (open.marks() >= MARKS_MAX || open.marks_of(by) >= MARKS_OF_ONE_MAX)
        {
            self.is_cut |= extend(open, until, self.margins);
            changes.push(Change::Extended(open.clone()));
            return (changes, false);
        }
        changes.extend(self.trigger(now, Trigger::Mark { by: by.into(), note: note.into() }));
        (changes, true)
    }

    /// A change by time alone.
    pub fn due(&mut self, now: Timestamp) -> Vec<Change> {
        match self.slow_end.take_if(|(at, _)| now >= *at + ARRIVES_WITHIN) {
            Some((_, stage)) => self.trigger(now, Trigger::LostActive { stage }),
            None => self.close(now),
        }
    }

    /// Closes the present incident when its time is over.
    fn close(&mut self, now: Timestamp) -> Vec<Change> {
        let Some(open) = self.open.take_if(|open| now >= open.until) else { return Vec::new() };
        self.cut_at = self.is_cut.then_some(open.until);
        vec![Change::Closed(open)]
    }

    /// The present incident.
    pub fn open(&self) -> Option<&Open> {
        self.open.as_ref()
    }

    /// Ends the present incident early.
    pub fn end(&mut self) -> Option<Open> {
        self.open.take()
    }
}

/// An incident lasts until then, but no longer than it may. Returns whether that cut it.
fn extend(open: &mut Open, until: Timestamp, margins: Margins) -> bool {
    let last = open.since + LENGTH_MAX.max(margins.after);
    open.until = open.until.max(until).min(last);
    until > last
}

/// Whether it is about a status of Telltale itself.
fn is_own(trigger: &Trigger, snapshot: &Snapshot) -> bool {
    let (Trigger::Root { node, .. } | Trigger::OwnError { node }) = trigger else { return false };
    let own = snapshot.layout.groups.iter().rfind(|group| group.is_system);
    own.and_then(|own| node.strip_prefix(&*own.path))
        .is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}

/// Whether something of the vehicle fails. An UNKNOWN does not count: it may be what a fault of Telltale makes of it.
fn others_fail(snapshot: &Snapshot) -> bool {
    snapshot.module_ids().any(|id| {
        let (module, view) = snapshot.module(id);
        let (group, _) = snapshot.group(module.group);
        let matters = !matches!(view.reason, Some(Reason::NotRelevant(_)));
        matters && group.counted && !group.is_system && matches!(view.own, State::Warning | State::Error)
    })
}

/// The requests to the vehicle beyond a notice.
fn requests(snapshot: &Snapshot) -> Vec<RequestKind> {
    let kinds = snapshot.countermeasures.iter().map(|it| it.request.kind());
    kinds.filter(|&kind| kind != RequestKind::Notify).collect()
}

/// The names of the nodes that explain what the alarms of an incident were about, as known at this snapshot.
pub fn roots(snapshot: &Snapshot, since: Timestamp) -> Vec<Arc<str>> {
    let alarms = snapshot.alarms.iter().filter(|alarm| alarm.raised >= since || alarm.active);
    let mut nodes: Vec<NodeId> = alarms.map(|alarm| alarm.node).collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes.into_iter().map(|node| snapshot.node_name(node).clone()).collect()
}

#[cfg(test)]
mod tests;
