//! Nodes that had a name before a restart or in another configuration, and no longer exist.

use crate::Engine;
use crate::mask::net::Net;
use crate::model::{GroupId, NodeId};
use crate::module::overflow;
use crate::module::system::SystemCheck;

impl Engine {
    /// Makes a discovered module again, if a filter still claims it and there is room. A status that feeds
    /// several groups gets its other modules too.
    pub(crate) fn rediscover(&mut self, name: &str) {
        if let Some((_, status)) = self.would_make(name, true) {
            self.discover(&status);
        }
    }

    /// Keeps the name of a discovered module for an ended alarm or cause, if a filter still claims it: the
    /// module returns with its next status. Until then it takes no room.
    pub(crate) fn remember(&mut self, name: &str) {
        if let Some((group, _)) = self.would_make(name, false) {
            self.keep_departed(name, group);
        }
    }

    /// The group that claims a module of this name (with room for it, if it `needs_room`), and the status that
    /// makes it.
    fn would_make(&self, name: &str, needs_room: bool) -> Option<(GroupId, String)> {
        // The number at the end distinguishes a second module of the same name.
        let first = name.rsplit_once(" (").filter(|(first, _)| self.views.has(first));
        let name = first.map_or(name, |(first, _)| first);
        let inside = |path: &str| name.strip_prefix(path)?.strip_prefix('/').map(str::to_owned);
        let paths = self.views.paths().filter_map(|(group, path)| Some((group, inside(path)?)));
        let mut candidates: Vec<(GroupId, String)> = paths.collect();
        candidates.sort_by_key(|(_, status)| status.len());
        let other = self.net.other_group();
        candidates.into_iter().find(|(group, status)| {
            if status == overflow::MODULE || needs_room && self.names.find(status).is_some() {
                return false;
            }
            let claim = self.names.claim(&self.model, status, other, |_| true);
            let in_room = claim.places.iter().any(|place| place.group == *group);
            in_room || !needs_room && claim.dropped_by.contains(group)
        })
    }

    /// The substitute for a node that is gone: the closest enclosing group that exists, or else the node that
    /// triggered the request, or `nobody`. The operator can acknowledge it there.
    pub(crate) fn stand_in(&self, name: &str, watched: Option<NodeId>) -> NodeId {
        let declared = self.views.paths().take(self.model.groups.len());
        let around =
            declared.filter(|(_, path)| name.strip_prefix(*path).is_some_and(|rest| rest.starts_with('/')));
        let closest = around.max_by_key(|(_, path)| path.len()).map(|(group, _)| NodeId::Group(group));
        closest.or(watched).unwrap_or(self.net.nobody())
    }
}

impl Net {
    /// The substitute for causes that belong to no node.
    pub(crate) fn nobody(&self) -> NodeId {
        NodeId::Module(self.system_module(SystemCheck::Countermeasure))
    }
}
