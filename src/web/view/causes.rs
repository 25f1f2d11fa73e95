//! What is wrong, in the operator's words: root causes first, then what is only a warning or
//! unknown. The list has the room of the reference display and says what it leaves out.

use askama::Template;

use crate::engine::model::{GroupId, ModuleId, NodeId};
use crate::engine::snapshot::{Reason, RootCause};
use crate::engine::state::State;
use crate::engine::time::Timestamp;

use super::clean::{ID, MESSAGE, clean};
use super::{Fragment, View, html};
use crate::web::text::Words;

/// Height of the list on the reference display in pixels, below its heading.
const ROOM: usize = 472;
const GAP: usize = 12;
/// Heights of lines, and how many letters' heights a line is wide.
const LARGE: usize = 36;
const SMALL: usize = 29;
const LARGE_EM: f64 = 9.9;
const SMALL_EM: f64 = 13.2;
const SPACE_EM: f64 = 0.26;

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
    word: &'static str,
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
    let (shown, full) = fitting(&entries);
    let more = entries.len() - shown;
    let calm = entries.is_empty().then(|| calm(view));
    let entries = entries.into_iter().take(shown).enumerate();
    let html = html(&CausesHtml {
        words: view.words,
        swap: view.swap,
        entries: entries.map(|(index, entry)| of_entry(view, entry, index < full)).collect(),
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
    let (info, module) = view.snapshot.module(id);
    let title = view.fault(id, state);
    let message = clean(&module.report.message, MESSAGE);
    let node = NodeId::Module(id);
    Entry {
        node,
        state,
        // Where the message is the title already, or belongs to what was heard before the silence.
        message: if message == title || state == State::Unknown { String::new() } else { message },
        title,
        // The title of what is unknown names the component already.
        place: if state == State::Unknown { view.label(info) } else { view.tile_name(node) },
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
    for id in view.watched() {
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
                    let count = view.lang.times(of_state.len(), state);
                    let since = of_state.iter().map(|&module| view.snapshot.module(module).1.since);
                    let since = since.min().unwrap_or(view.snapshot.now);
                    found.push(Entry { since, ..of_group(view, id, state, count) });
                }
            }
        }
        let (_, group) = view.snapshot.group(id);
        let faulty = !matches!(group.state, State::Ok | State::Ignore);
        let mut said = roots.iter().copied().chain(found.iter().map(|entry| entry.node));
        let tile = view.board.tile_of(NodeId::Group(id));
        if faulty && !said.any(|node| node == NodeId::Group(id) || view.board.tile_of(node) == tile) {
            found.push(of_group(view, id, group.state, view.lang.state(group.state).to_owned()));
        }
    }
    found.sort_by_key(|entry| std::cmp::Reverse(entry.state));
    entries.extend(found);
}

/// How many entries have room, and how many of them with all their words, by an estimate of their
/// lines. The first always has.
fn fitting(entries: &[Entry]) -> (usize, usize) {
    let shown = shown(entries);
    let mut free = ROOM.saturating_sub(entries[..shown].iter().map(|entry| GAP + height_brief(entry)).sum());
    if shown < entries.len() {
        free = free.saturating_sub(SMALL);
    }
    let grows = |entry: &&Entry| {
        let more = height_full(entry) - height_brief(entry);
        let fits = more <= free;
        free = free.saturating_sub(more);
        fits
    };
    let full = entries[..shown].iter().take_while(grows).count();
    (shown, full.max(1))
}

fn shown(entries: &[Entry]) -> usize {
    let mut height = 0;
    for (index, entry) in entries.iter().enumerate() {
        height += if index == 0 { height_full(entry) } else { GAP + height_brief(entry) };
        // The last entry needs no line that counts the rest.
        let room = if index + 1 == entries.len() { ROOM } else { ROOM - GAP - SMALL };
        if height > room && index > 0 {
            return index;
        }
    }
    entries.len()
}

fn height_full(entry: &Entry) -> usize {
    let small = lines(&entry.message, SMALL_EM, 2) + lines(&entry.waits, SMALL_EM, 2);
    height_brief(entry) + SMALL * small + 6 + LARGE * lines(&entry.help, LARGE_EM, 8)
}

fn height_brief(entry: &Entry) -> usize {
    let place = if entry.place.is_empty() { &entry.message } else { &entry.place };
    // An icon and how long it lasts share the line.
    let place = lines(&format!("iiii {place}, seit 00 i"), SMALL_EM, 3);
    (14 + LARGE * lines(&entry.title, LARGE_EM, 2) + SMALL * place).max(88)
}

/// How many lines a text takes where one is `em` wide: broken at words, in an average sans serif.
fn lines(text: &str, em: f64, most: usize) -> usize {
    let (mut lines, mut used) = (0, em);
    for word in text.split_whitespace() {
        let width: f64 = word.chars().map(width).sum();
        if lines == 0 || used + SPACE_EM + width > em {
            // A word longer than a line is broken wherever the line ends.
            lines += (width / em).ceil().max(1.0) as usize;
            used = width % em;
        } else {
            used += SPACE_EM + width;
        }
    }
    lines.min(most)
}

fn width(letter: char) -> f64 {
    match letter {
        'i' | 'j' | 'l' | 'I' | '.' | ',' | ':' | '\'' | '|' | '!' => 0.29,
        'f' | 'r' | 't' | '(' | ')' | '-' | '/' => 0.4,
        'm' | 'w' | 'M' | 'W' => 0.88,
        _ if letter.is_ascii_lowercase() || letter.is_ascii_digit() => 0.58,
        _ if letter.is_ascii() => 0.68,
        _ if letter.is_lowercase() => 0.6,
        _ => 1.0,
    }
}

fn of_entry(view: &View<'_>, entry: Entry, full: bool) -> EntryHtml {
    let tile = view.board.tile_of(entry.node).map(|tile| view.board.tiles[tile]);
    let place = if entry.place.is_empty() { entry.message.clone() } else { entry.place };
    EntryHtml {
        node: clean(view.snapshot.node_name(entry.node), ID),
        panel: tile.map(|id| view.snapshot.group(id).0.path.to_string()).unwrap_or_default(),
        state: entry.state.as_str(),
        icon: super::node::icon(entry.state, None),
        word: view.lang.state(entry.state),
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
    // Whoever is ignored was put aside by the stage: with a mask there would be a root cause.
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
            place: "Localization".to_owned(),
            since: Timestamp::ZERO,
            waits: "Four others wait".to_owned(),
            masks: 4,
            help: help.to_owned(),
        };
        let long = "w".repeat(120);
        assert_eq!(fitting(&[]), (0, 1));
        assert_eq!(fitting(&[entry(&long, &long)]), (1, 1));
        assert_eq!(fitting(&[entry("short", "do"), entry("short", "do")]), (2, 2));
        let many: Vec<Entry> = (0..50).map(|_| entry("short", "")).collect();
        assert!(matches!(fitting(&many), (2..=5, 1)), "{:?}", fitting(&many));
    }

    #[test]
    fn lines_are_estimated_as_a_browser_breaks_them() {
        for (text, expect) in [
            ("", 0),
            ("LiDAR data missing", 1),
            ("Position ist gesprungen", 2),
            ("Keine Verbindung zum Fahrzeug", 2),
            ("Am nächsten sicheren Ort anhalten. Leitstelle rufen.", 4),
        ] {
            assert_eq!(lines(text, LARGE_EM, 9), expect, "{text}");
        }
        assert_eq!(lines(&"w".repeat(500), LARGE_EM, 2), 2);
    }
}
