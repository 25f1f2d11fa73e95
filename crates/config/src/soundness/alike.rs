//! Finds nodes with equal names: siblings in the tree for ROS 2, whose tools identify a node by its name, and
//! tiles with the name of a built-in group.

use std::collections::HashMap;

use super::{Finding, FindingKind};
use telltale_engine::model::{GroupId, Model, ModuleId, NodeId};
use telltale_engine::module::system::BUILT_IN_GROUPS;
use telltale_engine::view::ros_names::part;

pub(super) fn look(model: &Model) -> Vec<Finding> {
    let mut first: HashMap<(Option<GroupId>, String), NodeId> = HashMap::new();
    let mut found = Vec::new();
    // As in the tree, groups come before modules.
    let groups = (0..).map(GroupId).zip(&model.groups);
    let groups = groups.map(|(id, group)| (NodeId::Group(id), group.parent, part(&group.name.en)));
    let modules = (0..).map(ModuleId).zip(&model.modules).map(|(id, module)| {
        let around = model.groups[module.group.0 as usize].path.len();
        let name = module.id.get(around + 1..).unwrap_or(&module.id);
        (NodeId::Module(id), Some(module.group), part(name))
    });
    for (node, around, name) in groups.chain(modules) {
        if let Some(&first) = first.get(&(around, name.clone())) {
            found.push(Finding { node, what: FindingKind::SameName { first, name }, example: None });
        } else {
            first.insert((around, name), node);
        }
    }
    found.extend(as_built_in(model));
    found
}

/// Tiles with the name of a built-in group, in any language, or with its id.
fn as_built_in(model: &Model) -> impl Iterator<Item = Finding> {
    let tiles = (0..).map(GroupId).zip(&model.groups).filter(|(_, group)| group.parent.is_none());
    tiles.filter_map(|(id, group)| {
        let names = [&group.name.en, &group.name.de].map(|name| part(name));
        let found = BUILT_IN_GROUPS.into_iter().find_map(|(built_in, en, de)| {
            let same = |name: &&String| [built_in, en, de].iter().any(|it| it.eq_ignore_ascii_case(name));
            Some((built_in, names.iter().find(same)?.clone()))
        });
        let (built_in, name) = found?;
        Some(Finding {
            node: NodeId::Group(id),
            what: FindingKind::BuiltInName { built_in, name },
            example: None,
        })
    })
}
