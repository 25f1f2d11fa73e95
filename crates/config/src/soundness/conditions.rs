//! Finds `expression` conditions that are constant, inputs that no condition uses, and classes that the paper's table does not have.

use super::{Finding, FindingKind};
use crate::expression;
use telltale_engine::model::{Model, ModuleId, MonitorSpec, NodeId};

pub(super) fn look(model: &Model) -> Vec<Finding> {
    let mut found = Vec::new();
    for (module, id) in model.modules.iter().zip((0..).map(ModuleId)) {
        let node = NodeId::Module(id);
        let mut find = |what| found.push(Finding { node, what, example: None });
        let class = module.monitor.class();
        if class.column().is_none() {
            find(FindingKind::NoColumn { flow: class.flow.is_some() });
        }
        let Some(MonitorSpec::Expression { inputs, warning, error, .. }) = module.monitor.other() else {
            continue;
        };
        let mut used = Vec::new();
        for condition in [error, warning].into_iter().flatten() {
            let named = expression::named(condition);
            // A condition without an answer is refused earlier.
            if named.is_empty()
                && let Ok(holds) = condition.holds(&[])
            {
                find(FindingKind::Constant { text: (&*condition.text).into(), holds });
            }
            used.extend(named);
        }
        let unused =
            inputs.iter().map(|(name, _)| name).filter(|name| !used.iter().any(|it| **it == ***name));
        unused.for_each(|name| find(FindingKind::UnusedInput { input: (&**name).into() }));
    }
    found
}
