//! The list of faults: root causes first, then warnings and unknown states, then alarms that are over and
//! wait to be acknowledged. It has the room of the reference display and counts the entries that it leaves
//! out.

use askama::Template;

use crate::engine::state::State;

use super::entries::FaultEntry;
use super::undeclared_statuses;
use crate::web::view::bars::countermeasure;
use crate::web::view::node_names::{ModuleMessage, icon};
use crate::web::view::text::width::{LARGE, LARGE_EM, SMALL, SMALL_EM, lines};
use crate::web::view::text::{ID, address, clean};
use crate::web::view::words::Words;
use crate::web::view::words::action_words::StepWords;
use crate::web::view::{Fragment, View, html};

/// Height of the list on the reference display in pixels. The heading gives way to entries.
const ROOM: usize = 512;
/// What the buttons below the list and the banner of a countermeasure take of it.
const BUTTONS: usize = 88 + GAP;
const BANNER: usize = 92;
const GAP: usize = 12;
/// The height of a line below the list, and its width in letter heights.
const ASIDE: usize = 30;
const ASIDE_EM: f64 = 10.5;
/// Entries on the sheet; more are counted.
const SHEET_MAX: usize = 40;

#[derive(Template)]
#[template(path = "partials/causes.html")]
struct CausesHtml {
    words: &'static Words,
    steps: &'static StepWords,
    swap: bool,
    /// Numbers of the alarms that nobody has acknowledged. The page sounds once for each new one.
    alarms: String,
    last_alarm: u64,
    entries: Vec<EntryHtml>,
    more: Option<usize>,
    /// The text of an empty list, and whether it says that all is okay.
    calm: Option<(bool, String)>,
    /// Undeclared statuses that are not OK.
    aside: Option<String>,
    acknowledge: Option<AcknowledgeHtml>,
}

/// The button below the list: it acknowledges the first entry that is not acknowledged.
struct AcknowledgeHtml {
    /// As a part of an address.
    address: String,
    id: String,
    version: u64,
    title: String,
    /// Whether the button says which entry it acknowledges, because several wait.
    named: bool,
}

struct EntryHtml {
    node: String,
    panel: String,
    state: &'static str,
    icon: &'static str,
    word: &'static str,
    waiting: bool,
    over: bool,
    masks: u32,
    title: String,
    message: ModuleMessage,
    place: String,
    since: String,
    waits: String,
    help: String,
}

pub fn causes(view: &View<'_>, entries: &[FaultEntry]) -> Fragment {
    let acknowledge = acknowledge(view, entries);
    let all_over = entries.iter().all(|entry| entry.over);
    // The banner says that the vehicle is held back, so no text here takes room from alarms that are over.
    let held = !entries.is_empty() && countermeasure::waits_for_release(view);
    let calm = (all_over && !held).then(|| calm(view));
    let banner = if countermeasure::has_banner(view) { BANNER } else { 0 };
    let calm_height = calm.as_ref().map_or(0, |(_, text)| GAP + (LARGE + 1) * lines(text, LARGE_EM, 4));
    let aside = undeclared_statuses::line(view);
    let aside_height = aside.as_ref().map_or(0, |text| GAP + ASIDE * lines(text, ASIDE_EM, 3));
    let room = ROOM - banner - calm_height - aside_height;
    let mut entries = entries.to_vec();
    let mut fits = fitting(&entries, room, acknowledge.is_some());
    // The entry that the button acknowledges is always shown.
    let meant = entries.iter().position(|entry| entry.acknowledge.is_some());
    if let Some(meant) = meant.filter(|&meant| acknowledge.is_some() && meant >= fits.shown.max(2)) {
        entries[1..=meant].rotate_right(1);
        fits = fitting(&entries, room, true);
    }
    let more = entries.len() - fits.shown;
    let entry = |(index, entry)| {
        let html = of_entry(view, entry);
        let behind = if index < fits.behinds { &*entry.behind } else { "" };
        let waits = html.waits + behind;
        let message = if index < fits.messages { html.message } else { ModuleMessage::default() };
        let help = if index < fits.helps { html.help } else { String::new() };
        EntryHtml { waits, message, help, ..html }
    };
    let html = html(&CausesHtml {
        words: view.words,
        steps: view.lang.steps(),
        swap: view.swap,
        alarms: view.snapshot.audible().iter().map(u64::to_string).collect::<Vec<_>>().join(" "),
        last_alarm: view.snapshot.last_alarm,
        entries: entries[..fits.shown].iter().enumerate().map(entry).collect(),
        more: (more > 0).then_some(more),
        calm,
        aside,
        acknowledge,
    });
    Fragment { id: "causes".to_owned(), html }
}

#[derive(Template)]
#[template(path = "partials/all_causes.html")]
struct AllCausesHtml {
    words: &'static Words,
    swap: bool,
    entries: Vec<EntryHtml>,
    more: Option<String>,
}

/// The whole list, for the sheet.
pub fn all_causes(view: &View<'_>, entries: &[FaultEntry]) -> Fragment {
    let more = entries.len().saturating_sub(SHEET_MAX);
    let whole = |entry: &FaultEntry| {
        let html = of_entry(view, entry);
        EntryHtml { waits: html.waits + &entry.behind, ..html }
    };
    let html = html(&AllCausesHtml {
        words: view.words,
        swap: view.swap,
        entries: entries.iter().take(SHEET_MAX).map(whole).collect(),
        more: (more > 0).then(|| view.lang.and_more(more)),
    });
    Fragment { id: "all-causes".to_owned(), html }
}

fn acknowledge(view: &View<'_>, entries: &[FaultEntry]) -> Option<AcknowledgeHtml> {
    view.snapshot.operator.as_ref()?;
    let mut waiting = entries.iter().filter_map(|entry| Some((entry, entry.acknowledge.as_ref()?)));
    let (entry, target) = waiting.next()?;
    Some(AcknowledgeHtml {
        address: address(&target.id),
        id: clean(&target.id, ID),
        version: view.seen.of(target.aspect),
        title: entry.title.clone(),
        named: waiting.next().is_some() || entries.first().is_some_and(|first| first.acknowledge.is_none()),
    })
}

/// How many entries are shown, and how many of these with their help, their masked errors, and their
/// message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Fitting {
    shown: usize,
    helps: usize,
    behinds: usize,
    messages: usize,
}

/// Estimates by lines what has room. The first entry is always shown with its help. Other entries lose
/// their help before one of them is hidden. In the remaining room, masked errors go before messages.
fn fitting(entries: &[FaultEntry], room: usize, button: bool) -> Fitting {
    let (whole, rest) = if button {
        (room.saturating_sub(BUTTONS), room.saturating_sub(BUTTONS))
    } else {
        (room, room.saturating_sub(BUTTONS))
    };
    let height = |count: usize, helps: usize| {
        let (first, rest) = entries[..count].split_at(helps);
        let brief = first.iter().map(|entry| GAP + height_brief(entry)).sum::<usize>();
        brief + rest.iter().map(|entry| GAP + height_bare(entry)).sum::<usize>()
    };
    // The whole list needs no button that counts the rest.
    let room = |count: usize| GAP + if count == entries.len() { whole } else { rest };
    let least = usize::from(!entries.is_empty());
    let all = (least..=entries.len()).rev();
    let helps = all.clone().find(|&count| height(count, count) <= room(count)).unwrap_or(least);
    let shown = all.clone().find(|&count| height(count, helps.min(count)) <= room(count)).unwrap_or(least);
    let mut free = room(shown).saturating_sub(height(shown, helps));
    let mut grown = |more: fn(&FaultEntry) -> usize| {
        let grows = |entry: &&FaultEntry| {
            let more = SMALL * more(entry);
            let fits = more <= free;
            free = free.saturating_sub(more);
            fits
        };
        entries[..shown].iter().take_while(grows).count()
    };
    let behinds = grown(|entry| {
        let both = format!("{}{}", entry.waits, entry.behind);
        lines(&both, SMALL_EM, 3) - lines(&entry.waits, SMALL_EM, 2)
    });
    Fitting { shown, helps, behinds, messages: grown(|entry| lines(&entry.message.estimate(), SMALL_EM, 2)) }
}

fn height_brief(entry: &FaultEntry) -> usize {
    let help = lines(&entry.help, LARGE_EM, 8);
    (height_of_words(entry) + if help > 0 { 8 + LARGE * help } else { 0 }).max(88)
}

fn height_bare(entry: &FaultEntry) -> usize {
    height_of_words(entry).max(88)
}

fn height_of_words(entry: &FaultEntry) -> usize {
    // An icon and how long it lasts share the line.
    let place = lines(&format!("iiii {}, seit 00 i", entry.place), SMALL_EM, 3);
    let waits = lines(&entry.waits, SMALL_EM, 2);
    14 + LARGE * lines(&entry.title, LARGE_EM, 2) + SMALL * (place + waits)
}

fn of_entry(view: &View<'_>, entry: &FaultEntry) -> EntryHtml {
    let tile = view.board.tile_of(entry.node).map(|tile| view.board.tiles[tile]);
    EntryHtml {
        node: clean(view.snapshot.node_name(entry.node), ID),
        panel: tile.map(|id| view.snapshot.group(id).0.path.to_string()).unwrap_or_default(),
        state: entry.state.as_str(),
        icon: if entry.over { "ok" } else { icon(entry.state, None) },
        word: if entry.over { view.lang.steps().over } else { view.lang.state(entry.state) },
        waiting: entry.unacknowledged || entry.over,
        over: entry.over,
        masks: entry.masks,
        title: entry.title.clone(),
        message: entry.message.clone(),
        place: entry.place.clone(),
        since: view.wall(entry.since),
        waits: entry.waits.clone(),
        help: entry.help.clone(),
    }
}

/// "All okay" is said only where every component that matters shows OK.
fn calm(view: &View<'_>) -> (bool, String) {
    if countermeasure::has_banner(view) {
        return (false, view.lang.steps().held_back.to_owned());
    }
    let states = view.board.tiles.iter().map(|&id| view.snapshot.group(id).1.state);
    // An ignored component is not relevant in this stage: with a mask there would be a root cause.
    let active = states.filter(|&state| state == State::Ok).count();
    match active {
        0 => (false, view.words.nothing_diagnosed.to_owned()),
        _ => (true, view.lang.all_okay(active)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::model::{GroupId, NodeId};
    use crate::engine::time::Timestamp;

    fn entry(title: &str, help: &str) -> FaultEntry {
        FaultEntry {
            node: NodeId::Group(GroupId(0)),
            state: State::Error,
            title: title.to_owned(),
            message: ModuleMessage { text: "m".repeat(200), silent: None },
            place: "Localization".to_owned(),
            places: Vec::new(),
            since: Timestamp::ZERO,
            waits: "Four others wait".to_owned(),
            behind: String::new(),
            masks: 4,
            help: help.to_owned(),
            unacknowledged: false,
            over: false,
            acknowledge: None,
        }
    }

    #[test]
    fn the_first_entry_always_has_room_and_the_list_a_bound() {
        let long = "w".repeat(120);
        let shown = |entries: &[FaultEntry], room, button| fitting(entries, room, button).shown;
        assert_eq!(shown(&[], ROOM, false), 0);
        assert_eq!(shown(&[entry(&long, &long)], ROOM, true), 1);
        let two = fitting(&[entry("short", "do"), entry("short", "do")], ROOM, false);
        assert_eq!(two, Fitting { shown: 2, helps: 2, behinds: 2, messages: 2 });
        let many: Vec<FaultEntry> = (0..50).map(|_| entry("short", "")).collect();
        for (room, button) in [(ROOM, false), (ROOM, true), (ROOM - BANNER, true)] {
            assert!((2..=4).contains(&shown(&many, room, button)), "{:?}", fitting(&many, room, button));
        }
    }
}
