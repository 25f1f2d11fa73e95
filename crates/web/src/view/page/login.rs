//! The login page, and the reasons of a failed login.

use askama::Template;

use super::Palette;
use super::frame::PageFrame;
use crate::texts::{Lang, NAME, SessionEnd, Words, clean};
use crate::view::html;
use telltale_store::Token;

/// The content of the login page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LoginContext {
    pub lang: Lang,
    pub palette: Palette,
    /// The density of the vehicle's display.
    pub dpi: u32,
    /// The name that was typed last.
    pub name: String,
    pub failure: Option<LoginFailure>,
    /// Why the session that the browser had is over.
    pub session_end: Option<SessionEnd>,
    /// The operator whose session is open at this display, from whom another one takes over.
    pub from: Option<String>,
    /// Names to choose from.
    pub names: Vec<String>,
    pub demo: bool,
}

impl LoginContext {
    /// The page before anybody has typed anything.
    pub fn new(lang: Lang, palette: Palette, dpi: u32, demo: bool) -> LoginContext {
        LoginContext {
            lang,
            palette,
            dpi,
            name: String::new(),
            failure: None,
            session_end: None,
            from: None,
            names: Vec::new(),
            demo,
        }
    }
}

/// Why a login did not work. It never says whether the name exists.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LoginFailure {
    /// The name or the secret is wrong.
    Wrong,
    /// It is a PIN, and this is not one of the vehicle's own displays.
    PinElsewhere,
    /// Too many failures: the next try counts after this many seconds.
    Wait { seconds: u64 },
    /// Another operator is logged in; the secret was right, so this one may take over with the token. A browser
    /// with a session still shows the vehicle.
    OtherOperator { by: String, token: Token, has_session: bool },
    /// The confirmation of a take-over came too late, or from elsewhere.
    TakeOverLate,
    /// The vehicle drives: it can be taken over at its own displays only.
    Drives,
    /// The login cannot be recorded: the disk is full, or the database is broken.
    Storage,
    /// Logins cannot be checked now.
    Unavailable,
    /// No user exists yet. `data` is the folder for `telltale user add --data`.
    NoUsers { data: Option<String> },
}

impl LoginFailure {
    /// For programs and the audit log.
    pub const fn as_str(&self) -> &'static str {
        match self {
            LoginFailure::Wrong => "the name or the secret is wrong",
            LoginFailure::PinElsewhere => "a PIN will do at the vehicle's own displays only; give a password",
            LoginFailure::Wait { .. } => "too many failures; wait",
            LoginFailure::OtherOperator { .. } => "another operator has the vehicle",
            LoginFailure::TakeOverLate => "the take-over was confirmed too late; give the secret again",
            LoginFailure::Drives => "the vehicle drives; take it over at one of its own displays",
            LoginFailure::Storage => {
                "nothing can be written: the disk is full or the database broken; nothing was changed"
            }
            LoginFailure::Unavailable | LoginFailure::NoUsers { .. } => {
                "logins cannot be checked now; try again"
            }
        }
    }
}

struct TakeOver {
    token: String,
    /// The words of the button.
    button: String,
    /// This browser shows the vehicle.
    has_session: bool,
}

#[derive(Template)]
#[template(path = "login.html")]
struct LoginHtml {
    frame: PageFrame,
    name: String,
    failure: Option<String>,
    session_end: Option<&'static str>,
    /// Above the login of another operator: from whom that one takes over.
    change: Option<String>,
    from: Option<String>,
    names: Vec<String>,
    /// The question whether to take the place of another operator.
    take_over: Option<TakeOver>,
    demo: bool,
}

pub fn login_page(context: &LoginContext) -> String {
    let words = Words::of(context.lang);
    let take_over = match &context.failure {
        Some(LoginFailure::OtherOperator { token, has_session, by }) => Some(TakeOver {
            token: token.as_str().to_owned(),
            button: context.lang.take_place(&clean(by, NAME)),
            has_session: *has_session,
        }),
        _ => None,
    };
    let failure = context.failure.as_ref().map(|failure| match failure {
        LoginFailure::Wrong => words.login_wrong.to_owned(),
        LoginFailure::PinElsewhere => words.login_pin_elsewhere.to_owned(),
        LoginFailure::Wait { seconds } => context.lang.login_wait(*seconds),
        LoginFailure::TakeOverLate => words.login_late.to_owned(),
        LoginFailure::OtherOperator { by, .. } => context.lang.login_other_operator(&clean(by, NAME)),
        LoginFailure::Drives => words.login_drives.to_owned(),
        LoginFailure::Storage => words.login_storage.to_owned(),
        LoginFailure::Unavailable => words.login_unavailable.to_owned(),
        LoginFailure::NoUsers { data } => {
            let data = data.as_deref().map(|data| format!(" --data {}", clean(data, NAME_OF_FILE)));
            words.login_no_users.to_owned() + &data.unwrap_or_default()
        }
    });
    html(&LoginHtml {
        frame: PageFrame::new(context.lang, context.palette).of_display(context.dpi),
        name: clean(&context.name, NAME),
        failure,
        session_end: context.session_end.map(|why| context.lang.session_end(why)),
        change: context.from.as_deref().map(|from| context.lang.login_change(&clean(from, NAME))),
        from: context.from.as_deref().map(|from| clean(from, NAME)),
        // Nobody takes their own place.
        names: context
            .names
            .iter()
            .filter(|name| Some(*name) != context.from.as_ref())
            .map(|name| clean(name, NAME))
            .collect(),
        take_over,
        demo: context.demo,
    })
}

/// Characters of a path: the longest that Linux takes.
const NAME_OF_FILE: usize = 4096;
