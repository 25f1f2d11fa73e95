//! Modules that the configuration implies: the statuses that a filter expects, and the count of a group's modules.

use std::collections::HashMap;

use super::filters::prefixes;
use super::names::Names;
use crate::file;
use crate::file::nodes::COUNT_MAX;
use telltale_engine::model::monitors::MonitorSpec;
use telltale_engine::model::wording::Wording;
use telltale_engine::model::{Expected, GroupId, ModuleMonitor, ModuleSpec, Policy};
use telltale_engine::state::State;
use telltale_engine::text::Text;
use telltale_yaml::{Log, Problem, Span};

/// The name of a module that counts those of its group. No declared module can have it.
const COUNT: &str = "(number of statuses)";

/// Each with its place, in the order of the groups.
pub(crate) fn modules(names: &Names, defaults: &Policy, log: &mut Log) -> Vec<(ModuleSpec, Span)> {
    let mut found = Vec::new();
    for (id, group) in names.groups() {
        let declared = group.raw.modules.iter().filter_map(|module| Some((module.status()?, "a module")));
        let mut seen: HashMap<&str, (Span, &str)> =
            declared.map(|(status, what)| (status.value.as_str(), (status.span, what))).collect();
        for filter in &group.raw.filters {
            for status in &filter.expected {
                if let Some((first, what)) = seen.insert(&status.value, (status.span, "this")) {
                    let text = format!("`{}` is expected in this group already", status.value);
                    let problem = Problem::at(status.span, text).label("again here").also(first, what);
                    log.push(problem.help("name it once"));
                    continue;
                }
                let policy = super::policy(&filter.policy, defaults, &mut Log::default());
                let writers = super::writers(filter.writers.as_ref(), &mut Log::default());
                let module = ModuleSpec {
                    expected: Some(Expected { prefixes: prefixes(filter) }),
                    policy: Policy { writers, ..policy },
                    ..bare(id, &group.path, &status.value)
                };
                found.push((module, status.span));
            }
        }
        found.extend(count(id, &group.path, group.raw, defaults, log));
    }
    found
}

/// A wrong number is given as long as the statuses that may still come: the longest of their timeouts.
fn count(
    id: GroupId,
    path: &str,
    group: &file::Group,
    defaults: &Policy,
    log: &mut Log,
) -> Option<(ModuleSpec, Span)> {
    let wanted = group.count?;
    if !(1..=COUNT_MAX).contains(&wanted.value) {
        let text = format!("{} is not between 1 and {COUNT_MAX}", wanted.value);
        log.push(Problem::at(wanted.span, text).help("write `empty: ok` where there need be none"));
    }
    let timeout =
        |filter: &file::Filter| super::policy(&filter.policy, defaults, &mut Log::default()).timeout;
    let grace = group.filters.iter().map(timeout).max().unwrap_or(defaults.timeout);
    let may_be_empty = group.empty == Some(State::Ok);
    let name = Text { en: "Number of statuses".into(), de: "Anzahl der Status".into() };
    let module = ModuleSpec {
        name: Some(Wording::name(name).into()),
        policy: defaults.clone(),
        monitor: MonitorSpec::Count { wanted: wanted.value as u32, may_be_empty, grace }.into(),
        ..bare(id, path, COUNT)
    };
    Some((module, wanted.span))
}

fn bare(group: GroupId, path: &str, status: &str) -> ModuleSpec {
    ModuleSpec::new(&format!("{path}/{status}"), group, ModuleMonitor::SelfState(status.into()))
}
