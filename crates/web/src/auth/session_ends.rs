//! Why a session ended, for the login page. The browser is recognized by the cookie that it still has; the
//! address says nothing about it, so nobody can forge a reason.

use crate::texts::SessionEnd;
use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

use axum::http::HeaderMap;

use crate::AppState;
use crate::http::guard::cookie_name;
use crate::http::respond::cookie;
use telltale_store::{Session, SessionKind, Token};

/// Sessions that are remembered; the oldest is forgotten for a new one.
const SESSIONS_MAX: usize = 256;

/// Sessions of browsers, the oldest first.
#[derive(Debug, Default)]
pub struct SessionEnds(Mutex<VecDeque<KnownSession>>);

#[derive(Debug)]
struct KnownSession {
    session: Session,
    why: Option<SessionEnd>,
}

impl SessionEnds {
    /// Notes a session that a browser has.
    pub fn remember(&self, session: &Session) {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if session.kind != SessionKind::Person || known.iter().any(|it| it.session.is(session)) {
            return;
        }
        if known.len() == SESSIONS_MAX {
            known.pop_front();
        }
        known.push_back(KnownSession { session: session.clone(), why: None });
    }

    /// Notes why a session ends.
    pub fn end(&self, session: &Session, why: SessionEnd) {
        self.note(|it| it.is(session), Some(why));
    }

    /// Notes why all sessions of a user end.
    pub fn end_all_of(&self, user: &str, why: SessionEnd) {
        self.note(|it| *it.user == *user, Some(why));
    }

    /// Notes that a user logs out at this display, which ends all sessions of the user.
    pub fn log_out(&self, session: &Session) {
        self.end_all_of(&session.user, SessionEnd::LoggedOut);
        self.end(session, SessionEnd::LoggedOutHere);
    }

    /// Notes that the sessions of a user do not end after all.
    pub fn stay(&self, user: &str) {
        self.note(|it| *it.user == *user, None);
    }

    fn note(&self, ends: impl Fn(&Session) -> bool, why: Option<SessionEnd>) {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        for it in known.iter_mut().filter(|it| ends(&it.session)) {
            it.why = why;
        }
    }

    fn of(&self, token: &Token) -> Option<(Session, Option<SessionEnd>)> {
        let known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        known.iter().find(|it| it.session.is_of(token)).map(|it| (it.session.clone(), it.why))
    }
}

/// Why the session of this browser ended. `None` if the browser has none, or an open one.
pub async fn of(app: &AppState, headers: &HeaderMap) -> Option<SessionEnd> {
    let token = cookie(headers, cookie_name(app.settings.secure)).and_then(Token::parse)?;
    let Some((session, why)) = app.session_ends.of(&token) else {
        return app.session(&token).is_none().then_some(SessionEnd::Ended);
    };
    if session.is_open() {
        // The page may be quicker than the end of its session.
        return why.or_else(|| app.has_expired(&session).then(|| app.overdue(&session))).filter(is_told);
    }
    let is_user = app.store.knows_user(&session.user).await.unwrap_or(true);
    Some(if is_user { why.unwrap_or(SessionEnd::Ended) } else { SessionEnd::Removed }).filter(is_told)
}

fn is_told(why: &SessionEnd) -> bool {
    *why != SessionEnd::LoggedOutHere
}
