//! Discovered modules in snapshots.

use std::sync::Arc;

use super::Views;
use crate::discovery::WriterId;
use crate::mask::net::Net;
use crate::model::{GroupId, ModuleId, NodeNames};
use crate::snapshot::Steps;
use crate::snapshot::{ModuleInfo, ModuleView};
use crate::state::State;
use crate::text::Text;
use crate::time::Timestamp;
use crate::view::layout::self_reporting;
use crate::view::ros_names::shortened;

impl Views {
    /// The name of a discovered module, made different from declared ones.
    pub(crate) fn free_name(&self, group: GroupId, name: &str) -> Arc<str> {
        let path = &self.layout.groups[group.0 as usize].path;
        let second = (2..).map(|number| format!("{path}/{name} ({number})"));
        let mut free = std::iter::once(format!("{path}/{name}")).chain(second);
        free.find(|id| !self.names.contains(&**id)).unwrap_or_default().into()
    }

    /// Adds a discovered module; `number` is its place in the order of arrival.
    pub(crate) fn discover(
        &mut self,
        id: ModuleId,
        group: GroupId,
        (name, number): (Arc<str>, u64),
        told: Told,
        now: Timestamp,
    ) {
        let layout = Arc::make_mut(&mut self.layout);
        Arc::make_mut(&mut self.names).insert(name.clone());
        let info = Arc::new(made(name, number, group, told));
        let group = &mut layout.groups[group.0 as usize];
        group.modules.push(id);
        group.hint = None;
        match layout.modules.get_mut(id.0 as usize) {
            Some(slot) => {
                *slot = info;
                self.clear(id, now);
            }
            None => {
                layout.modules.push(info);
                self.push_module(now);
            }
        }
        self.seq_changed = true;
    }

    /// Removes a module. Its name stays while alarms or countermeasures refer to it. Returns that name.
    pub(crate) fn leave(&mut self, id: ModuleId) -> Arc<str> {
        let layout = Arc::make_mut(&mut self.layout);
        let info = Arc::make_mut(&mut layout.modules[id.0 as usize]);
        info.gone = true;
        let name = info.id.clone();
        layout.groups[info.group.0 as usize].modules.retain(|&member| member != id);
        Arc::make_mut(&mut self.names).remove(&name);
        let since = self.modules[id.0 as usize].since;
        self.clear(id, since);
        self.seq_changed = true;
        name
    }

    /// A module that left is there again, under its name.
    pub(crate) fn come_back(&mut self, id: ModuleId, now: Timestamp) {
        let layout = Arc::make_mut(&mut self.layout);
        let info = Arc::make_mut(&mut layout.modules[id.0 as usize]);
        info.gone = false;
        Arc::make_mut(&mut self.names).insert(info.id.clone());
        layout.groups[info.group.0 as usize].modules.push(id);
        self.clear(id, now);
        self.seq_changed = true;
    }

    /// Nothing refers to a module that left any more.
    pub(crate) fn clear_name(&mut self, id: ModuleId) {
        let layout = Arc::make_mut(&mut self.layout);
        Arc::make_mut(&mut layout.modules[id.0 as usize]).id = Arc::default();
    }

    /// The last report of a module expired: it has none, as at the beginning.
    pub(crate) fn forget(&mut self, id: ModuleId) {
        self.note_heard(id);
        self.set_report(id, Arc::default());
    }

    /// Sets the hint for an empty group, once.
    pub(crate) fn hint(&mut self, group: GroupId, hint: Text) {
        let known = self.layout.groups[group.0 as usize].hint.is_some();
        if !known {
            Arc::make_mut(&mut self.layout).groups[group.0 as usize].hint = Some(hint);
            self.revision_changed = true;
        }
    }

    pub(crate) fn says_nothing(&self, id: ModuleId) -> bool {
        self.reports[id.0 as usize].message.is_empty()
    }

    fn clear(&mut self, id: ModuleId, since: Timestamp) {
        self.reports[id.0 as usize] = Arc::default();
        self.budget.store(id, WriterId::default(), 0, false);
        if let Some(view) = self.modules.get_mut(id.0 as usize) {
            *view = unheard(since);
        }
        self.revision_changed = true;
    }

    pub(super) fn push_module(&mut self, now: Timestamp) {
        self.is_heard.push(false);
        self.reports.push(Arc::default());
        self.modules.push(unheard(now));
    }
}

/// The configuration of a discovered module.
#[derive(Debug, Clone, Default)]
pub(crate) struct Told {
    status: Option<Arc<str>>,
    shown: Option<Arc<str>>,
    writers: Option<NodeNames>,
}

impl Told {
    /// `status` is the one that made the module, if one did.
    pub(crate) fn of(net: &Net, id: ModuleId, status: Option<Arc<str>>) -> Told {
        let writers = status.as_ref().and_then(|_| net.discovered_policy(id).writers.clone());
        let entry = status.as_ref().and_then(|_| net.claimed_by(id));
        let shown = entry.zip(status.as_ref()).and_then(|(entry, name)| shortened(name, &entry.prefixes));
        Told { shown: shown.map(Arc::from), writers, status }
    }
}

/// The names of a module that is made while the engine runs.
pub(super) fn made(id: Arc<str>, number: u64, group: GroupId, told: Told) -> ModuleInfo {
    let Told { status, shown, writers } = told;
    ModuleInfo { status, shown, writers, discovered: true, number, ..self_reporting(id, group) }
}

fn unheard(since: Timestamp) -> ModuleView {
    ModuleView {
        state: State::Ignore,
        own: State::Unknown,
        since,
        began: None,
        received: None,
        silent: false,
        steps: Steps::default(),
        reason: None,
        report: Arc::default(),
    }
}
