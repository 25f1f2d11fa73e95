//! Whole pages: the operator's screen, the login, the demo's switches, and pages of one sentence.

use askama::Template;

use crate::engine::model::Stage;
use crate::runtime::Published;
use crate::store::Role;
use crate::web::assets;
use crate::web::steps::StepWords;
use crate::web::text::Words;
use crate::web::versions::Seen;

use super::clean::{MESSAGE, NAME, clean};
use super::{
    DemoFault, Lang, LoginContext, LoginFailure, PageContext, Palette, Part, Parts, Trends, View, html, top,
};

/// What every page is framed by.
pub struct Frame {
    pub lang: &'static str,
    pub palette: &'static str,
    pub part: Part,
    pub words: &'static Words,
    /// Both languages, for words that change their language, or must show, without a server.
    pub both: [(&'static str, &'static Words); 2],
}

impl Frame {
    pub fn new(lang: Lang, palette: Palette) -> Frame {
        let both = Lang::ALL.map(|lang| (lang.as_str(), lang.words()));
        let (lang, words) = (lang.as_str(), lang.words());
        Frame { lang, palette: palette.as_str(), part: Part::Whole, words, both }
    }

    /// The keys of the pad for a PIN, but the last row, and for a name.
    pub fn digits(&self) -> std::str::Chars<'static> {
        "123456789".chars()
    }

    pub fn letters(&self) -> std::str::Chars<'static> {
        "abcdefghijklmnopqrstuvwxyz0123456789.-_".chars()
    }

    /// Where a file of `static/` is found.
    pub fn asset(&self, name: &str) -> String {
        assets::url(name)
    }
}

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
        return login_page(&LoginContext { lang, palette, name, failure: None, farewell: None, demo });
    }
    let view = View { seen: seen.clone(), trends: Some(trends), ..View::new(published, context.lang, false) };
    let parts = Parts::of(&view);
    let paths = view.board.tiles.iter().map(|&id| view.snapshot.group(id).0.path.to_string());
    let text = |fragment: super::Fragment| fragment.html;
    html(&OperatorHtml {
        frame: Frame::new(context.lang, context.palette),
        stage: published.snapshot.stage.as_str(),
        layout: top::layout_mark(&view),
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

#[derive(Template)]
#[template(path = "login.html")]
struct LoginHtml {
    frame: Frame,
    name: String,
    failure: Option<String>,
    farewell: Option<&'static str>,
    /// Words of the button, if the login takes the seat over from somebody.
    take_over: Option<&'static str>,
    demo: bool,
}

pub fn login_page(context: &LoginContext) -> String {
    let words = context.lang.words();
    let is_taken = matches!(context.failure, Some(LoginFailure::SeatTaken { .. }));
    let failure = context.failure.as_ref().map(|failure| match failure {
        LoginFailure::Wrong => words.login_wrong.to_owned(),
        LoginFailure::PinElsewhere => words.login_pin_elsewhere.to_owned(),
        LoginFailure::Wait { seconds } => context.lang.login_wait(*seconds),
        LoginFailure::SeatTaken { by } => context.lang.login_seat_taken(&clean(by, NAME)),
        LoginFailure::Drives => words.login_drives.to_owned(),
        LoginFailure::Storage => words.login_storage.to_owned(),
        LoginFailure::Unavailable => words.login_unavailable.to_owned(),
        LoginFailure::NoUsers { data } => {
            let data = data.as_deref().map(|data| format!(" --data {}", clean(data, NAME_OF_FILE)));
            words.login_no_users.to_owned() + &data.unwrap_or_default()
        }
    });
    html(&LoginHtml {
        frame: Frame::new(context.lang, context.palette),
        name: clean(&context.name, NAME),
        failure,
        farewell: context.farewell.map(|why| context.lang.farewell(why)),
        take_over: is_taken.then_some(words.login_take_over),
        demo: context.demo,
    })
}

/// Characters of a path: the longest that Linux takes.
const NAME_OF_FILE: usize = 4096;

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
