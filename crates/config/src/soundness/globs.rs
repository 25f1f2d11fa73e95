//! Finds shell patterns in places for a name: in the status of a module or a signal, and in a filter without
//! `regex`, every character stands for itself.

use super::{Finding, FindingKind};
use crate::glob::{as_regex, is_glob};
use telltale_engine::model::filter::Filter;
use telltale_engine::model::{GroupId, Model, ModuleId, MonitorSpec, NodeId};

pub(super) fn look(model: &Model) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut find = |node, signal, text: &str, regex: Option<String>| {
        let what = FindingKind::Glob { signal, text: text.into(), regex };
        found.push(Finding { node, what, example: None });
    };
    for (group, id) in model.groups.iter().zip((0..).map(GroupId)) {
        for filter in &group.filters {
            let (text, regex) = match &filter.filter {
                Filter::Name(text) => (text, as_regex(text)),
                Filter::Namespace(text) => (text, format!("{}(?:[/:].*)?", as_regex(text))),
                Filter::Contains(text) => (text, format!(".*{}.*", as_regex(text))),
                Filter::Regex(_) => continue,
            };
            if is_glob(text) {
                find(NodeId::Group(id), None, text, Some(regex));
            }
        }
    }
    for (module, id) in model.modules.iter().zip((0..).map(ModuleId)) {
        for text in module.monitor.statuses().filter(|text| is_glob(text)) {
            find(NodeId::Module(id), None, &text, None);
        }
    }
    for (index, signal) in model.signals.iter().enumerate() {
        let texts = signal.source.condition().map(MonitorSpec::keyed_statuses).unwrap_or_default();
        for text in texts.iter().filter(|text| is_glob(text)) {
            find(NodeId::Group(GroupId(0)), Some(index), text, None);
        }
    }
    found
}
