//! Whole pages: the operator's screen, the login, the demo's switches, and pages of one sentence.

use askama::Template;

use super::versions::Seen;
use super::words::action_words::StepWords;
use crate::engine::model::Stage;
use crate::runtime::Published;
use crate::store::Role;

use super::clean_text::{MESSAGE, NAME, clean};
use super::page_frame::Frame;
use super::{
    DemoFault, Lang, LoginContext, PageContext, Palette, Parts, Trends, View, html, login_page, top_bar,
};

/// A word by language.
type InBoth = [(&'static str, &'static str); 2];

#[derive(Template)]
#[template(path = "operator.html")]
struct OperatorHtml {
    frame: Frame,
    stage: &'static str,
    layout: String,
    columns: usize,
    rows: usize,
    demo: bool,
    developer: bool,
    top: String,
    arrows: String,
    tiles: Vec<String>,
    measure: String,
    causes: String,
    step: String,
    /// Name, title in both languages, and content of what a button opens over the board.
    sheets: [(&'static str, InBoth, String); 3],
    user: String,
    steps: [(&'static str, &'static StepWords); 2],
    role: &'static str,
    /// The path of each tile with what stands behind it.
    panels: Vec<(String, String)>,
}

/// The operator's screen. In the stage `locked` it is the login: nothing of the vehicle shows.
pub fn operator_page(published: &Published, seen: &Seen, context: &PageContext, trends: &Trends) -> String {
    if published.snapshot.stage == Stage::Locked {
        let name = String::new();
        let PageContext { lang, palette, demo, .. } = *context;
        return login_page(&LoginContext { lang, palette, name, failure: None, session_end: None, demo });
    }
    let view = View { seen: seen.clone(), trends: Some(trends), ..View::new(published, context.lang, false) };
    let parts = Parts::of(&view);
    let paths = view.board.tiles.iter().map(|&id| view.snapshot.group(id).0.path.to_string());
    let text = |fragment: super::Fragment| fragment.html;
    html(&OperatorHtml {
        frame: Frame::new(context.lang, context.palette),
        stage: published.snapshot.stage.as_str(),
        layout: top_bar::layout_mark(&view),
        columns: view.board.columns,
        rows: view.board.rows,
        demo: context.demo,
        developer: context.role != Role::Operator,
        top: parts.top.html,
        arrows: parts.arrows.html,
        tiles: parts.tiles.into_iter().map(text).collect(),
        measure: parts.measure.html,
        causes: parts.causes.html,
        step: parts.step.html,
        sheets: [
            ("stops", titles(|steps| steps.where_is_it), parts.stops.html),
            ("checks", titles(|steps| steps.all_checks), parts.checks.html),
            ("causes", titles(|steps| steps.all_causes), parts.all_causes.html),
        ],
        user: clean(&context.user, NAME),
        steps: Lang::ALL.map(|lang| (lang.as_str(), lang.steps())),
        role: context.role.as_str(),
        panels: paths.zip(parts.details.into_iter().map(text)).collect(),
    })
}

/// A word of a part that is not swapped, in both languages.
fn titles(word: fn(&StepWords) -> &'static str) -> InBoth {
    Lang::ALL.map(|lang| (lang.as_str(), word(lang.steps())))
}

struct FaultHtml {
    name: String,
    title: String,
    text: &'static str,
    active: bool,
}

#[derive(Template)]
#[template(path = "demo.html")]
struct DemoHtml {
    frame: Frame,
    faults: Vec<FaultHtml>,
}

/// The switches of the simulated shuttle's faults.
pub fn demo_page(faults: &[DemoFault], context: &PageContext) -> String {
    let words = context.lang.words();
    let faults = faults.iter().map(|fault| {
        let (title, text) = match &*fault.name {
            "sensor_outage" => (words.sensor_outage, words.sensor_outage_text),
            "localization_jump" => (words.localization_jump, words.localization_jump_text),
            "costmap_delay" => (words.costmap_delay, words.costmap_delay_text),
            "planner_stall" => (words.planner_stall, words.planner_stall_text),
            "can_loss" => (words.can_loss, words.can_loss_text),
            "low_battery" => (words.low_battery, words.low_battery_text),
            "camera_crash" => (words.camera_crash, words.camera_crash_text),
            _ => ("", ""),
        };
        let title = if title.is_empty() { clean(&fault.name, NAME) } else { title.to_owned() };
        FaultHtml { name: clean(&fault.name, NAME), title, text, active: fault.active }
    });
    let faults = faults.collect();
    html(&DemoHtml { frame: Frame::new(context.lang, context.palette), faults })
}

#[derive(Template)]
#[template(path = "message.html")]
struct MessageHtml {
    frame: Frame,
    status: u16,
    title: String,
    text: String,
}

/// A page that says one thing; `title` and `text` are in the reader's language and not yet escaped.
pub fn message_page(status: u16, title: &str, text: &str, lang: Lang, palette: Palette) -> String {
    html(&MessageHtml {
        frame: Frame::new(lang, palette),
        status,
        title: clean(title, MESSAGE),
        text: clean(text, 2 * MESSAGE),
    })
}
