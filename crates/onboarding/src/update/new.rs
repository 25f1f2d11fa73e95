//! The modules and groups of a draft that a configuration does not watch, with ids that are free in the file.

use std::collections::{BTreeMap, BTreeSet};

use super::home::Homes;
use super::{find, ids_of, modules_of};
use crate::init::draft::{Draft, Group, Module, ModuleKind};
use crate::init::names;
use crate::init::passing::Passing;
use crate::init::proposals::Target;
use crate::live::Unwatched;
use telltale_config::Loaded;
use telltale_config::describe::words::counted;
use telltale_yaml::Node;

#[derive(Default)]
pub struct New {
    /// Modules for groups of the file, by their paths.
    pub joining: BTreeMap<String, Vec<Module>>,
    pub groups: Vec<Group>,
    /// Modules and groups that have no place in the file, one sentence each.
    pub left: Vec<String>,
    /// The whole name in the file of each module of the draft.
    names: BTreeMap<String, String>,
    /// The ids of each group of the file.
    ids: BTreeMap<String, BTreeSet<String>>,
}

impl New {
    /// `written` are the groups of the file that is added to.
    pub fn of(
        loaded: &Loaded,
        draft: Draft,
        unwatched: &Unwatched,
        is_known: impl Fn(&str) -> bool,
        written: Option<&Node>,
    ) -> New {
        let homes = Homes::of(&loaded.model, &draft);
        let mut new = New { names: homes.names(&draft), ..New::default() };
        let mut unknown: BTreeSet<String> = BTreeSet::new();
        let mut is_new = |module: &Module| match &module.kind {
            ModuleKind::Status { name, .. } => {
                unwatched.statuses.contains(name) || unwatched.forgotten.contains(name)
            }
            ModuleKind::Rate { topic, type_name, .. }
            | ModuleKind::Age { topic, type_name, .. }
            | ModuleKind::Value { topic, type_name, .. } => {
                let (is_unwatched, known) = (unwatched.topics.contains(topic), is_known(type_name));
                if is_unwatched && !known {
                    unknown.insert(format!("{} of {}", names::comment(type_name), names::comment(topic)));
                }
                is_unwatched && known
            }
            ModuleKind::Node { name, .. } => unwatched.nodes.contains(name),
        };
        let mut taken = written.map(ids_of).unwrap_or_default();
        for mut group in draft.groups {
            let modules: Vec<Module> = group.modules.extract_if(.., |module| is_new(module)).collect();
            group.modules.clear();
            group.passing.retain(|passing| unwatched.statuses.contains(&passing.example));
            for module in modules {
                match homes.of_module(&group.id, &module) {
                    Some(home) => new.join(home, &group.id, module, written),
                    None => group.modules.push(module),
                }
            }
            if homes.of_group(&group.id).is_some() {
                new.left.extend(group.passing.iter().map(of_passing));
            } else if !(group.modules.is_empty() && group.passing.is_empty()) {
                new.make(group, &mut taken);
            }
        }
        new.left.extend(unknown.into_iter().map(|of| {
            format!("the type {of} is not defined for the file: name the folder with it in `message_folders`")
        }));
        new.leave_what_stands_elsewhere(written);
        let New { joining, groups, names, .. } = &mut new;
        let made = groups.iter_mut().flat_map(|group| &mut group.modules);
        joining.values_mut().flatten().chain(made).for_each(|module| rename(module, names));
        new
    }

    fn join(&mut self, home: &str, of: &str, mut module: Module, written: Option<&Node>) {
        let ids = self.ids.entry(home.to_owned()).or_insert_with(|| {
            written.and_then(|groups| find(groups, home)).map(modules_of).unwrap_or_default()
        });
        let name = format!("{of}/{}", module.id);
        module.id = names::id(&module.id, "module", ids);
        self.names.insert(name, format!("{home}/{}", module.id));
        self.joining.entry(home.to_owned()).or_default().push(module);
    }

    fn make(&mut self, group: Group, taken: &mut BTreeSet<String>) {
        let id = names::id(&group.id, "group", taken);
        for module in &group.modules {
            self.names.insert(format!("{}/{}", group.id, module.id), format!("{id}/{}", module.id));
        }
        self.groups.push(Group { id, ..group });
    }

    fn leave_what_stands_elsewhere(&mut self, written: Option<&Node>) {
        let is_here = |home: &str| written.is_some_and(|groups| find(groups, home).is_some());
        for (home, modules) in self.joining.extract_if(.., |home, _| !is_here(home)) {
            let count = counted(modules.len(), "module");
            self.left.push(format!("{count} for the group {home}, which stands in another file"));
            self.names.retain(|_, name| !modules.iter().any(|it| *name == format!("{home}/{}", it.id)));
        }
    }
}

fn of_passing(passing: &Passing) -> String {
    let (example, regex) = (names::comment(&passing.example), names::scalar(&passing.regex));
    format!(
        "names such as \"{example}\" come and go, and no group takes them: `match: [{{ regex: {regex} }}]`"
    )
}

/// Gives its guessed dependencies the names of the file.
fn rename(module: &mut Module, names: &BTreeMap<String, String>) {
    for proposal in &mut module.proposals {
        let renamed = |it: &Target| Some(Target { name: names.get(&it.name)?.clone(), ..*it });
        proposal.on = proposal.on.iter().filter_map(renamed).collect();
    }
    module.proposals.retain(|proposal| !proposal.on.is_empty());
}
