//! The operator's page.

use askama::Template;

use super::frame::PageFrame;
use super::login::{LoginContext, login_page};
use super::{PageContext, RecorderState};
use crate::texts::{Lang, NAME, Words, clean};
use crate::view::bars::top_bar;
use crate::view::versions::Seen;
use crate::view::{Fragment, Parts, Trends, View, html};
use telltale_runtime::Published;
use telltale_store::Role;

/// A word by language.
type InBoth = [(&'static str, &'static str); Lang::ALL.len()];

#[derive(Template)]
#[template(path = "operator.html")]
struct OperatorHtml {
    frame: PageFrame,
    stage: &'static str,
    /// Somebody can take over.
    stages: bool,
    layout: String,
    columns: usize,
    rows: usize,
    demo: bool,
    developer: bool,
    replay: bool,
    /// The state of the recorder; `None` without one.
    recorder: Option<&'static str>,
    /// The reader may mark a moment in the recording.
    marks: bool,
    motion: String,
    top: String,
    arrows: String,
    tiles: Vec<String>,
    instruction: String,
    causes: String,
    step: String,
    /// The sheets that a button opens over the board: name, title in both languages, content.
    sheets: [(&'static str, InBoth, String); 3],
    user: String,
    role: &'static str,
    /// The path of each tile with the panel behind it.
    panels: Vec<(String, String)>,
}

/// The operator's screen. In the stage `locked` it is the login: nothing of the vehicle shows.
pub fn operator_page(published: &Published, seen: &Seen, context: &PageContext, trends: &Trends) -> String {
    let dpi = published.snapshot.layout.display_dpi;
    if published.is_locked() {
        return login_page(&LoginContext::new(context.lang, context.palette, dpi, context.demo));
    }
    let view = View { seen: seen.clone(), trends: Some(trends), ..View::new(published, context.lang, false) };
    let parts = Parts::of(&view);
    let paths = view.board.tiles.iter().map(|&id| view.snapshot.group(id).0.path.to_string());
    let text = |fragment: Fragment| fragment.html;
    html(&OperatorHtml {
        frame: PageFrame::new(context.lang, context.palette).of_display(dpi),
        stage: published.snapshot.stage.as_str(),
        stages: view.has_stages(),
        layout: top_bar::layout_mark(&view),
        columns: view.board.columns,
        rows: view.board.rows,
        demo: context.demo,
        developer: context.role != Role::Operator && !context.replay,
        replay: context.replay,
        recorder: context.recorder.map(RecorderState::as_str),
        marks: context.recorder.is_some() && context.role != Role::Authority,
        motion: parts.motion.html,
        top: parts.top.html,
        arrows: parts.arrows.html,
        tiles: parts.tiles.into_iter().map(text).collect(),
        instruction: parts.instruction.html,
        causes: parts.causes.html,
        step: parts.step.html,
        sheets: [
            ("stops", titles(|words| words.where_is_it), parts.stops.html),
            ("checks", titles(|words| words.all_checks), parts.checks.html),
            ("causes", titles(|words| words.all_causes), parts.all_causes.html),
        ],
        user: clean(&context.user, NAME),
        role: context.role.as_str(),
        panels: paths.zip(parts.details.into_iter().map(text)).collect(),
    })
}

/// A word in both languages, for parts of the page that are not swapped.
fn titles(word: fn(&Words) -> &'static str) -> InBoth {
    Lang::ALL.map(|lang| (lang.as_str(), word(Words::of(lang))))
}
