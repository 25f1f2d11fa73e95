//! Statuses outside the configuration: one quiet line, unless they have a tile.

use telltale_engine::model::{ModuleId, Other};
use telltale_engine::state::State;

use crate::view::{Lang, View};

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
    Some(words(view.lang, state, count))
}

fn words(lang: Lang, state: State, count: usize) -> String {
    let what = match (lang, state, count) {
        (Lang::En, State::Error, 1) => "error",
        (Lang::En, State::Error, _) => "errors",
        (Lang::En, State::Warning, 1) => "warning",
        (Lang::En, State::Warning, _) => "warnings",
        (Lang::En, ..) => "unknown",
        (Lang::De, State::Error, _) => "Fehler",
        (Lang::De, State::Warning, 1) => "Warnung",
        (Lang::De, State::Warning, _) => "Warnungen",
        (Lang::De, ..) => "unbekannt",
    };
    match lang {
        Lang::En => format!("{count} {what} outside of the configuration"),
        Lang::De => format!("{count} {what} außerhalb der Konfiguration"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_counted_as_people_speak() {
        let said = |lang, state, count| words(lang, state, count);
        assert_eq!(said(Lang::En, State::Error, 1), "1 error outside of the configuration");
        assert_eq!(said(Lang::En, State::Warning, 2), "2 warnings outside of the configuration");
        assert_eq!(said(Lang::De, State::Error, 3), "3 Fehler außerhalb der Konfiguration");
        assert_eq!(said(Lang::De, State::Unknown, 1), "1 unbekannt außerhalb der Konfiguration");
    }
}
