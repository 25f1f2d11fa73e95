//! The names and the structure of snapshots, from the model.

use std::sync::Arc;

use crate::model::monitors::{Class, MonitorSpec};
use crate::model::quantity::Quantity;
use crate::model::wording::Wording;
use crate::model::{Combine, GroupId, GroupSpec, Model, ModuleId, ModuleSpec, Other, StageModel};
use crate::module::system::{BUILT_IN_GROUPS, OTHER_GROUP, SYSTEM_GROUP, SystemCheck};
use crate::snapshot::{GroupInfo, Layout, ModuleInfo};
use crate::text::Text;
use crate::view::ros_names::shortened;

/// A module that judges itself and has no entry in a configuration.
pub(crate) fn self_reporting(id: Arc<str>, group: GroupId) -> ModuleInfo {
    ModuleInfo {
        id,
        name: None,
        help: None,
        group,
        status: None,
        shown: None,
        writers: None,
        depends_on: Vec::new(),
        discovered: false,
        gone: false,
        number: 0,
        kind: "self_state",
        class: Class { location: "isolated", information: "content", flow: None },
        of_component: true,
        quantity: None,
        reads: None,
    }
}

/// The name that people read of an expected status.
fn shown(spec: &ModuleSpec) -> Option<Arc<str>> {
    let status = spec.monitor.status()?;
    shortened(status, &spec.expected.as_ref()?.prefixes).map(Arc::from)
}

pub(crate) fn layout(model: &Model) -> Layout {
    let info = |spec: &GroupSpec| GroupInfo {
        path: spec.path.clone(),
        name: spec.name.clone(),
        parent: spec.parent,
        depends_on: spec.depends_on.iter().map(|dependency| dependency.on.clone()).collect(),
        tile: spec.tile,
        is_any: spec.combine == Combine::Any,
        may_be_empty: spec.may_be_empty,
        counted: true,
        ..GroupInfo::default()
    };
    let mut groups: Vec<GroupInfo> = model.groups.iter().map(info).collect();
    let built_in = |(path, en, de): (&str, &str, &str)| GroupInfo {
        path: path.into(),
        name: Text { en: en.into(), de: de.into() },
        is_other: path == OTHER_GROUP,
        may_be_empty: path == OTHER_GROUP,
        counted: path != OTHER_GROUP || model.other == Other::Counted,
        is_system: path == SYSTEM_GROUP,
        ..GroupInfo::default()
    };
    groups.extend(BUILT_IN_GROUPS.map(built_in));
    for (index, spec) in model.groups.iter().enumerate() {
        if let Some(parent) = spec.parent {
            groups[parent.0 as usize].groups.push(GroupId(index as u32));
        }
    }
    let mut modules = Vec::with_capacity(model.modules.len());
    for (index, spec) in model.modules.iter().enumerate() {
        let group = &mut groups[spec.group.0 as usize];
        group.modules.push(ModuleId(index as u32));
        if let Some(MonitorSpec::Count { wanted, .. }) = spec.monitor.other() {
            group.wanted = Some(*wanted);
        }
        modules.push(Arc::new(ModuleInfo {
            name: spec.name.clone(),
            help: spec.help.clone(),
            status: spec.monitor.status().cloned(),
            shown: shown(spec),
            writers: spec.policy.writers.clone(),
            depends_on: spec.depends_on.iter().map(|dependency| dependency.on.clone()).collect(),
            kind: spec.monitor.kind(),
            class: spec.monitor.class(),
            of_component: spec.monitor.is_of_component(),
            quantity: spec.monitor.other().and_then(|it| Quantity::measured_by(it, &model.watched)),
            reads: spec.monitor.other().and_then(|it| it.reads(&model.watched)).map(Box::new),
            ..self_reporting(spec.id.clone(), spec.group)
        }));
    }
    let system = GroupId(groups.len() as u32 - 1);
    for check in SystemCheck::ALL {
        groups[system.0 as usize].modules.push(ModuleId(modules.len() as u32));
        modules.push(Arc::new(ModuleInfo {
            name: Some(Wording::name(check.name()).into()),
            // A machine without stages is not driven: the page has general words for it.
            help: (model.stages == StageModel::Shuttle).then(|| check.help().into()),
            ..self_reporting(check.as_str().into(), system)
        }));
    }
    Layout {
        vehicle_id: model.vehicle_id.clone(),
        vehicle_name: model.vehicle_name.clone(),
        display_dpi: model.display_dpi,
        other: model.other,
        stops: model.driving.stops.clone().into(),
        signal_titles: model
            .signals
            .iter()
            .filter_map(|signal| Some((signal.name.clone(), signal.title.clone()?)))
            .collect(),
        groups,
        modules,
    }
}
