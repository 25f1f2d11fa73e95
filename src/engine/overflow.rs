//! Statuses of new names past the limit: counted for the group that would have had them.

use std::collections::HashMap;

use super::model::{GroupId, ModuleId, Text};
use super::monitor::say;

/// The name of the module that says so.
pub(super) const MODULE: &str = "(names past the limit)";

/// At most one entry for each group.
#[derive(Debug, Default)]
pub(super) struct Overflow {
    groups: HashMap<GroupId, (ModuleId, u64)>,
}

impl Overflow {
    /// The module that speaks for the group, if it was made.
    pub(super) fn module(&self, group: GroupId) -> Option<ModuleId> {
        self.groups.get(&group).map(|(module, _)| *module)
    }

    /// Counts one more; returns what the module says now.
    pub(super) fn count(&mut self, group: GroupId, module: ModuleId, limit: usize) -> Text {
        let (_, count) = self.groups.entry(group).or_insert((module, 0));
        *count += 1;
        say!(
            "{count} statuses with new names dropped: limits.discovered_modules is {limit}",
            "{count} Status mit neuen Namen verworfen: limits.discovered_modules ist {limit}",
            count = count.to_string(),
            limit = limit.to_string()
        )
    }
}
