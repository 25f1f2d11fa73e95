//! The overview: all vehicles, the worst first, as a page and as the fragment that its script asks for each second.

use askama::Template;
use axum::extract::State;
use axum::response::{Html, IntoResponse, Redirect, Response};
use telltale_clock::unix_ms;
use telltale_web::common::{PageFrame, Reader, SignedIn};
use telltale_web::texts::console::ConsoleWords;
use telltale_web::texts::{HttpError, Lang, Words};

use super::Console;
use super::row::{RowHtml, shown};
use crate::state::counts;

#[derive(Template)]
#[template(path = "console/overview.html")]
struct OverviewHtml {
    frame: PageFrame,
    words: &'static ConsoleWords,
    user: String,
    frame_id: String,
    hub_down: bool,
    counts: Vec<(&'static str, usize, &'static str)>,
    off: Option<String>,
    rows: Vec<RowHtml>,
}

#[derive(Template)]
#[template(path = "console/fleet.html")]
struct FleetHtml {
    words: &'static ConsoleWords,
    frame_id: String,
    hub_down: bool,
    counts: Vec<(&'static str, usize, &'static str)>,
    off: Option<String>,
    rows: Vec<RowHtml>,
}

/// `GET /`
pub async fn get(
    State(console): State<Console>,
    signed_in: Result<SignedIn, HttpError>,
    reader: Reader,
) -> Response {
    let Ok(SignedIn(session)) = signed_in else { return Redirect::to("/login").into_response() };
    let FleetHtml { words, frame_id, hub_down, counts, off, rows } = fleet(&console, reader.lang);
    let frame = PageFrame::new(reader.lang, reader.palette);
    let user = session.user.to_string();
    rendered(&OverviewHtml { frame, words, user, frame_id, hub_down, counts, off, rows })
}

/// `GET /overview`: the part of the page that changes.
pub async fn overview(State(console): State<Console>, _: SignedIn, reader: Reader) -> Response {
    rendered(&fleet(&console, reader.lang))
}

pub fn rendered(page: &impl Template) -> Response {
    match page.render() {
        Ok(page) => Html(page).into_response(),
        Err(_) => HttpError::Unavailable.into_response(),
    }
}

fn fleet(console: &Console, lang: Lang) -> FleetHtml {
    let now_ms = unix_ms(console.clock.wall());
    let (rows, hub_down) = {
        let fleet = console.shared.fleet();
        (fleet.rows(console.clock.now()), fleet.line().up_since.is_none())
    };
    let (words, states) = (ConsoleWords::of(lang), Words::of(lang));
    let all = counts(&rows);
    let counts = vec![
        ("error", all.error, states.error),
        ("warning", all.warning, states.warning),
        ("ok", all.ok, states.ok),
        ("lost", all.lost, words.lost_contact),
        ("never", all.never_heard, words.never_heard),
    ];
    FleetHtml {
        words,
        // Another program has other words and other files.
        frame_id: telltale_web::assets::url(lang.as_str()),
        hub_down,
        counts,
        off: (all.off > 0).then(|| lang.off_count(all.off)),
        rows: rows.iter().map(|row| shown(row, lang, now_ms)).collect(),
    }
}
