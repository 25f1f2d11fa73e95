//! When each fault began, noted from snapshots alone: what was well, in ERROR, relevant and shown, and since when.

use std::collections::HashMap;

use telltale::engine::model::lateness::Notice;
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
    /// Stretches of OK and WARNING that ended: from, until, and how the fault that followed was noticed.
    well: Vec<(Timestamp, Timestamp, Notice)>,
    well_since: Option<Timestamp>,
    error: Option<(Timestamp, Notice)>,
    /// When it last became relevant, and its state then.
    relevant: Option<(Timestamp, State)>,
    shown_since: Option<Timestamp>,
    shown: Span,
}

/// The notice of a fault, and its estimated beginning.
pub type Begun = (Timestamp, Option<Timestamp>);

fn is_well(state: State) -> bool {
    matches!(state, State::Ok | State::Warning)
}

impl Times {
    /// Notes own states and relevance, before it is judged what is shown.
    pub fn see(&mut self, snapshot: &Snapshot) {
        for id in snapshot.module_ids() {
            let (info, view) = snapshot.module(id);
            let noted = self.modules.entry((id, info.number)).or_insert_with(|| Noted::new(snapshot.now));
            noted.take(Notice { state: view.own, silent: view.silent }, snapshot.now);
            noted.relate(is_relevant(snapshot, NodeId::Module(id)), snapshot.now);
        }
        for (id, view) in (0..).map(GroupId).zip(snapshot.groups.iter()) {
            let noted = self.groups.entry(id).or_insert_with(|| Noted::new(snapshot.now));
            noted.take(Notice { state: view.own, silent: false }, snapshot.now);
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
    pub fn of_group(&self, id: GroupId) -> Vec<Begun> {
        self.groups[&id].as_cause(true, &|_| Some(Span::ZERO))
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

    fn take(&mut self, notice: Notice, now: Timestamp) {
        let state = notice.state;
        match (is_well(state), self.well_since) {
            (true, None) => self.well_since = Some(now),
            (false, Some(from)) => {
                self.well.push((from, now, notice));
                self.well_since = None;
            }
            _ => {}
        }
        if state == State::Error && self.state != State::Error {
            self.error = Some((now, notice));
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

    /// Of a module in ERROR: when it became that, and when it was last well for longer than the limit. `late` says how
    /// long before its notice a fault began.
    pub fn as_effect(&self, limit: Span, late: &dyn Fn(Notice) -> Option<Span>) -> Vec<Begun> {
        let mut well = self.well.iter().rev();
        let last = match well.find(|(from, until, _)| until.since(*from) > limit) {
            Some(&(_, until, state)) => self.begun(until, late(state)),
            None => (self.made, Some(self.made)),
        };
        let error = self.error.map(|(at, notice)| self.begun(at, late(notice)));
        error.into_iter().chain([last]).collect()
    }

    /// When it last became ERROR, when it was last well at all, and when it became relevant while failing.
    pub fn as_cause(&self, masks_unknown: bool, late: &dyn Fn(Notice) -> Option<Span>) -> Vec<Begun> {
        let error = self.error.filter(|_| self.state == State::Error);
        let well = self.well.last();
        let stood = self.relevant.filter(|&(since, state)| {
            let failed = state == State::Error || masks_unknown && state == State::Unknown;
            failed && well.is_none_or(|(_, until, _)| *until <= since)
        });
        let error = error.map(|(at, notice)| self.begun(at, late(notice)));
        let well = well.map(|&(_, until, state)| self.begun(until, late(state)));
        let stood = stood.map(|(since, _)| (since, Some(since)));
        error.into_iter().chain(well).chain(stood).collect()
    }

    /// Not before it was made, was well, or became relevant.
    fn begun(&self, noticed: Timestamp, late: Option<Span>) -> Begun {
        let mut earliest = self.made;
        for (from, ..) in self.well.iter().filter(|(_, until, _)| *until <= noticed) {
            earliest = earliest.max(*from);
        }
        if let Some((since, _)) = self.relevant.filter(|(since, _)| *since <= noticed) {
            earliest = earliest.max(since);
        }
        (noticed, late.map(|late| (noticed - late).max(earliest)))
    }
}
