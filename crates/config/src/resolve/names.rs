//! The names of all groups and modules, with the nodes that they refer to.

use std::collections::HashMap;
use std::sync::Arc;

use super::twice;
use crate::decode::Spanned;
use crate::file;
use crate::file::monitors::Monitor;
use telltale_engine::model::{GroupId, ModuleId, NodeId};
use telltale_yaml::{Log, Problem, Span, suggest};

/// The built-in groups of the engine.
const RESERVED: [&str; 2] = ["other", "telltale"];

/// All nodes in the engine's order: groups before the groups inside of them.
pub(crate) struct Names<'r> {
    groups: Vec<GroupName<'r>>,
    modules: Vec<ModuleName<'r>>,
    by_path: HashMap<Arc<str>, NodeId>,
    /// Some node has no valid name, so an unknown name may be meant for it.
    incomplete: bool,
}

pub(crate) struct GroupName<'r> {
    pub path: Arc<str>,
    pub parent: Option<GroupId>,
    pub raw: &'r file::Group,
}

pub(crate) struct ModuleName<'r> {
    pub path: Arc<str>,
    pub group: GroupId,
    pub raw: &'r file::Module,
}

impl GroupName<'_> {
    /// The last part of the path.
    pub fn id(&self) -> &str {
        self.path.rsplit('/').next().unwrap_or(&self.path)
    }

    /// Whether people read this text, and not its id.
    fn is_titled(&self, text: &str) -> bool {
        self.raw.name.as_ref().is_some_and(|name| *name.en == *text || *name.de == *text)
    }
}

impl<'r> Names<'r> {
    pub fn of(file: &'r file::File, log: &mut Log) -> Names<'r> {
        let mut names =
            Names { groups: Vec::new(), modules: Vec::new(), by_path: HashMap::new(), incomplete: false };
        for group in &file.groups {
            names.add_group(group, None, log);
        }
        if file.groups.is_empty() && log.is_empty() {
            let problem = match file.groups_span {
                Some(span) => Problem::at(span, "`groups` is empty: nothing would be diagnosed"),
                None => {
                    let start = Span { file: 0, start: 0, end: 0 };
                    Problem::at(start, "there are no `groups`: nothing would be diagnosed")
                }
            };
            log.push(
                problem.help("for example `groups: [{ id: sensors, match: [{ namespace: /sensors }] }]`"),
            );
        }
        names
    }

    fn add_group(&mut self, raw: &'r file::Group, parent: Option<GroupId>, log: &mut Log) {
        let id = GroupId(self.groups.len() as u32);
        let path = self.path(raw.id.as_ref(), raw.span, parent, "group", log);
        let span = raw.id.as_ref().map_or(raw.span, |id| id.span);
        if parent.is_none() && RESERVED.contains(&&*path) {
            let problem = Problem::at(span, format!("the group `{path}` is made by the program itself"));
            log.push(problem.help("choose another id"));
        }
        self.groups.push(GroupName { path: path.clone(), parent, raw });
        self.register(&path, NodeId::Group(id), span, log);
        for module in &raw.modules {
            let path = self.path(module.id.as_ref(), module.span, Some(id), "module", log);
            let node = NodeId::Module(ModuleId(self.modules.len() as u32));
            let span = module.id.as_ref().map_or(module.span, |id| id.span);
            self.modules.push(ModuleName { path: path.clone(), group: id, raw: module });
            self.register(&path, node, span, log);
        }
        for group in &raw.groups {
            self.add_group(group, Some(id), log);
        }
    }

    /// A node without a valid id gets a path that no name can match; the log has the reason.
    fn path(
        &mut self,
        id: Option<&Spanned<String>>,
        span: Span,
        parent: Option<GroupId>,
        what: &str,
        log: &mut Log,
    ) -> Arc<str> {
        let usable = id.filter(|id| check_id(id, what, log));
        self.incomplete |= usable.is_none();
        let id = usable.map_or_else(|| format!("?{}", span.start), |id| id.value.clone());
        parent.map_or_else(
            || id.as_str().into(),
            |parent| format!("{}/{id}", self.groups[parent.0 as usize].path).into(),
        )
    }

    fn register(&mut self, path: &Arc<str>, node: NodeId, span: Span, log: &mut Log) {
        let what = match node {
            NodeId::Group(_) => "group",
            NodeId::Module(_) => "module",
        };
        match self.by_path.get(path) {
            Some(&first) => log.push(twice(span, self.span(first), &format!("{what} `{path}`"))),
            None => {
                self.by_path.insert(path.clone(), node);
            }
        }
    }

    pub fn groups(&self) -> impl Iterator<Item = (GroupId, &GroupName<'r>)> {
        (0..).map(GroupId).zip(&self.groups)
    }

    pub fn modules(&self) -> impl Iterator<Item = (ModuleId, &ModuleName<'r>)> {
        (0..).map(ModuleId).zip(&self.modules)
    }

    pub fn group(&self, id: GroupId) -> &GroupName<'r> {
        &self.groups[id.0 as usize]
    }

    pub fn path_of(&self, node: NodeId) -> &Arc<str> {
        match node {
            NodeId::Group(id) => &self.groups[id.0 as usize].path,
            NodeId::Module(id) => &self.modules[id.0 as usize].path,
        }
    }

    /// The place of a node's id.
    pub fn span(&self, node: NodeId) -> Span {
        let (id, span) = match node {
            NodeId::Group(id) => {
                let raw = self.groups[id.0 as usize].raw;
                (&raw.id, raw.span)
            }
            NodeId::Module(id) => {
                let raw = self.modules[id.0 as usize].raw;
                (&raw.id, raw.span)
            }
        };
        id.as_ref().map_or(span, |id| id.span)
    }

    /// The group that contains a node.
    pub fn parent(&self, node: NodeId) -> Option<GroupId> {
        match node {
            NodeId::Group(id) => self.groups[id.0 as usize].parent,
            NodeId::Module(id) => Some(self.modules[id.0 as usize].group),
        }
    }

    /// The written dependencies of a node.
    pub fn dependencies(&self, node: NodeId) -> &'r [file::Dependency] {
        match node {
            NodeId::Group(id) => &self.groups[id.0 as usize].raw.depends_on,
            NodeId::Module(id) => &self.modules[id.0 as usize].raw.depends_on,
        }
    }

    /// The node with this name; if there is none, the log has a suggestion.
    pub fn find(&self, name: &Spanned<String>, log: &mut Log) -> Option<NodeId> {
        let found = self.by_path.get(name.value.as_str()).copied();
        if found.is_none() && !self.incomplete {
            let mut known: Vec<&str> = self.by_path.keys().map(|path| &**path).collect();
            known.sort_unstable();
            let problem = Problem::at(name.span, format!("there is no group or module `{}`", name.value));
            let titled = self.groups.iter().find(|group| group.is_titled(&name.value));
            log.push(problem.help(match (titled, suggest(&name.value, known)) {
                (Some(group), _) => {
                    format!("that is its `name`, which people read; write its id: `{}`", group.path)
                }
                (None, Some(meant)) => format!("did you mean `{meant}`?"),
                (None, None) => "write the full name: `group`, `group/module` or `group/group/module`".into(),
            }));
        }
        found
    }

    /// The declared module with this status.
    pub fn claimed_by(&self, status: &str) -> Option<&ModuleName<'r>> {
        self.modules.iter().find(|module| module.status().is_some_and(|own| own.value == status))
    }
}

impl ModuleName<'_> {
    pub fn status(&self) -> Option<&Spanned<String>> {
        self.raw.status()
    }
}

impl file::Module {
    /// The status that the module takes.
    pub fn status(&self) -> Option<&Spanned<String>> {
        match self.monitor.as_ref()? {
            Monitor::SelfState { status } | Monitor::External { status, .. } => status.as_ref(),
            _ => None,
        }
    }

    /// The place of the status, node or service that the module is about.
    pub fn target(&self) -> Option<Span> {
        match self.monitor.as_ref()? {
            Monitor::Watchdog { place, .. } => Some(*place),
            _ => self.status().map(|status| status.span),
        }
    }
}

/// Ids become paths, HTML ids and topic names: few characters are safe in all of them.
pub(crate) fn check_id(id: &Spanned<String>, what: &str, log: &mut Log) -> bool {
    let good = id.value.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"_.-".contains(&byte));
    if !good {
        let problem = Problem::at(id.span, format!("`{}` cannot be the id of a {what}", id.value));
        log.push(problem.help("use letters, digits, `_`, `.` and `-`; what people read stands in `name`"));
    }
    good
}

/// Two modules of one group with the same status would always show the same.
pub(crate) fn check_statuses(names: &Names, log: &mut Log) {
    let mut seen: HashMap<(GroupId, &str), Span> = HashMap::new();
    for (_, module) in names.modules() {
        let Some(status) = module.status() else { continue };
        if let Some(first) = seen.insert((module.group, &status.value), status.span) {
            let group = &names.group(module.group).path;
            let problem = Problem::at(
                status.span,
                format!("two modules of `{group}` take the status `{}`", status.value),
            );
            log.push(
                problem.label("again here").also(first, "first here").help("remove one of the two modules"),
            );
        }
    }
}
