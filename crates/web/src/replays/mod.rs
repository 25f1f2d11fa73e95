//! Replays: somebody looks at what was shown then, while the vehicle goes on.
//!
//! Each has an engine of its own in a thread of its own, and a web server of its own behind `/replay/ID/screen/`,
//! whose source is that engine. It can act on nothing (see `source`).

mod differences;
mod missing;
mod moment;
mod opening;
mod page;
mod player;
mod screen;
mod subject;

use std::sync::{Arc, Mutex, PoisonError};

use axum::Router;
use tokio::sync::watch;

use super::incidents::WhatIf;
use super::live::{first_changes, sample_trends};
use super::source::Player;
use super::{AppState, Settings};
pub use differences::differences;
use missing::Missing;
pub use moment::moment;
use opening::Opening;
pub use page::{asked_ms, control, get, state};
use player::{Controls, PlayState};
pub use screen::{first as first_screen, get as screen, is_page, passed_on};
pub use subject::{ServedFile, ServedFiles, Subject};
use telltale_clock::Clock;
use telltale_clock::unix_ms;
use telltale_engine::time::{Span, Timestamp};
use telltale_record::story::Story;
use telltale_record::summary::Summary;
use telltale_replay::Playback;
use telltale_store::{History, Session};

/// Replays that are open at once.
const OPEN_MAX: usize = 8;
/// Those of one user, who may have several sessions. Another one takes the place of the user's own.
const OPEN_OF_USER_MAX: usize = 4;
/// Recordings that are being opened for one user.
const OPENING_OF_USER_MAX: usize = 2;
/// A replay that nobody uses for so long is closed.
const IDLE_MAX: Span = Span::from_secs(1800);

/// The open replays, and those that are being opened.
#[derive(Debug)]
pub struct Replays {
    /// The pages of a replay's screen.
    routes: fn(AppState) -> Router,
    open: Mutex<Vec<OpenReplay>>,
    opening: Mutex<Vec<Opening>>,
    /// Held while a recording is run to its end: one after the other, the vehicle has the rest of the machine.
    turn: Arc<tokio::sync::Mutex<()>>,
}

/// A replay by one session. Its tabs show the same instant: each place costs an engine with its marks, a history and
/// a server.
#[derive(Debug, Clone)]
struct OpenReplay {
    subject: Subject,
    session: Session,
    used: Timestamp,
    controls: Controls,
    state: watch::Receiver<PlayState>,
    screen: Router,
    /// The story of the recording, and its first lines; of an incident the store knows better ones.
    story: Arc<Story>,
    summary: Arc<Summary>,
    missing: Arc<Missing>,
    /// The what-if whose configuration it shows.
    edited: Option<Arc<WhatIf>>,
}

impl Replays {
    pub fn new(routes: fn(AppState) -> Router) -> Replays {
        Replays { routes, open: Mutex::default(), opening: Mutex::default(), turn: Arc::default() }
    }

    /// The open replay by this session, which is used now.
    fn find(&self, subject: &Subject, session: &Session, now: Timestamp) -> Option<OpenReplay> {
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        open.retain(|it| now.since(it.used) < IDLE_MAX && it.session.is_open());
        let found = open.iter_mut().find(|it| it.subject == *subject && it.session.is(session))?;
        found.used = now;
        Some(found.clone())
    }

    /// The same, as it stands in an address.
    fn of_address(&self, id: &str, session: &Session, now: Timestamp) -> Option<OpenReplay> {
        self.find(&id.parse().ok()?, session, now)
    }

    fn add(&self, replay: OpenReplay) {
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        open.retain(|it| it.subject != replay.subject || !it.session.is(&replay.session));
        let places: Vec<(&str, Timestamp)> = open.iter().map(|it| (&*it.session.user, it.used)).collect();
        if let Some(index) = gives_way(&places, &replay.session.user) {
            open.swap_remove(index);
        }
        open.push(replay);
    }
}

/// Which of the open replays, each with its user and when it was used, gives way to another one of this user: the
/// user's own that was used least lately, or where there is no place, that of a user who has most.
fn gives_way(open: &[(&str, Timestamp)], user: &str) -> Option<usize> {
    let count = |of: &str| open.iter().filter(|(user, _)| *user == of).count();
    let has_share = count(user) >= OPEN_OF_USER_MAX;
    if !has_share && open.len() < OPEN_MAX {
        return None;
    }
    let most = open.iter().map(|(user, _)| count(user)).max();
    let gives = |of: &str| if has_share { of == user } else { Some(count(of)) == most };
    let candidates = open.iter().enumerate().filter(|(_, (of, _))| gives(of));
    candidates.min_by_key(|(_, (_, used))| *used).map(|(index, _)| index)
}

/// Starts the thread of a replay and the server of its screen.
fn start(
    app: &AppState,
    subject: Subject,
    session: &Session,
    mut playback: Playback,
    edited: Option<Arc<WhatIf>>,
) -> Option<OpenReplay> {
    let summary = Arc::new(summary_of(&playback));
    let story = Arc::new(playback.story(&summary).ok()?);
    let (show, mut source) = Player::start(player::published(&mut playback)?);
    source.flows = playback.flows().clone();
    let history = history_of(&mut playback, app.clock);
    let missing = Arc::new(Missing::of(&playback));
    source.gaps = missing.gaps.clone();
    let (controls, state) = player::start(playback, show, app.clock).ok()?;
    let settings = Settings {
        enrolled: app.settings.enrolled.clone(),
        history,
        ..Settings::plain(app.settings.origins.clone(), app.settings.secure)
    };
    let inner = AppState::new(source, app.store.clone(), app.clock, settings);
    // They end with the source.
    tokio::spawn(first_changes::watch(inner.clone()));
    tokio::spawn(sample_trends(inner.clone()));
    let (used, screen) = (app.clock.now(), (app.replays.routes)(inner));
    let session = session.clone();
    Some(OpenReplay { subject, session, used, controls, state, screen, story, summary, missing, edited })
}

/// The past by the recording. Without it, pages say that there is none.
fn history_of(playback: &mut Playback, clock: Clock) -> Option<History> {
    let records = playback.records().ok()?;
    let until = (playback.facts().wall(playback.to()), playback.to());
    let made = History::recorded(&records, until, clock);
    made.inspect_err(|error| tracing::warn!(%error, "a replay has no history")).ok()
}

/// The first lines of a recording that is no incident of the store.
fn summary_of(playback: &Playback) -> Summary {
    let facts = playback.facts();
    let ms = |at| unix_ms(facts.wall(at));
    Summary {
        since_ms: ms(facts.from),
        until_ms: Some(ms(playback.to())),
        vehicle: facts.vehicle.clone(),
        ..Summary::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_user_has_a_share_of_the_replays() {
        let mut open: Vec<(&str, Timestamp)> = Vec::new();
        let mut second = 0;
        let mut add = |open: &mut Vec<(&'static str, Timestamp)>, user: &'static str| {
            second += 1;
            gives_way(open, user).map(|index| open.remove(index));
            open.push((user, Timestamp::from_millis(second * 1000)));
        };
        let users = |open: &[(&'static str, Timestamp)]| open.iter().map(|it| it.0).collect::<String>();
        for _ in 0..9 {
            add(&mut open, "d");
        }
        assert_eq!(users(&open), "dddd", "one user has no more than a share");
        assert_eq!(open[0].1, Timestamp::from_millis(6000), "the oldest go");
        for user in ["e", "f", "f", "f", "g", "g", "h"] {
            add(&mut open, user);
        }
        assert_eq!(users(&open), "ddeffggh", "those go first who have most");
        for _ in 0..9 {
            add(&mut open, "f");
        }
        assert_eq!(users(&open), "degghfff", "nobody takes from those who have less");
    }
}
