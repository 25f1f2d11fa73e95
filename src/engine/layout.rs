//! Names and structure of what snapshots show, from the model.

use std::sync::Arc;

use super::model::{GroupId, GroupSpec, Model, ModuleId, Text};
use super::snapshot::{Class, GroupInfo, Layout, ModuleInfo};
use super::system::{OTHER_GROUP, SYSTEM_GROUP, SystemCheck};

/// The class of a module that judges a received level.
pub(super) const SELF_STATE: Class = Class { location: "isolated", information: "content", flow: None };

pub(super) fn layout(model: &Model) -> Layout {
    let info = |spec: &GroupSpec| GroupInfo {
        path: spec.path.clone(),
        name: spec.name.clone(),
        parent: spec.parent,
        groups: Vec::new(),
        modules: Vec::new(),
        depends_on: spec.depends_on.iter().map(|dependency| dependency.on.clone()).collect(),
        tile: spec.tile,
        is_other: false,
        is_system: false,
    };
    let mut groups: Vec<GroupInfo> = model.groups.iter().map(info).collect();
    let built_in = |path: &str, en: &str, de: &str| GroupInfo {
        path: path.into(),
        name: Text { en: en.into(), de: de.into() },
        parent: None,
        groups: Vec::new(),
        modules: Vec::new(),
        depends_on: Vec::new(),
        tile: None,
        is_other: path == OTHER_GROUP,
        is_system: path == SYSTEM_GROUP,
    };
    groups.push(built_in(OTHER_GROUP, "Other", "Sonstige"));
    groups.push(built_in(SYSTEM_GROUP, "Telltale", "Telltale"));
    for (index, spec) in model.groups.iter().enumerate() {
        if let Some(parent) = spec.parent {
            groups[parent.0 as usize].groups.push(GroupId(index as u32));
        }
    }
    let mut modules = Vec::with_capacity(model.modules.len());
    for (index, spec) in model.modules.iter().enumerate() {
        groups[spec.group.0 as usize].modules.push(ModuleId(index as u32));
        modules.push(Arc::new(ModuleInfo {
            id: spec.id.clone(),
            name: spec.name.clone(),
            help: spec.help.clone(),
            group: spec.group,
            depends_on: spec.depends_on.iter().map(|dependency| dependency.on.clone()).collect(),
            discovered: false,
            class: spec.monitor.class(),
        }));
    }
    let system = GroupId(groups.len() as u32 - 1);
    for check in SystemCheck::ALL {
        groups[system.0 as usize].modules.push(ModuleId(modules.len() as u32));
        modules.push(Arc::new(ModuleInfo {
            id: check.id().into(),
            name: Some(check.name()),
            help: Some(check.help()),
            group: system,
            depends_on: Vec::new(),
            discovered: false,
            class: SELF_STATE,
        }));
    }
    Layout {
        vehicle_id: model.vehicle_id.clone(),
        vehicle_name: model.vehicle_name.clone(),
        stops: model.driving.stops.clone().into(),
        groups,
        modules,
    }
}
