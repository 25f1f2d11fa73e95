//! Names to modules: which modules a status feeds, looked up once and remembered (`ENGINE.md` 1).

use std::collections::HashMap;

use super::model::{GroupId, Model, ModuleId};

/// What is known of one status name.
#[derive(Debug)]
pub(super) struct Route {
    /// Nearly always there is one, so it lies here and not in a list elsewhere.
    first: ModuleId,
    more: Vec<ModuleId>,
    /// The array in which the name was seen last, and where: of two statuses with one name in
    /// one array the worse one counts.
    pub(super) array: u64,
    pub(super) position: u32,
}

impl Route {
    fn new(first: ModuleId) -> Route {
        Route { first, more: Vec::new(), array: 0, position: 0 }
    }

    /// The modules that the name feeds, by position.
    pub(super) fn module(&self, position: usize) -> Option<ModuleId> {
        match position {
            0 => Some(self.first),
            _ => self.more.get(position - 1).copied(),
        }
    }

    fn modules(&self) -> impl Iterator<Item = ModuleId> {
        std::iter::once(self.first).chain(self.more.iter().copied())
    }
}

/// All names that feed a module. Declared ones stand here from the start.
#[derive(Debug)]
pub(super) struct Names {
    index: HashMap<Box<str>, u32>,
    pub(super) routes: Vec<Route>,
    discovered: usize,
    discovered_max: usize,
}

/// Where a new name belongs.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Claim {
    /// It feeds a new module in each of these groups.
    pub(super) groups: Vec<GroupId>,
    /// These would have it, but the limit is reached.
    pub(super) dropped_by: Vec<GroupId>,
}

impl Names {
    pub(super) fn new(model: &Model) -> Names {
        let mut names = Names {
            index: HashMap::new(),
            routes: Vec::new(),
            discovered: 0,
            discovered_max: model.limits.discovered_modules,
        };
        for (index, module) in model.modules.iter().enumerate() {
            if let Some(status) = module.monitor.status() {
                names.feed(status, ModuleId(index as u32));
            }
        }
        names
    }

    pub(super) fn find(&self, name: &str) -> Option<u32> {
        self.index.get(name).copied()
    }

    /// Asks the filters about a name that nothing is known of.
    pub(super) fn claim(&self, model: &Model, name: &str, other: GroupId) -> Claim {
        let matching = model
            .groups
            .iter()
            .enumerate()
            .filter(|(_, group)| group.filters.iter().any(|filter| filter.matches(name)));
        let mut groups: Vec<GroupId> = matching.map(|(index, _)| GroupId(index as u32)).collect();
        if groups.is_empty() {
            groups.push(other);
        }
        let room = self.discovered_max.saturating_sub(self.discovered);
        let dropped_by = groups.split_off(groups.len().min(room));
        Claim { groups, dropped_by }
    }

    /// Remembers that `name` feeds this module, which was made for it.
    pub(super) fn discovered(&mut self, name: &str, module: ModuleId) -> u32 {
        self.discovered += 1;
        self.feed(name, module)
    }

    /// All names with their modules, in the order in which they were first seen.
    pub(super) fn in_order(&self) -> Vec<(&str, impl Iterator<Item = ModuleId>)> {
        let mut names: Vec<(u32, &str)> = self.index.iter().map(|(name, &route)| (route, &**name)).collect();
        names.sort_unstable();
        let routed = |(route, name): (u32, _)| (name, self.routes[route as usize].modules());
        names.into_iter().map(routed).collect()
    }

    fn feed(&mut self, name: &str, module: ModuleId) -> u32 {
        if let Some(route) = self.find(name) {
            self.routes[route as usize].more.push(module);
            return route;
        }
        let route = self.routes.len() as u32;
        self.routes.push(Route::new(module));
        self.index.insert(name.into(), route);
        route
    }
}
