//! Replays of incidents: somebody looks at what was shown then, while the vehicle goes on.
//!
//! Each has an engine of its own in a thread of its own, and a web server of its own behind `/replay/ID/screen/`,
//! whose source is that engine. It can act on nothing (see `source`).

mod page;
mod player;
mod screen;

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use axum::Router;
use tokio::sync::watch;
use tokio::task;
use tokio::time::timeout;

use super::http::errors::HttpError;
use super::live::{first_changes, trend_sampling};
use super::source::Player;
use super::{AppState, Settings, router};
use crate::engine::time::{Span, Timestamp};
use crate::record::folder;
use crate::replay::{Playback, Recording, ReplayError, Run};
use crate::store::{Incident, Session};
pub use page::{control, get, state};
use player::{Controls, PlayState};
pub use screen::{first as first_screen, get as screen};

/// Replays that are open at once. Another one takes the place of the one that was used least lately.
const OPEN_MAX: usize = 8;
/// A replay that nobody uses for so long is closed.
const IDLE_MAX: Span = Span::from_secs(1800);
/// A recording must be ready within this time, less than a request may take.
const READY_WITHIN: Duration = Duration::from_secs(8);

/// The open replays.
#[derive(Debug, Default)]
pub struct Replays {
    open: Mutex<Vec<OpenReplay>>,
    /// Held while a recording is run to its end: one after the other, the vehicle has the rest of the machine.
    opening: Arc<tokio::sync::Mutex<()>>,
}

/// A replay of an incident by one session.
#[derive(Debug, Clone)]
struct OpenReplay {
    incident: u64,
    session: Session,
    used: Timestamp,
    controls: Controls,
    state: watch::Receiver<PlayState>,
    screen: Router,
}

impl Replays {
    /// The open replay of this incident by this session, which is used now.
    fn find(&self, incident: u64, session: &Session, now: Timestamp) -> Option<OpenReplay> {
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        open.retain(|it| now.since(it.used) < IDLE_MAX && !it.session.has_ended());
        let found = open.iter_mut().find(|it| it.incident == incident && it.session.is_same(session))?;
        found.used = now;
        Some(found.clone())
    }

    fn add(&self, replay: OpenReplay) {
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        open.retain(|it| it.incident != replay.incident || !it.session.is_same(&replay.session));
        if open.len() >= OPEN_MAX {
            let oldest = open.iter().enumerate().min_by_key(|(_, it)| it.used).map(|(index, _)| index);
            oldest.map(|index| open.swap_remove(index));
        }
        open.push(replay);
    }
}

/// The replay of an incident by this session. It is opened if it is not.
async fn of(app: &AppState, incident: &Incident, session: &Session) -> Result<OpenReplay, HttpError> {
    let id = incident.summary.id;
    if let Some(open) = app.replays.find(id, session, app.clock.now()) {
        return Ok(open);
    }
    let recording = &incident.summary.recording;
    if !recording.finished {
        return Err(HttpError::Unfinished);
    }
    let path = app.settings.recordings.as_deref().and_then(|it| folder::path_of(it, &recording.file));
    let path = path.filter(|path| path.is_file()).ok_or(HttpError::NoRecording)?;
    // The first trigger lies within its millisecond.
    let since_ns = u64::try_from(incident.summary.since_ms + 1).unwrap_or(0).saturating_mul(1_000_000);
    let opening = app.replays.opening.clone().lock_owned();
    let opened = async {
        let held = opening.await;
        let playback = task::spawn_blocking(move || {
            let _held = held;
            let mut playback = Recording::open(&path).and_then(Run::recorded).and_then(Playback::open)?;
            // What happened is at the first trigger.
            playback.go_to(playback.facts().at(since_ns))?;
            Ok::<Playback, ReplayError>(playback)
        });
        playback.await.map_err(|_| ReplayError::Empty)?
    };
    let playback = match timeout(READY_WITHIN, opened).await {
        Ok(Ok(playback)) => playback,
        Ok(Err(error)) => {
            tracing::warn!(%error, "the recording of incident {id} cannot be replayed");
            return Err(HttpError::NoReplay);
        }
        Err(_) => return Err(HttpError::Busy),
    };
    let replay = start(app, id, session, playback).ok_or(HttpError::NoReplay)?;
    app.replays.add(replay.clone());
    Ok(replay)
}

/// Starts the thread of a replay and the server of its screen.
fn start(app: &AppState, incident: u64, session: &Session, mut playback: Playback) -> Option<OpenReplay> {
    let (show, source) = Player::start(player::published(&mut playback)?);
    let (controls, state) = player::start(playback, show, app.clock).ok()?;
    let settings = Settings {
        origins: app.settings.origins.clone(),
        secure: app.settings.secure,
        enrolled: app.settings.enrolled.clone(),
        demo: None,
        rereads: None,
        written: None,
        history: None,
        discovery: None,
        recordings: None,
        what_if: None,
        marker: None,
        recording: None,
    };
    let inner = AppState::new(source, app.store.clone(), app.clock, settings);
    // They end with the source.
    tokio::spawn(first_changes::watch(inner.clone()));
    tokio::spawn(trend_sampling::watch(inner.clone()));
    let (used, screen) = (app.clock.now(), router(inner));
    Some(OpenReplay { incident, session: session.clone(), used, controls, state, screen })
}
