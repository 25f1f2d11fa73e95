//! When each fault began, noted from snapshots alone: what was well, in ERROR, relevant and shown, and since when.

use std::collections::HashMap;

use telltale::engine::model::{GroupId, ModuleId, NodeId};
use telltale::engine::snapshot::{Reason, Snapshot};
use telltale::engine::state::State;
use telltale::engine::time::{Span, Timestamp};

/// By the id of a module and its number: the id of one that left may be used again.
#[derive(Debug, Default)]
pub struct Times {
    modules: HashMap<(ModuleId, u64), Noted>,
    groups: HashMap<GroupId, Noted>,
}

/// What was seen of one node.
#[derive(Debug, Clone)]
pub struct Noted {
    made: Timestamp,
    state: State,
    since: Timestamp,
    /// Stretches of OK and WARNING that ended: from, until.
    well: Vec<(Timestamp, Timestamp)>,
    well_since: Option<Timestamp>,
    error: Option<Timestamp>,
    /// When it last became relevant, and its state then.
    relevant: Option<(Timestamp, State)>,
    shown_since: Option<Timestamp>,
    shown: Span,
}

fn is_well(state: State) -> bool {
    matches!(state, State::Ok | State::Warning)
}

impl Times {
    /// Notes own states and relevance, before it is judged what is shown.
    pub fn see(&mut self, snapshot: &Snapshot) {
        for id in snapshot.module_ids() {
            let (info, view) = snapshot.module(id);
            let noted = self.modules.entry((id, info.number)).or_insert_with(|| Noted::new(snapshot.now));
            noted.take(view.own, snapshot.now);
            noted.relate(is_relevant(snapshot, NodeId::Module(id)), snapshot.now);
        }
        for (id, view) in (0..).map(GroupId).zip(snapshot.groups.iter()) {
            let noted = self.groups.entry(id).or_insert_with(|| Noted::new(snapshot.now));
            noted.take(view.own, snapshot.now);
            noted.relate(is_relevant(snapshot, NodeId::Group(id)), snapshot.now);
        }
    }

    /// Notes what is shown, afterwards.
    pub fn see_shown(&mut self, snapshot: &Snapshot) {
        for id in snapshot.module_ids() {
            let (info, view) = snapshot.module(id);
            let Some(noted) = self.modules.get_mut(&(id, info.number)) else { continue };
            match (view.own, view.state) {
                (State::Error, State::Error) => {
                    noted.shown_since.get_or_insert(snapshot.now);
                }
                (State::Error, _) => {
                    noted.shown = noted.shown_longest(snapshot.now);
                    noted.shown_since = None;
                }
                _ => (noted.shown_since, noted.shown) = (None, Span::ZERO),
            }
        }
    }

    pub fn of(&self, snapshot: &Snapshot, id: ModuleId) -> &Noted {
        &self.modules[&(id, snapshot.module(id).0.number)]
    }

    /// When a group without members began to fail.
    pub fn of_group(&self, id: GroupId) -> Vec<Timestamp> {
        self.groups[&id].as_cause(true)
    }
}

fn is_relevant(snapshot: &Snapshot, node: NodeId) -> bool {
    !matches!(snapshot.shown(node).1, Some(Reason::NotRelevant(_)))
}

impl Noted {
    fn new(made: Timestamp) -> Noted {
        Noted {
            made,
            state: State::Unknown,
            since: made,
            well: Vec::new(),
            well_since: None,
            error: None,
            relevant: None,
            shown_since: None,
            shown: Span::ZERO,
        }
    }

    fn take(&mut self, state: State, now: Timestamp) {
        match (is_well(state), self.well_since) {
            (true, None) => self.well_since = Some(now),
            (false, Some(from)) => {
                self.well.push((from, now));
                self.well_since = None;
            }
            _ => {}
        }
        if state == State::Error && self.state != State::Error {
            self.error = Some(now);
        }
        (self.state, self.since) = (state, if state == self.state { self.since } else { now });
    }

    fn relate(&mut self, relevant: bool, now: Timestamp) {
        match (relevant, self.relevant) {
            (true, None) => self.relevant = Some((now, self.state)),
            (false, Some(_)) => self.relevant = None,
            _ => {}
        }
    }

    pub fn shown_longest(&self, now: Timestamp) -> Span {
        self.shown.max(self.shown_since.map_or(Span::ZERO, |since| now.since(since)))
    }

    /// Of a module in ERROR: when it became that, and when it was last well for longer than the limit.
    pub fn as_effect(&self, limit: Span) -> Vec<Timestamp> {
        let mut well = self.well.iter().rev();
        let last =
            well.find(|(from, until)| until.since(*from) > limit).map_or(self.made, |(_, until)| *until);
        self.error.into_iter().chain([last]).collect()
    }

    /// When it last became ERROR, when it was last well at all, and when it became relevant while failing.
    pub fn as_cause(&self, masks_unknown: bool) -> Vec<Timestamp> {
        let error = self.error.filter(|_| self.state == State::Error);
        let well = self.well.last().map(|(_, until)| *until);
        let stood = self.relevant.filter(|&(since, state)| {
            let failed = state == State::Error || masks_unknown && state == State::Unknown;
            failed && well.is_none_or(|until| until <= since)
        });
        error.into_iter().chain(well).chain(stood.map(|(since, _)| since)).collect()
    }
}
