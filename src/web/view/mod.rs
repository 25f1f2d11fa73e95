//! The pages and their fragments as HTML. Nothing here reads a request or sends an answer.

use crate::runtime::Published;
use crate::store::Role;

/// Files below `static/` that the login page needs: served without a session, so none of them may
/// name a part of the vehicle. An entry that ends in `/` names a folder.
pub const LOGIN_ASSETS: &[&str] = &[];

/// A language of the pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Lang {
    #[default]
    En,
    De,
}

impl Lang {
    pub const ALL: [Lang; 2] = [Lang::En, Lang::De];

    /// The tag of the `lang` attribute and cookie: `en`, `de`.
    pub const fn as_str(self) -> &'static str {
        match self {
            Lang::En => "en",
            Lang::De => "de",
        }
    }

    pub fn from_word(word: &str) -> Option<Lang> {
        Lang::ALL.into_iter().find(|lang| lang.as_str() == word)
    }
}

/// The colours of the pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Palette {
    Day,
    #[default]
    Night,
}

impl Palette {
    /// The word of the `data-palette` attribute and cookie: `day`, `night`.
    pub const fn as_str(self) -> &'static str {
        match self {
            Palette::Day => "day",
            Palette::Night => "night",
        }
    }

    pub fn from_word(word: &str) -> Option<Palette> {
        [Palette::Day, Palette::Night].into_iter().find(|palette| palette.as_str() == word)
    }
}

/// One element of the operator's page that changes by itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fragment {
    /// The `id` of the element: the same for the same part of the vehicle, always.
    pub id: String,
    /// The element, ready to be swapped in by its id.
    pub html: String,
}

/// For whom a page is made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PageContext {
    pub lang: Lang,
    pub palette: Palette,
    pub user: String,
    pub role: Role,
    /// The simulated shuttle runs in this process: pages may link to `/demo`.
    pub demo: bool,
}

/// What the login page shows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LoginContext {
    pub lang: Lang,
    pub palette: Palette,
    /// The name that was typed last.
    pub name: String,
    pub failure: Option<LoginFailure>,
    pub demo: bool,
}

/// Why a login did not work. It never says whether the name exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LoginFailure {
    /// The name or the secret is wrong.
    Wrong,
    /// Too many failures: this many seconds until the next try is looked at.
    Wait { seconds: u64 },
    /// The server can not check logins now.
    Unavailable,
    /// No user exists yet; `telltale user add` makes one.
    NoUsers,
}

/// A fault of the simulated shuttle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DemoFault {
    /// As `POST /demo/fault` takes it: `sensor_outage`.
    pub name: String,
    pub active: bool,
}

/// Every element of the operator's page that changes with the snapshot, in page order.
pub fn fragments(published: &Published, _lang: Lang) -> Vec<Fragment> {
    let stage = published.snapshot.stage.as_str();
    vec![Fragment { id: "stage".to_owned(), html: format!("<p id=\"stage\">{stage}</p>") }]
}

pub fn operator_page(published: &Published, context: &PageContext) -> String {
    let body: String = fragments(published, context.lang).into_iter().map(|part| part.html).collect();
    page(context.lang, context.palette, &body)
}

pub fn login_page(context: &LoginContext) -> String {
    let form = "<form method=\"post\" action=\"/login\"><input name=\"name\"><input name=\"secret\" type=\"password\"><button>Login</button></form>";
    page(context.lang, context.palette, form)
}

pub fn developer_page(published: &Published, context: &PageContext) -> String {
    page(context.lang, context.palette, &format!("<p>{}</p>", published.snapshot.counters.statuses))
}

pub fn demo_page(faults: &[DemoFault], context: &PageContext) -> String {
    page(context.lang, context.palette, &format!("<p>{}</p>", faults.len()))
}

/// A page that says one thing; `title` and `text` are in the reader's language and not yet escaped.
pub fn message_page(status: u16, _title: &str, _text: &str) -> String {
    page(Lang::En, Palette::Night, &format!("<p>{status}</p>"))
}

fn page(lang: Lang, palette: Palette, body: &str) -> String {
    format!(
        "<!doctype html><html lang=\"{}\" data-palette=\"{}\"><head><title>Telltale</title></head><body>{body}</body></html>",
        lang.as_str(),
        palette.as_str()
    )
}
