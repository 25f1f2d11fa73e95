//! What is wrong, in the operator's words: root causes first, then what is only a warning or
//! unknown. The list has the room of the reference display and says what it leaves out.

use askama::Template;

use crate::engine::model::{GroupId, ModuleId, NodeId};
use crate::engine::snapshot::{Reason, RootCause};
use crate::engine::state::State;
use crate::engine::time::Timestamp;

use super::clean::{MESSAGE, clean};
use super::{Fragment, View, html};
use crate::web::text::Words;

/// Height of the list on the reference display in pixels, below its heading and above the last line.
const ROOM: usize = 420;

/// One entry of the list.
struct Entry {
    node: NodeId,
    state: State,
    title: String,
    message: String,
    place: String,
    since: Timestamp,
    waits: String,
    masks: u32,
    help: String,
}

#[derive(Template)]
#[template(path = "partials/causes.html")]
struct CausesHtml {
    words: &'static Words,
    swap: bool,
    entries: Vec<EntryHtml>,
    more: Option<String>,
    /// What to say where the list is empty, and whether that is good news.
    calm: Option<(bool, String)>,
}

struct EntryHtml {
    node: String,
    panel: String,
    state: &'static str,
    icon: &'static str,
    full: bool,
    masks: u32,
    title: String,
    message: String,
    place: String,
    since: String,
    waits: String,
    help: String,
}

pub fn causes(view: &View<'_>) -> Fragment {
    let mut entries: Vec<Entry> = view.snapshot.roots.iter().map(|root| of_root(view, root)).collect();
    lesser(view, &mut entries);
    let shown = fitting(&entries);
    let more = entries.len() - shown;
    let calm = entries.is_empty().then(|| calm(view));
    let entries = entries.into_iter().take(shown).enumerate();
    let html = html(&CausesHtml {
        words: view.words,
        swap: view.swap,
        entries: entries.map(|(index, entry)| of_entry(view, entry, index == 0)).collect(),
        more: (more > 0).then(|| view.lang.and_more(more)),
        calm,
    });
    Fragment { id: "causes".to_owned(), html }
}

fn of_root(view: &View<'_>, root: &RootCause) -> Entry {
    let state = view.snapshot.shown(root.node).0;
    let mut entry = match root.node {
        NodeId::Module(id) => of_module(view, id, state),
        NodeId::Group(id) => of_group(view, id, state, view.words.no_member.to_owned()),
    };
    let own = view.board.tile_of(root.node);
    let waiting = view.board.tiles.iter().enumerate().filter(|&(tile, &id)| {
        let reason = &view.snapshot.group(id).1.reason;
        Some(tile) != own && matches!(reason, Some(Reason::Masked { by }) if by.contains(&root.node))
    });
    entry.waits = match (waiting.count(), root.masks) {
        (0, 0) => String::new(),
        (0, masks) => view.lang.modules_wait(masks as usize),
        (tiles, _) => view.lang.others_wait(tiles),
    };
    Entry { since: root.since, masks: root.masks, ..entry }
}

fn of_module(view: &View<'_>, id: ModuleId, state: State) -> Entry {
    let (_, module) = view.snapshot.module(id);
    let title = view.fault(id, state);
    let message = clean(&module.report.message, MESSAGE);
    let node = NodeId::Module(id);
    Entry {
        node,
        state,
        // Where the message is the title already, or belongs to what was heard before the silence.
        message: if message == title || state == State::Unknown { String::new() } else { message },
        title,
        place: view.tile_name(node),
        since: module.since,
        waits: String::new(),
        masks: 0,
        help: if state == State::Unknown { String::new() } else { view.help(node) },
    }
}

fn of_group(view: &View<'_>, id: GroupId, state: State, message: String) -> Entry {
    let node = NodeId::Group(id);
    Entry {
        node,
        state,
        title: view.group_name(id),
        message,
        place: String::new(),
        since: view.snapshot.group(id).1.since,
        waits: String::new(),
        masks: 0,
        help: String::new(),
    }
}

/// Adds what is visible and not okay without being a root: several of one kind in one component
/// are one entry. A component that shows a fault which nothing inside it explains is one itself.
fn lesser(view: &View<'_>, entries: &mut Vec<Entry>) {
    let roots: Vec<NodeId> = view.snapshot.roots.iter().map(|root| root.node).collect();
    let mut found = Vec::new();
    for (tile, &id) in view.board.tiles.iter().enumerate() {
        let modules = view.modules_of(id);
        for state in [State::Error, State::Unknown, State::Warning] {
            let visible = |&module: &ModuleId| view.snapshot.module(module).1.state == state;
            let of_state: Vec<ModuleId> = modules
                .iter()
                .copied()
                .filter(|module| visible(module) && !roots.contains(&NodeId::Module(*module)))
                .collect();
            match *of_state {
                [] => {}
                [one] => found.push(of_module(view, one, state)),
                _ => {
                    let count = view.lang.modules_in(of_state.len(), state);
                    let since = of_state.iter().map(|&module| view.snapshot.module(module).1.since);
                    let since = since.min().unwrap_or(view.snapshot.now);
                    found.push(Entry { since, ..of_group(view, id, state, count) });
                }
            }
        }
        let (_, group) = view.snapshot.group(id);
        let faulty = !matches!(group.state, State::Ok | State::Ignore);
        let mut said = roots.iter().copied().chain(found.iter().map(|entry| entry.node));
        if faulty && !said.any(|node| view.board.tile_of(node) == Some(tile)) {
            found.push(of_group(view, id, group.state, view.lang.state(group.state).to_owned()));
        }
    }
    found.sort_by_key(|entry| std::cmp::Reverse(entry.state));
    entries.extend(found);
}

/// How many entries have room, by an estimate of their lines. The first always has.
fn fitting(entries: &[Entry]) -> usize {
    let mut height = 0;
    for (index, entry) in entries.iter().enumerate() {
        height += if index == 0 { height_full(entry) } else { 30 + height_brief(entry) };
        if height > ROOM && index > 0 {
            return index;
        }
    }
    entries.len()
}

fn lines(text: &str, letters: usize, most: usize) -> usize {
    text.chars().count().div_ceil(letters).min(most)
}

fn height_full(entry: &Entry) -> usize {
    height_brief(entry)
        + 28 * (lines(&entry.message, 23, 2) + lines(&entry.waits, 23, 2))
        + 36 * lines(&entry.help, 16, 5)
}

fn height_brief(entry: &Entry) -> usize {
    36 * lines(&entry.title, 16, 2) + 28
}

fn of_entry(view: &View<'_>, entry: Entry, full: bool) -> EntryHtml {
    let tile = view.board.tile_of(entry.node).map(|tile| view.board.tiles[tile]);
    let place = if entry.place.is_empty() { entry.message.clone() } else { entry.place };
    EntryHtml {
        node: view.snapshot.node_name(entry.node).to_string(),
        panel: tile.map(|id| view.snapshot.group(id).0.path.to_string()).unwrap_or_default(),
        state: entry.state.as_str(),
        icon: super::node::icon(entry.state, None),
        full,
        masks: entry.masks,
        title: entry.title,
        message: if place == entry.message { String::new() } else { entry.message },
        place,
        since: view.wall(entry.since),
        waits: entry.waits,
        help: entry.help,
    }
}

/// "All okay" is said only where every component that matters shows OK.
fn calm(view: &View<'_>) -> (bool, String) {
    let states = view.board.tiles.iter().map(|&id| view.snapshot.group(id).1.state);
    let active = states.filter(|&state| state == State::Ok).count();
    match active {
        0 => (false, view.words.nothing_diagnosed.to_owned()),
        _ => (true, view.lang.all_okay(active)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_entry_always_has_room_and_the_list_a_bound() {
        let entry = |title: &str, help: &str| Entry {
            node: NodeId::Group(GroupId(0)),
            state: State::Error,
            title: title.to_owned(),
            message: "m".repeat(200),
            place: String::new(),
            since: Timestamp::ZERO,
            waits: "Four others wait".to_owned(),
            masks: 4,
            help: help.to_owned(),
        };
        let long = "w".repeat(120);
        assert_eq!(fitting(&[]), 0);
        assert_eq!(fitting(&[entry(&long, &long)]), 1);
        let many: Vec<Entry> = (0..50).map(|_| entry("short", "")).collect();
        assert!((2..=5).contains(&fitting(&many)), "{}", fitting(&many));
    }
}
