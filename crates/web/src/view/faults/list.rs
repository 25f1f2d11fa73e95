//! The list of faults: root causes first, then warnings and unknown states, then alarms that are over and
//! wait to be acknowledged. The page's script hides the entries that have no room, and counts them.

use askama::Template;

use telltale_engine::model::Stage;
use telltale_engine::snapshot::Moving;
use telltale_engine::state::State;

use super::entries::FaultEntry;
use super::{instruction, undeclared_statuses};
use crate::texts::{ID, NAME, Words, address, clean};
use crate::view::node_names::{ModuleMessage, icon};
use crate::view::{Fragment, View, html, requests};

/// Entries on the page; more than a window has room for.
const LIST_MAX: usize = 12;
/// Entries on the sheet; more are counted.
const SHEET_MAX: usize = 40;

#[derive(Template)]
#[template(path = "partials/causes.html")]
struct CausesHtml {
    words: &'static Words,
    swap: bool,
    replay: bool,
    /// Numbers of the alarms that nobody has acknowledged. The page sounds once for each new one.
    alarms: String,
    last_alarm: u64,
    /// The number of all entries.
    count: usize,
    entries: Vec<EntryHtml>,
    /// The text of an empty list, and whether it says that all is OK.
    calm: Option<(bool, String)>,
    /// Undeclared statuses that are not OK.
    aside: Option<String>,
    /// How many alarms are over and not acknowledged, with the highest number among them, if there are several.
    over: Option<(usize, u64)>,
}

struct EntryHtml {
    node: String,
    panel: String,
    state: &'static str,
    icon: &'static str,
    word: &'static str,
    waiting: bool,
    over: bool,
    second: bool,
    masks: u32,
    title: String,
    message: ModuleMessage,
    place: String,
    since: String,
    /// `was there for 9 s`, of a fault that is over.
    lasted: String,
    waits: String,
    help: String,
    /// The advice goes on where the instruction ends, so it gives way to nothing.
    rest: bool,
    /// Until when it is shelved, and who has done that.
    shelved: Option<(String, String)>,
    acknowledge: Option<AcknowledgeHtml>,
    /// Acknowledged: the time of day as RFC 3339, if it is known.
    seen: Option<Option<String>>,
}

struct AcknowledgeHtml {
    /// As a part of an address.
    address: String,
    id: String,
    version: u64,
}

pub fn causes(view: &View<'_>, entries: &[FaultEntry]) -> Fragment {
    let all_over = entries.iter().all(|entry| entry.over);
    // The instruction says that the vehicle is held, so no text here takes room from alarms that are over.
    let held = !entries.is_empty() && requests::waits_for_release(view);
    let told = instruction::told(view, entries);
    let entry = |entry: &FaultEntry| {
        let html = of_entry(view, entry);
        let (help, rest) = told.left_for(entry, html.help);
        EntryHtml { help, rest, ..html }
    };
    let html = html(&CausesHtml {
        words: view.words,
        swap: view.swap,
        replay: view.replay,
        alarms: view.snapshot.audible().iter().map(u64::to_string).collect::<Vec<_>>().join(" "),
        last_alarm: view.snapshot.last_alarm,
        count: entries.len(),
        entries: entries.iter().take(LIST_MAX).map(entry).collect(),
        calm: (all_over && !held).then(|| calm(view)),
        aside: undeclared_statuses::line(view),
        over: over(view, entries),
    });
    Fragment { id: "causes".to_owned(), html }
}

/// The alarms that one tap acknowledges: those that are over.
fn over(view: &View<'_>, entries: &[FaultEntry]) -> Option<(usize, u64)> {
    if !view.may_act() {
        return None;
    }
    let over = view.snapshot.alarms.iter().filter(|alarm| !alarm.active && !alarm.acknowledged);
    let last = over.map(|alarm| alarm.id).max()?;
    // As many as the list has: of one module that came and went there may be several.
    let count = entries.iter().filter(|entry| entry.over).count();
    (count > 1).then_some((count, last))
}

#[derive(Template)]
#[template(path = "partials/all_causes.html")]
struct AllCausesHtml {
    words: &'static Words,
    swap: bool,
    replay: bool,
    entries: Vec<EntryHtml>,
    more: Option<String>,
}

/// The whole list, for the sheet.
pub fn all_causes(view: &View<'_>, entries: &[FaultEntry]) -> Fragment {
    let more = entries.len().saturating_sub(SHEET_MAX);
    let html = html(&AllCausesHtml {
        words: view.words,
        swap: view.swap,
        replay: view.replay,
        entries: entries.iter().take(SHEET_MAX).map(|entry| of_entry(view, entry)).collect(),
        more: (more > 0).then(|| view.lang.and_more_faults(more)),
    });
    Fragment { id: "all-causes".to_owned(), html }
}

/// While the vehicle is slowed down or stopped, the advice on a WARNING, such as that one may go on, would
/// contradict that.
fn is_overruled(view: &View<'_>, entry: &FaultEntry) -> bool {
    let drives = matches!(view.stage_of_advice(), Stage::Cleared | Stage::Active);
    let stops = requests::has_banner(view) && (drives || view.snapshot.motion.moving != Moving::No);
    stops && entry.state == State::Warning
}

fn of_entry(view: &View<'_>, entry: &FaultEntry) -> EntryHtml {
    let tile = view.board.tile_of(entry.node).map(|tile| view.board.tiles[tile]);
    let target = entry.acknowledge.as_ref().filter(|_| view.may_act());
    EntryHtml {
        node: clean(view.snapshot.node_name(entry.node), ID),
        panel: tile.map(|id| view.snapshot.group(id).0.path.to_string()).unwrap_or_default(),
        state: entry.state.as_str(),
        icon: if entry.over { "ok" } else { icon(entry.state, None) },
        word: if entry.over { view.words.over } else { view.lang.state(entry.state) },
        waiting: entry.unacknowledged || entry.over,
        over: entry.over,
        second: entry.second && !entry.over,
        masks: entry.masks,
        title: entry.title.clone(),
        message: entry.message.clone(),
        place: entry.place.clone(),
        since: view.wall(entry.since),
        lasted: entry.lasted.map(|lasted| view.lang.lasted(lasted)).unwrap_or_default(),
        waits: entry.waits.clone(),
        shelved: entry
            .shelved
            .as_ref()
            .map(|it| (view.wall(it.until), view.lang.shelved_by(&clean(&it.by, NAME)))),
        help: if is_overruled(view, entry) { String::new() } else { entry.help.clone() },
        rest: false,
        acknowledge: target.map(|target| AcknowledgeHtml {
            address: address(&target.id),
            id: clean(&target.id, ID),
            version: view.seen.of(target.aspect),
        }),
        seen: entry.seen.map(|at| at.map(|at| view.wall(at))),
    }
}

/// "All OK" is said only where every component that matters shows OK.
fn calm(view: &View<'_>) -> (bool, String) {
    if requests::has_banner(view) && !requests::waits_for_release(view) {
        return (false, view.words.held_back.to_owned());
    }
    let states = view.board.tiles.iter().map(|&id| view.snapshot.group(id).1.state);
    // An ignored component is not relevant in this stage: with a mask there would be a root cause.
    let active = states.filter(|&state| state == State::Ok).count();
    match active {
        0 => (false, view.words.nothing_diagnosed.to_owned()),
        _ => (true, view.lang.all_ok(active, active == view.board.tiles.len())),
    }
}
