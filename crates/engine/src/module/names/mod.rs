//! Names to modules: the modules that a status feeds, looked up once and remembered.

pub(crate) mod kept;

use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::Arc;

use super::writers::WriterReports;
use crate::model::{GroupId, Match, Model, ModuleId, Policy};

/// A known status name.
#[derive(Debug, Clone)]
pub(crate) struct Route {
    name: Arc<str>,
    /// In the order of the first receipt of names.
    number: u64,
    /// Nearly every name feeds one module, so it is stored here and not in a separate list.
    first: ModuleId,
    more: Vec<ModuleId>,
    /// The array in which the name was received last, and its position: of two statuses with one name in one
    /// array the worse one counts.
    pub(crate) array: u64,
    pub(crate) position: u32,
    /// Some group that claims the name has no module of it.
    lacking: bool,
    /// The groups that have no module of it because there was no room, and count it among their dropped names.
    dropped_by: Vec<GroupId>,
    /// No further group has to count it, as long as there is no room.
    counted: bool,
    /// The route of the name that followed this one in an array, or [`NOBODY`]: it most likely does again.
    next: u32,
    /// The writers of the name with their last reports.
    pub(crate) writer_reports: WriterReports,
    /// The array whose report of the name does not count, because another writer reports a worse state or the
    /// writer is not admitted.
    pub(crate) overruled: u64,
}

/// No route.
const NOBODY: u32 = u32::MAX;

impl Route {
    fn new(name: Arc<str>, number: u64, first: ModuleId) -> Route {
        Route {
            name,
            number,
            first,
            more: Vec::new(),
            array: 0,
            position: 0,
            lacking: false,
            dropped_by: Vec::new(),
            counted: false,
            next: NOBODY,
            writer_reports: WriterReports::default(),
            overruled: 0,
        }
    }

    /// The modules that the name feeds, by position.
    pub(crate) fn module(&self, position: usize) -> Option<ModuleId> {
        match position {
            0 => Some(self.first),
            _ => self.more.get(position - 1).copied(),
        }
    }

    pub(crate) fn modules(&self) -> impl Iterator<Item = ModuleId> + Clone {
        std::iter::once(self.first).chain(self.more.iter().copied())
    }
}

/// The average size of a discovered name for which there is room, in bytes: `limits.discovered_modules` times
/// this in total, and at least enough for some long names.
pub(super) const NAME_BYTES: usize = 256;
const NAMES_BYTES_MIN: usize = 64 << 10;
/// Remembered names that the configuration drops.
const DROPPED_MAX: usize = 4096;

/// All names that feed a module. Declared names are here from the start.
#[derive(Debug, Clone)]
pub(crate) struct Names {
    /// Shared with copies of the engine until a name comes or goes.
    index: Arc<HashMap<Arc<str>, u32>>,
    pub(crate) routes: Vec<Route>,
    /// Routes of forgotten names.
    free: Vec<u32>,
    seen: u64,
    /// The route of each discovered module.
    of_module: HashMap<ModuleId, u32>,
    discovered_max: usize,
    /// The bytes of the names of discovered modules, each module with its own copy.
    bytes: usize,
    /// Names that the configuration drops, as far as they were remembered.
    dropped: HashSet<Arc<str>>,
    /// Routes whose modules were made at the word of a node that is not known yet.
    unproven: BTreeSet<u32>,
}

/// The groups of a new name.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Claim {
    /// It feeds a new module in each of these groups.
    pub(crate) places: Vec<NewModule>,
    /// These groups claim it, but the limit is reached.
    pub(crate) dropped_by: Vec<GroupId>,
    /// The limit is that of the names' bytes.
    pub(crate) too_long: bool,
}

impl Names {
    pub(crate) fn new(model: &Model) -> Names {
        let declared = model.modules.iter().filter(|module| module.monitor.status().is_some()).count();
        let mut names = Names {
            index: Arc::new(HashMap::with_capacity(declared)),
            routes: Vec::with_capacity(declared),
            free: Vec::new(),
            seen: 0,
            of_module: HashMap::new(),
            discovered_max: model.limits.discovered_modules,
            bytes: 0,
            dropped: HashSet::new(),
            unproven: BTreeSet::new(),
        };
        for (index, module) in model.modules.iter().enumerate() {
            if let Some(status) = module.monitor.status() {
                names.feed(status.clone(), ModuleId(index as u32));
            }
        }
        // Filters take what is only expected; they take nothing that is declared.
        let statuses = |expected: bool| {
            let modules = model.modules.iter().filter(move |it| it.expected.is_some() == expected);
            modules.filter_map(|module| module.monitor.status())
        };
        for (lacking, status) in
            statuses(true).map(|status| (true, status)).chain(statuses(false).map(|status| (false, status)))
        {
            if let Some(route) = names.find(status) {
                names.set_lacking(route, lacking);
            }
        }
        names
    }

    /// Whether this name is remembered as one that the configuration drops.
    pub(crate) fn is_dropped(&self, name: &str) -> bool {
        !self.dropped.is_empty() && self.dropped.contains(name)
    }

    /// Remembers a name that the configuration drops, as long as there is room; it is matched again otherwise.
    pub(crate) fn drop_name(&mut self, name: &str) {
        if self.dropped.len() < DROPPED_MAX && name.len() <= NAME_BYTES {
            self.dropped.insert(name.into());
        }
    }

    /// Whether some group that claims the name may have no module of it.
    pub(crate) fn is_lacking(&self, route: u32) -> bool {
        self.routes[route as usize].lacking
    }

    pub(crate) fn find(&self, name: &str) -> Option<u32> {
        self.index.get(name).copied()
    }

    /// Finds a name by the one before it in an array. Components report their names in the same order each
    /// time, so nearly always no lookup is needed.
    pub(crate) fn find_behind(&mut self, before: Option<u32>, name: &str) -> Option<u32> {
        let Some(before) = before else { return self.find(name) };
        let guess = self.routes[before as usize].next;
        let known = self.routes.get(guess as usize).is_some_and(|route| *route.name == *name);
        // An unused route has an empty name, and a status may have one too.
        if known && !name.is_empty() {
            return Some(guess);
        }
        let found = self.find(name)?;
        self.routes[before as usize].next = found;
        Some(found)
    }

    pub(crate) fn name(&self, route: u32) -> Arc<str> {
        self.routes[route as usize].name.clone()
    }

    /// Whether the report of a name in an array counts outside of the array.
    pub(crate) fn counts(&self, name: &str, array: u64) -> bool {
        self.find(name).is_none_or(|route| self.routes[route as usize].overruled != array)
    }

    /// Continues the writers of each name from before a reload.
    pub(crate) fn keep_writer_reports(&mut self, old: &Names) {
        for (name, &route) in &*self.index {
            if let Some(before) = old.find(name) {
                self.routes[route as usize].writer_reports =
                    old.routes[before as usize].writer_reports.clone();
                if old.unproven.contains(&before) {
                    self.unproven.insert(route);
                }
            }
        }
    }

    /// Continues which groups count each name among their dropped ones from before a reload.
    pub(crate) fn keep_dropped(&mut self, old: &Names, same_group: impl Fn(GroupId) -> Option<GroupId>) {
        for (name, &route) in &*self.index {
            if let Some(before) = old.find(name) {
                let groups = old.routes[before as usize].dropped_by.iter();
                self.routes[route as usize].dropped_by.extend(groups.filter_map(|&it| same_group(it)));
            }
        }
    }

    /// The groups that claim a name, whether there is room or not; none if the configuration drops it.
    pub(crate) fn wanted(model: &Model, name: &str, other: GroupId) -> Vec<NewModule> {
        let matching = model.groups.iter().zip(0..).filter_map(|(group, index)| {
            let filter = group.filters.iter().position(|entry| entry.takes(name))?;
            Some(NewModule { group: GroupId(index), filter: Some(filter as u32) })
        });
        let mut places: Vec<NewModule> = matching.collect();
        if places.is_empty() && !model.unclaimed.except.iter().any(|filter| filter.matches(name)) {
            places.push(NewModule::of(other));
        }
        places
    }

    /// Matches a name against the filters of all groups. Only some of the places are `free` to take it.
    pub(crate) fn claim(
        &self,
        model: &Model,
        name: &str,
        other: GroupId,
        free: impl FnMut(&NewModule) -> bool,
    ) -> Claim {
        let mut places = Names::wanted(model, name, other);
        places.retain(free);
        let modules = self.discovered_max.saturating_sub(self.of_module.len());
        let room = modules.min(self.bytes_left() / name.len().max(1));
        let dropped = places.split_off(places.len().min(room));
        let too_long = room < modules && !dropped.is_empty();
        Claim { places, dropped_by: dropped.iter().map(|place| place.group).collect(), too_long }
    }

    fn bytes_left(&self) -> usize {
        (self.discovered_max.saturating_mul(NAME_BYTES)).max(NAMES_BYTES_MIN).saturating_sub(self.bytes)
    }

    /// Remembers the discovered module of `name`.
    pub(crate) fn discovered(&mut self, name: &str, module: ModuleId) -> u32 {
        let route = self.feed(name.into(), module);
        self.of_module.insert(module, route);
        self.bytes += name.len();
        route
    }

    /// Forgets a discovered module, and its name with the last of its modules.
    pub(crate) fn forget(&mut self, module: ModuleId) {
        let Some(index) = self.of_module.remove(&module) else { return };
        let route = &mut self.routes[index as usize];
        self.bytes -= route.name.len();
        (route.lacking, route.counted) = (true, false);
        route.more.retain(|&other| other != module);
        if route.first != module {
            return;
        }
        if route.more.is_empty() {
            Arc::make_mut(&mut self.index).remove(&route.name);
            route.name = Arc::default();
            self.free.push(index);
            self.unproven.remove(&index);
        } else {
            route.first = route.more.remove(0);
        }
    }

    /// Sets whether some group that claims the name has no module of it.
    pub(crate) fn set_lacking(&mut self, route: u32, lacking: bool) {
        self.routes[route as usize].lacking = lacking;
    }

    /// Whether a known name may feed further modules, or a group has to count it among its dropped names.
    pub(crate) fn may_grow(&self, route: u32) -> bool {
        let route = &self.routes[route as usize];
        let has_room = || self.of_module.len() < self.discovered_max && route.name.len() <= self.bytes_left();
        route.lacking && (!route.counted || has_room())
    }

    /// Notes the groups that have no room for a known name, and whether these are `all`. Returns those that have
    /// not counted it yet. A writer that some group does not admit says nothing of that group.
    pub(crate) fn drop_from(&mut self, route: u32, claim: &Claim, all: bool) -> Vec<GroupId> {
        let route = &mut self.routes[route as usize];
        route.dropped_by.retain(|group| !claim.places.iter().any(|made| made.group == *group));
        route.counted = all;
        let new = claim.dropped_by.iter().copied().filter(|group| !route.dropped_by.contains(group));
        let new: Vec<GroupId> = new.collect();
        route.dropped_by.extend(&new);
        new
    }

    /// The modules of the name were made at the word of a node that is not known yet.
    pub(crate) fn doubt(&mut self, route: u32) {
        self.unproven.insert(route);
    }

    /// The node has become known, and may say the name.
    pub(crate) fn trust(&mut self, route: u32) {
        self.unproven.remove(&route);
    }

    /// In the order of their first receipt, which an engine that is loaded from a keyframe knows too.
    pub(crate) fn unproven(&self) -> Vec<u32> {
        let mut routes: Vec<u32> = self.unproven.iter().copied().collect();
        routes.sort_unstable_by_key(|&route| self.routes[route as usize].number);
        routes
    }

    pub(crate) fn modules(&self, route: u32) -> impl Iterator<Item = ModuleId> {
        self.routes[route as usize].modules()
    }

    /// All names with their modules, in the order of their first receipt.
    pub(crate) fn in_order(&self) -> Vec<(&str, impl Iterator<Item = ModuleId>)> {
        let mut names: Vec<(u64, &Arc<str>, u32)> = self
            .index
            .iter()
            .map(|(name, &route)| (self.routes[route as usize].number, name, route))
            .collect();
        names.sort_unstable();
        names.into_iter().map(|(_, name, route)| (&**name, self.modules(route))).collect()
    }

    fn feed(&mut self, name: Arc<str>, module: ModuleId) -> u32 {
        if let Some(route) = self.find(&name) {
            self.routes[route as usize].more.push(module);
            return route;
        }
        self.seen += 1;
        let new = Route::new(name.clone(), self.seen, module);
        let route = match self.free.pop() {
            Some(route) => {
                self.routes[route as usize] = new;
                route
            }
            None => {
                self.routes.push(new);
                self.routes.len() as u32 - 1
            }
        };
        Arc::make_mut(&mut self.index).insert(name, route);
        route
    }
}

/// A group in which a module is discovered, and the index of the claiming entry in the group's `match` list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NewModule {
    pub(crate) group: GroupId,
    pub(crate) filter: Option<u32>,
}

impl NewModule {
    pub(crate) fn of(group: GroupId) -> NewModule {
        NewModule { group, filter: None }
    }

    /// The policy of the module: that of the entry that claims it.
    pub(crate) fn policy<'m>(&self, model: &'m Model) -> &'m Policy {
        let is_unclaimed = self.group.0 as usize == model.groups.len();
        let of_entry = self.entry(model).and_then(|entry| entry.policy.as_ref());
        let of_place = if is_unclaimed { model.unclaimed.policy.as_ref() } else { of_entry };
        of_place.unwrap_or(&model.discovered)
    }

    /// The entry that claims the module.
    pub(crate) fn entry<'m>(&self, model: &'m Model) -> Option<&'m Match> {
        model.groups.get(self.group.0 as usize)?.filters.get(self.filter? as usize)
    }
}
