//! Take-overs that wait for a yes. An operator who gave the right secret is told that another one is in charge, and
//! confirms on that page within half a minute: nobody gives the secret twice.

use std::collections::VecDeque;
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};

use telltale_engine::time::{Span, Timestamp};
use telltale_store::{StoreError, Token, Verified};

/// Later than this the secret has to be given again.
const CONFIRM_WITHIN: Span = Span::from_secs(30);

/// Questions that wait; the oldest is forgotten for a new one.
const WAITING_MAX: usize = 16;

/// The questions that wait for an answer.
#[derive(Debug, Default)]
pub struct TakeOvers(Mutex<VecDeque<Waiting>>);

#[derive(Debug)]
struct Waiting {
    /// It stands in the one page that asks, and nowhere else.
    token: Token,
    user: Verified,
    from: Box<str>,
    source: IpAddr,
    until: Timestamp,
}

impl TakeOvers {
    /// Asks a user whether to take over from the operator in charge. The token is good once.
    ///
    /// # Errors
    /// If the operating system gives no random numbers.
    pub fn ask(
        &self,
        user: &Verified,
        from: &str,
        source: IpAddr,
        now: Timestamp,
    ) -> Result<Token, StoreError> {
        let token = Token::random()?;
        let mut waiting = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.retain(|it| it.until > now);
        if waiting.len() == WAITING_MAX {
            waiting.pop_front();
        }
        let until = now + CONFIRM_WITHIN;
        waiting.push_back(Waiting {
            token: token.clone(),
            user: user.clone(),
            from: from.into(),
            source,
            until,
        });
        Ok(token)
    }

    /// The user who says yes with this token, and the operator before. The token answers the question.
    pub fn answer(
        &self,
        token: &Token,
        name: &str,
        source: IpAddr,
        now: Timestamp,
    ) -> Option<(Verified, Box<str>)> {
        let mut waiting = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let is_asked = |it: &Waiting| it.token == *token && it.user.name() == name && it.source == source;
        let asked = waiting.iter().position(is_asked).and_then(|index| waiting.remove(index))?;
        (asked.until > now).then_some((asked.user, asked.from))
    }
}
