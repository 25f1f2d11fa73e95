//! The list of the last alarms: what each was, when, for how long, and whether somebody has acknowledged it.

use askama::Template;

use super::entries;
use crate::texts::{NAME, Words, clean};
use crate::view::node_names::icon;
use crate::view::{View, html};
use telltale_clock::of_unix_ms;
use telltale_engine::model::NodeId;
use telltale_engine::state::State;
use telltale_engine::time::Span;
use telltale_store::PastAlarm;

#[derive(Template)]
#[template(path = "partials/last_alarms.html")]
struct LastAlarmsHtml {
    words: &'static Words,
    alarms: Vec<AlarmHtml>,
}

struct AlarmHtml {
    at: String,
    /// The component whose panel its row opens; empty if it has none.
    panel: String,
    state: &'static str,
    icon: &'static str,
    title: String,
    place: String,
    /// `lasted 9 s`; empty while it lasts.
    lasted: String,
    seen: Option<String>,
}

pub fn last_alarms(view: &View<'_>, alarms: &[PastAlarm]) -> String {
    let alarms = alarms.iter().map(|alarm| of_alarm(view, alarm)).collect();
    html(&LastAlarmsHtml { words: view.words, alarms })
}

/// The title of a fault that a node had, and its place.
pub fn past_fault(view: &View<'_>, node: &str, state: State) -> (String, String) {
    match view.snapshot.node(node) {
        Some(NodeId::Module(id)) => {
            let component = view.tile_name(NodeId::Module(id));
            entries::titled(view, id, state, &component)
        }
        Some(NodeId::Group(id)) => (view.group_name(id), String::new()),
        // It left, or another configuration has it no more.
        None => (clean(node, NAME), String::new()),
    }
}

fn of_alarm(view: &View<'_>, alarm: &PastAlarm) -> AlarmHtml {
    let (title, place) = past_fault(view, &alarm.node, alarm.state);
    let lasted = alarm.cleared_ms.map(|cleared_ms| {
        let ms = u64::try_from(cleared_ms - alarm.raised_ms).unwrap_or(0);
        view.lang.lasted(Span::from_millis(ms))
    });
    let tile = view.snapshot.node(&alarm.node).and_then(|node| view.board.tile_of(node));
    let panel = tile.map(|tile| view.snapshot.group(view.board.tiles[tile]).0.path.to_string());
    AlarmHtml {
        at: wall(alarm.raised_ms),
        panel: panel.unwrap_or_default(),
        state: alarm.state.as_str(),
        icon: icon(alarm.state, None),
        title,
        place,
        lasted: lasted.unwrap_or_default(),
        seen: alarm.acknowledged_ms.map(wall),
    }
}

fn wall(ms: i64) -> String {
    humantime::format_rfc3339_seconds(of_unix_ms(ms)).to_string()
}
