//! Names to modules: which modules a status feeds, looked up once and remembered (`ENGINE.md` 1).

use std::collections::HashMap;

use super::model::{GroupId, Model, ModuleId, MonitorSpec};

/// What is known of one status name.
#[derive(Debug, Default)]
pub(super) struct Route {
    pub(super) modules: Vec<ModuleId>,
    /// The array in which the name was seen last, and where: of two statuses with one name in
    /// one array the worse one counts.
    pub(super) array: u64,
    pub(super) position: u32,
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
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Claim {
    /// It feeds a new module in each of these groups.
    Groups(Vec<GroupId>),
    /// The limit is reached: it is dropped.
    Full,
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
            let MonitorSpec::SelfState { status } = &module.monitor;
            let route = names.route(status);
            names.routes[route as usize].modules.push(ModuleId(index as u32));
        }
        names
    }

    pub(super) fn find(&self, name: &str) -> Option<u32> {
        self.index.get(name).copied()
    }

    /// Asks the filters about a name that nothing is known of.
    pub(super) fn claim(&self, model: &Model, name: &str, other: GroupId) -> Claim {
        if self.discovered >= self.discovered_max {
            return Claim::Full;
        }
        let matching = model
            .groups
            .iter()
            .enumerate()
            .filter(|(_, group)| group.filters.iter().any(|filter| filter.matches(name)));
        let mut groups: Vec<GroupId> = matching.map(|(index, _)| GroupId(index as u32)).collect();
        if groups.is_empty() {
            groups.push(other);
        }
        groups.truncate(self.discovered_max - self.discovered);
        Claim::Groups(groups)
    }

    /// Remembers that `name` feeds these modules, which were made for it.
    pub(super) fn discovered(&mut self, name: &str, modules: Vec<ModuleId>) -> u32 {
        self.discovered += modules.len();
        let route = self.route(name);
        self.routes[route as usize].modules = modules;
        route
    }

    fn route(&mut self, name: &str) -> u32 {
        if let Some(route) = self.find(name) {
            return route;
        }
        let route = self.routes.len() as u32;
        self.routes.push(Route::default());
        self.index.insert(name.into(), route);
        route
    }
}
