//! Vehicles of any size for the benchmarks: groups of a hundred modules, in chains of eight groups
//! that depend on one another.

use std::sync::Arc;

use telltale::engine::Engine;
use telltale::engine::input::{Input, OperatorAction, StatusArray};
use telltale::engine::model::{
    Dependency, DependsOn, GroupId, GroupSpec, Model, ModuleMonitor, ModuleSpec, NodeId, Parts, Policy,
    StageModel, Within,
};
use telltale::engine::text::Text;
use telltale::engine::time::{Span, Timestamp};

pub const MODULES_PER_GROUP: usize = 100;
const GROUPS_PER_CHAIN: usize = 8;

pub fn name(module: usize) -> String {
    format!("/vehicle/component_{:04}: module_{module:06}", module / MODULES_PER_GROUP)
}

pub fn model(modules: usize) -> Arc<Model> {
    let groups = modules.div_ceil(MODULES_PER_GROUP);
    let group = |index: usize| GroupSpec {
        depends_on: if index.is_multiple_of(GROUPS_PER_CHAIN) {
            Vec::new()
        } else {
            let on = DependsOn::Node(NodeId::Group(GroupId(index as u32 - 1)));
            vec![Dependency { on, masks_unknown: false, within: Within::default() }]
        },
        ..GroupSpec::new(&format!("g{index}"), Text::plain(&format!("Group {index}")))
    };
    let module = |index: usize| {
        let group = index / MODULES_PER_GROUP;
        let monitor = ModuleMonitor::SelfState(name(index).into());
        ModuleSpec {
            policy: Policy { timeout: Span::from_secs(3600), ..Policy::default() },
            ..ModuleSpec::new(&format!("g{group}/m{index}"), GroupId(group as u32), monitor)
        }
    };
    let parts = Parts {
        vehicle_name: Text::plain("Bench"),
        groups: (0..groups).map(group).collect(),
        modules: (0..modules).map(module).collect(),
        ..Parts::empty("bench", StageModel::None)
    };
    Arc::new(Model::new(parts).expect("chains have no cycle"))
}

/// An array of these modules at one level, about a hundred bytes a status.
pub fn array(modules: std::ops::Range<usize>, level: u8) -> Input {
    let mut array = StatusArray::default();
    for module in modules {
        let message = if level == 0 { "running as it should" } else { "does not answer" };
        array.push_status(level, &name(module), message, "hardware-7");
        array.push_value("rate_hz", "10.00");
    }
    Input::Diagnostics(array)
}

/// An engine that has heard every module report OK.
pub fn running(modules: usize) -> Engine {
    let mut engine = Engine::new(model(modules), Timestamp::ZERO);
    engine.handle(&Input::Operator(OperatorAction::Login { name: "bench".into() }), Timestamp::ZERO);
    engine.handle(&array(0..modules, 0), Timestamp::ZERO);
    engine.snapshot();
    engine
}
