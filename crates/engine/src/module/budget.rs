//! Bounds the bytes of all statuses. Beyond the bound the longest statuses are cut first, so a flood never
//! affects a status of ordinary length. To drop new statuses instead would hide the statuses that came last.

use std::cmp::Reverse;
use std::collections::{BTreeSet, HashMap};

use super::system::{self, SystemCheck};
use crate::Engine;
use crate::discovery::WriterId;
use crate::model::{Limits, ModuleId};

/// Updated with each changed report, at the cost of a few lookups.
#[derive(Debug, Clone, Default)]
pub(crate) struct Budget {
    limit: u64,
    /// The bound for one writer.
    source_limit: u64,
    total: u64,
    /// By [`ModuleId`].
    held: Vec<StoredReport>,
    /// Writers with kept reports: never more than modules.
    sources: HashMap<WriterId, StoredByWriter>,
    /// The number of modules with cut reports.
    cut: usize,
}

#[derive(Debug, Default, Clone, Copy)]
struct StoredReport {
    bytes: u32,
    is_cut: bool,
    source: WriterId,
}

#[derive(Debug, Clone, Default)]
struct StoredByWriter {
    total: u64,
    /// Modules by the number of binary digits of their size: the last is the longest, up to a factor of two.
    by_size: BTreeSet<(u8, Reverse<ModuleId>)>,
}

fn key(id: ModuleId, bytes: u32) -> (u8, Reverse<ModuleId>) {
    ((u32::BITS - bytes.leading_zeros()) as u8, Reverse(id))
}

/// The memory of a module apart from the texts of its report, with its view and what its monitor remembers.
const MODULE_BYTES: usize = 1024;

impl Engine {
    /// About the memory of a copy of this engine that shares no report with others.
    pub fn memory(&self) -> usize {
        let texts = usize::try_from(self.views.budget.total).unwrap_or(usize::MAX);
        texts.saturating_add(self.net.modules.len() * MODULE_BYTES)
    }
}

impl Budget {
    pub(crate) fn new(limits: &Limits) -> Budget {
        let (limit, source_limit) = (limits.status_bytes as u64, limits.source_bytes as u64);
        Budget { limit, source_limit, ..Budget::default() }
    }

    /// Notes the size of a module's report and its writer.
    pub(crate) fn store(&mut self, id: ModuleId, source: WriterId, bytes: usize, is_cut: bool) {
        let index = id.0 as usize;
        if self.held.len() <= index {
            self.held.resize(index + 1, StoredReport::default());
        }
        let bytes = u32::try_from(bytes).unwrap_or(u32::MAX);
        let before = std::mem::replace(&mut self.held[index], StoredReport { bytes, is_cut, source });
        self.cut = self.cut + usize::from(is_cut) - usize::from(before.is_cut);
        self.total = self.total + u64::from(bytes) - u64::from(before.bytes);
        let is_like_before = before.source == source && key(id, before.bytes) == key(id, bytes);
        if is_like_before && bytes > 0 {
            if let Some(of_source) = self.sources.get_mut(&source) {
                of_source.total = of_source.total + u64::from(bytes) - u64::from(before.bytes);
            }
            return;
        }
        if before.bytes > 0
            && let Some(old) = self.sources.get_mut(&before.source)
        {
            old.total -= u64::from(before.bytes);
            old.by_size.remove(&key(id, before.bytes));
            if old.by_size.is_empty() {
                self.sources.remove(&before.source);
            }
        }
        if bytes > 0 {
            let new = self.sources.entry(source).or_default();
            new.total += u64::from(bytes);
            new.by_size.insert(key(id, bytes));
        }
    }

    /// The module to cut, and its new size, after a report by `source`; `None`: everything fits. The caller
    /// asks until then.
    pub(crate) fn over(&self, source: WriterId) -> Option<(ModuleId, usize)> {
        if self.total <= self.limit.min(self.source_limit) {
            return None;
        }
        let own = self.sources.get(&source);
        let beyond_own = own.map_or(0, |own| own.total.saturating_sub(self.source_limit));
        let beyond_all = self.total.saturating_sub(self.limit);
        let (longest, beyond) = if beyond_own > 0 {
            (own.and_then(|own| own.by_size.last()), beyond_own)
        } else if beyond_all > 0 {
            (self.sources.values().filter_map(|it| it.by_size.last()).max(), beyond_all)
        } else {
            return None;
        };
        let &(_, Reverse(id)) = longest?;
        let bytes = u64::from(self.held[id.0 as usize].bytes);
        Some((id, bytes.saturating_sub(beyond).max(bytes / 2) as usize))
    }

    /// The largest size of a module's next report that requires no cut elsewhere; never less than its present
    /// size.
    pub(crate) fn room(&self, id: ModuleId, source: WriterId) -> usize {
        let held = self.held.get(id.0 as usize).copied().unwrap_or_default();
        let of_source = self.sources.get(&source).map_or(0, |it| it.total);
        let same = if held.source == source { u64::from(held.bytes) } else { 0 };
        let own = self.source_limit.saturating_sub(of_source.saturating_sub(same));
        let all = self.limit.saturating_sub(self.total - u64::from(held.bytes));
        usize::try_from(own.min(all)).unwrap_or(usize::MAX)
    }

    pub(crate) fn source(&self, id: ModuleId) -> WriterId {
        self.held.get(id.0 as usize).map(|held| held.source).unwrap_or_default()
    }

    /// The number of modules with cut reports.
    pub(crate) fn cut(&self) -> usize {
        self.cut
    }

    pub(crate) fn total(&self) -> u64 {
        self.total
    }
}

impl Engine {
    /// Reports whether reports are cut. No state depends on it.
    pub(crate) fn say_cut(&mut self) {
        let cut = self.views.budget.cut() > 0;
        if std::mem::replace(&mut self.reports_cut, cut) != cut {
            self.take_fault(SystemCheck::Memory, cut.then(|| system::words_cut(&self.model.limits)));
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const A: WriterId = WriterId([1; 16]);

    fn budget(limit: usize, source_limit: usize) -> Budget {
        Budget::new(&Limits { status_bytes: limit, source_bytes: source_limit, ..Limits::default() })
    }

    /// Stores a report and cuts until everything fits; returns each cut module with its new size.
    fn store(budget: &mut Budget, id: u32, source: WriterId, bytes: usize) -> Vec<(u32, usize)> {
        budget.store(ModuleId(id), source, bytes, false);
        let mut cuts = Vec::new();
        while let Some((id, bytes)) = budget.over(source) {
            budget.store(id, budget.source(id), bytes, true);
            cuts.push((id.0, bytes));
        }
        cuts
    }

    #[test]
    fn the_longest_is_cut_first_and_the_short_ones_never() {
        let mut all = budget(1000, 1000);
        for id in 0..10 {
            assert_eq!(store(&mut all, id, A, 50), []);
        }
        assert_eq!(store(&mut all, 10, A, 700), [(10, 500)]);
        assert_eq!(store(&mut all, 11, A, 300), [(10, 250), (11, 250)]);
        assert_eq!((all.total(), all.cut()), (1000, 2));
        assert_eq!(store(&mut all, 10, A, 20), []);
        assert_eq!((all.total(), all.cut()), (770, 1));
    }

    #[test]
    fn a_source_is_cut_before_it_takes_what_is_for_others() {
        let mut all = budget(1000, 400);
        assert_eq!(store(&mut all, 0, WriterId::default(), 390), []);
        assert_eq!(store(&mut all, 1, A, 300), []);
        assert_eq!(store(&mut all, 2, A, 200), [(1, 200)]);
        assert_eq!((all.room(ModuleId(3), A), all.room(ModuleId(1), A)), (0, 200));
    }

    proptest! {
        #[test]
        fn the_sums_are_those_of_what_is_held(
            steps in proptest::collection::vec((0_u32..20, 0_u8..4, 0_usize..500), 0..200),
        ) {
            let mut all = budget(2000, 900);
            for (id, source, bytes) in steps {
                let source = WriterId([source; 16]);
                store(&mut all, id, source, bytes);
                prop_assert!(all.total <= 2000);
                prop_assert_eq!(all.total, all.held.iter().map(|it| u64::from(it.bytes)).sum::<u64>());
                prop_assert_eq!(all.cut, all.held.iter().filter(|it| it.is_cut).count());
                for (writer, source) in &all.sources {
                    let of = || (0..).map(ModuleId).zip(&all.held).filter(|(_, it)| it.source == *writer && it.bytes > 0);
                    prop_assert_eq!(source.total, of().map(|(_, it)| u64::from(it.bytes)).sum::<u64>());
                    prop_assert!(source.total <= 900);
                    let keys: BTreeSet<_> = of().map(|(id, it)| key(id, it.bytes)).collect();
                    prop_assert_eq!(&source.by_size, &keys);
                }
            }
        }
    }
}
