//! Statuses outside the configuration: one quiet line, unless they have a tile.

use telltale_engine::model::{ModuleId, Other};
use telltale_engine::state::State;

use crate::view::View;

/// How many of them are not OK, by the worst state among them; nothing where all are.
pub(super) fn line(view: &View<'_>) -> Option<String> {
    let layout = &view.snapshot.layout;
    let group = layout.groups.iter().find(|group| group.is_other && layout.other == Other::Shown)?;
    let states = group.modules.iter().map(|&ModuleId(id)| view.snapshot.modules[id as usize].state);
    let mut counts = [0; 3];
    const WORST_FIRST: [State; 3] = [State::Error, State::Unknown, State::Warning];
    for state in states {
        if let Some(index) = WORST_FIRST.iter().position(|&bad| bad == state) {
            counts[index] += 1;
        }
    }
    let (state, count) = WORST_FIRST.into_iter().zip(counts).find(|(_, count)| *count > 0)?;
    Some(view.lang.undeclared(state, count))
}
