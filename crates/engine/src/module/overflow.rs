//! Statuses with new names beyond the limit, counted for the group that claims them.

use crate::files::pairs;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

use super::names::NAME_BYTES;
use crate::model::{GroupId, ModuleId};
use crate::text::Text;
use crate::text::say;

/// The name of the module that reports them.
pub(crate) const MODULE: &str = "(names past the limit)";

/// At most one entry for each group.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Overflow {
    #[serde(with = "pairs")]
    groups: BTreeMap<GroupId, (ModuleId, u64)>,
}

impl Overflow {
    /// The module that reports dropped names in the group, if there is one.
    pub(crate) fn module(&self, group: GroupId) -> Option<ModuleId> {
        self.groups.get(&group).map(|(module, _)| *module)
    }

    /// Continues a count from before a reload.
    pub(crate) fn keep(&mut self, group: GroupId, module: ModuleId, count: u64) {
        self.groups.insert(group, (module, count));
    }

    /// Each group with its module and its number of dropped names.
    pub(crate) fn groups(&self) -> impl Iterator<Item = (GroupId, ModuleId, u64)> {
        self.groups.iter().map(|(group, (module, count))| (*group, *module, *count))
    }

    /// Counts one more; returns the new message.
    pub(crate) fn count(&mut self, group: GroupId, module: ModuleId, limit: usize, too_long: bool) -> Text {
        let (_, count) = self.groups.entry(group).or_insert((module, 0));
        *count = count.saturating_add(1);
        if too_long {
            return say!(
                "statuses with new names dropped: {count}; names are too long, limits.discovered_modules of {limit} allows {bytes} bytes for each",
                "Status mit neuen Namen verworfen: {count}; die Namen sind zu lang, limits.discovered_modules von {limit} lässt jedem {bytes} Byte",
                count,
                limit,
                bytes = NAME_BYTES
            );
        }
        if *count == 1 {
            return say!(
                "1 status with a new name dropped: limits.discovered_modules is {limit}",
                "1 Status mit neuem Namen verworfen: limits.discovered_modules ist {limit}",
                limit
            );
        }
        say!(
            "{count} statuses with new names dropped: limits.discovered_modules is {limit}",
            "{count} Status mit neuen Namen verworfen: limits.discovered_modules ist {limit}",
            count,
            limit
        )
    }
}
