//! Opens recordings for replays. A long one takes its time: it is opened in the background, and its page waits.

use std::sync::{Arc, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use tokio::task;
use tokio::time::timeout;

use super::subject::{self, Open};
use super::{OPEN_MAX, OPENING_OF_USER_MAX, OpenReplay, Replays, Subject, start};
use crate::AppState;
use crate::incidents::WhatIf;
use crate::texts::HttpError;
use telltale_engine::time::Span;
use telltale_replay::{Playback, ReplayError};
use telltale_store::{Incident, Session};

/// A page waits this long for a recording; after that it asks again.
const READY_WITHIN: Duration = Duration::from_secs(3);

/// A recording that takes longer is not opened: the next one waits for it.
const OPENED_WITHIN: Span = Span::from_secs(120);

/// How a recording was opened; `None` while it is read.
type Outcome = Option<Result<(), HttpError>>;

/// A recording that is being opened for a session.
#[derive(Debug)]
pub(super) struct Opening {
    subject: Subject,
    session: Session,
    outcome: watch::Receiver<Outcome>,
}

impl Replays {
    fn opening(&self, subject: &Subject, session: &Session) -> Option<watch::Receiver<Outcome>> {
        let opening = self.opening.lock().unwrap_or_else(PoisonError::into_inner);
        let found = opening.iter().find(|it| it.subject == *subject && it.session.is(session));
        found.map(|it| it.outcome.clone())
    }

    fn add_opening(&self, opening: Opening) -> Result<(), HttpError> {
        let mut others = self.opening.lock().unwrap_or_else(PoisonError::into_inner);
        // Nobody may have waited for the outcome of these.
        others.retain(|it| it.outcome.borrow().is_none() && it.outcome.has_changed().is_ok());
        let of_user = others.iter().filter(|it| it.session.user == opening.session.user).count();
        if others.len() >= OPEN_MAX || of_user >= OPENING_OF_USER_MAX {
            return Err(HttpError::Busy);
        }
        others.push(opening);
        Ok(())
    }

    fn remove_opening(&self, subject: &Subject, session: &Session) {
        let mut opening = self.opening.lock().unwrap_or_else(PoisonError::into_inner);
        opening.retain(|it| it.subject != *subject || !it.session.is(session));
    }
}

/// The replay of this recording by this session. It is opened if it is not, if it is one of the last minutes
/// that ended before this moment, or if its configuration was edited since: then the new one takes its place.
pub(super) async fn of(
    app: &AppState,
    subject: &Subject,
    incident: Option<&Incident>,
    session: &Session,
    at_ms: Option<i64>,
) -> Result<OpenReplay, HttpError> {
    let edited = match subject {
        Subject::WhatIf(id) => app.what_ifs.of(session, *id),
        _ => None,
    };
    let is_newest = |open: &OpenReplay| {
        let is_same = |(new, open): (&Arc<WhatIf>, &Arc<WhatIf>)| Arc::ptr_eq(new, open);
        edited.as_ref().zip(open.edited.as_ref()).is_none_or(is_same)
    };
    let reaches = |open: &OpenReplay| {
        let ends_later =
            *subject != Subject::Recent || at_ms.is_none_or(|at_ms| at_ms <= open.state.borrow().to_ms);
        ends_later && is_newest(open)
    };
    if let Some(open) = app.replays.find(subject, session, app.clock.now()).filter(reaches) {
        return Ok(open);
    }
    let mut outcome = match app.replays.opening(subject, session) {
        Some(outcome) => outcome,
        None => begin(app, subject, incident, session, edited.as_ref())?,
    };
    let opened = match timeout(READY_WITHIN, outcome.wait_for(Option::is_some)).await {
        Ok(opened) => opened.ok().and_then(|outcome| *outcome),
        Err(_) => return Err(HttpError::Opening),
    };
    app.replays.remove_opening(subject, session);
    opened.unwrap_or(Err(HttpError::NoReplay))?;
    let open = app.replays.find(subject, session, app.clock.now()).ok_or(HttpError::NoReplay)?;
    // It was edited while the one before was opened.
    if is_newest(&open) { Ok(open) } else { Err(HttpError::Opening) }
}

fn begin(
    app: &AppState,
    subject: &Subject,
    incident: Option<&Incident>,
    session: &Session,
    edited: Option<&Arc<WhatIf>>,
) -> Result<watch::Receiver<Outcome>, HttpError> {
    let (open, since_ms) = match (subject, incident) {
        (Subject::Incident(_) | Subject::WhatIf(_), Some(incident)) => {
            let summary = &incident.summary;
            if !summary.recording.finished {
                return Err(HttpError::Unfinished);
            }
            let open = match (subject, edited) {
                (Subject::WhatIf(_), Some(edited)) => subject::what_if(app, edited, summary)?,
                // Nothing is kept longer than a what-if.
                (Subject::WhatIf(_), None) => return Err(HttpError::NotFound),
                _ => subject::incident(app, &summary.recording.file)?,
            };
            (open, Some(summary.since_ms))
        }
        (Subject::Incident(_) | Subject::WhatIf(_), None) => return Err(HttpError::NotFound),
        (Subject::Recent, _) => (subject::recent(app)?, None),
        (Subject::File(name), _) => (subject::file(app, name)?.opening(), None),
    };
    let (told, outcome) = watch::channel(None);
    app.replays.add_opening(Opening {
        subject: subject.clone(),
        session: session.clone(),
        outcome: outcome.clone(),
    })?;
    let (app, session, edited) = (app.clone(), session.clone(), edited.cloned());
    let subject = subject.clone();
    // If the request is gone by then, the next one finds it.
    tokio::spawn(async move {
        let outcome = opened(&app, subject, &session, (open, edited), since_ms).await;
        told.send_replace(Some(outcome));
    });
    Ok(outcome)
}

async fn opened(
    app: &AppState,
    subject: Subject,
    session: &Session,
    (open, edited): (Open, Option<Arc<WhatIf>>),
    since_ms: Option<i64>,
) -> Result<(), HttpError> {
    let turn = Arc::clone(&app.replays.turn).lock_owned().await;
    let (clock, reader) = (app.clock, session.clone());
    let read = task::spawn_blocking(move || {
        let _turn = turn;
        let until = clock.now() + OPENED_WITHIN;
        let go_on = || reader.is_open() && clock.now() < until;
        let mut playback = Playback::open_while(open()?, &go_on)?;
        // The first trigger of an incident lies within its millisecond. Other recordings are shown from their beginning.
        let at = match since_ms {
            Some(ms) => {
                let ms = u64::try_from(ms.saturating_add(1)).unwrap_or(0);
                playback.facts().at(ms.saturating_mul(1_000_000))
            }
            None => playback.facts().from,
        };
        playback.go_to(at)?;
        Ok::<_, ReplayError>(playback)
    });
    let playback = match read.await {
        Ok(Ok(read)) => read,
        Ok(Err(error)) => {
            tracing::warn!(%error, "the recording of /replay/{subject} cannot be replayed");
            return Err(HttpError::NoReplay);
        }
        Err(error) => {
            tracing::error!(%error, "a replay ended while it was opened");
            return Err(HttpError::NoReplay);
        }
    };
    let (starting, for_session) = (app.clone(), session.clone());
    let started =
        task::spawn_blocking(move || start(&starting, subject, &for_session, playback, edited)).await;
    let replay = started.ok().flatten().ok_or(HttpError::NoReplay)?;
    app.replays.add(replay);
    Ok(())
}
