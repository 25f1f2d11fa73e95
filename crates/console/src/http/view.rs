//! What a session sees of the fleet, and may do with it. The fleet lies here alone, so that a route has it only through a
//! [`View`], and cannot show a vehicle that its session does not see.

use std::path::{Path, PathBuf};
use std::sync::{Arc, MutexGuard};

use axum::Router;
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use telltale_engine::time::{Span, Timestamp};
use telltale_fleet::message::VehicleId;
use telltale_store::{Role, Session};
use telltale_web::Examiner;
use telltale_web::common::SignedIn;
use telltale_web::texts::HttpError;
use tokio::sync::Semaphore;

use super::Console;
use crate::follow::Shared;
use crate::history::{self, Known};
use crate::recordings::{self, path_of};
use crate::state::incidents::IncidentRow;
use crate::state::recordings::NotAsked;
use crate::state::search::Search;
use crate::state::vehicle::Vehicle;
use crate::state::{Fleet, Row};
use crate::what_ifs::{WhatIf, WhatIfs};

/// Histories that are read at a time. Others wait, within the time of a request.
const AT_A_TIME: usize = 2;
const READ_WITHIN: Span = Span::from_secs(8);

/// All vehicles, their recordings and what-ifs.
#[derive(Debug, Clone)]
pub struct Everything {
    shared: Shared,
    /// The folder of the recordings.
    recordings: PathBuf,
    /// The server of their replays.
    replays: Router,
    /// Permits to read a history.
    histories: Arc<Semaphore>,
    /// `None` where no configuration can be read.
    what_ifs: Option<Arc<WhatIfs>>,
}

impl Everything {
    /// `data`: the data folder. `replays`: makes the server of the replays of a folder.
    pub fn new(shared: Shared, data: &Path, replays: impl FnOnce(PathBuf) -> Router) -> Everything {
        let (recordings, histories) = (data.join(recordings::FOLDER), Arc::new(Semaphore::new(AT_A_TIME)));
        let replays = replays(recordings.clone());
        Everything { shared, recordings, replays, histories, what_ifs: None }
    }

    pub fn with_what_ifs(self, data: &Path, examiner: Examiner) -> Everything {
        let what_ifs = WhatIfs::open(data, self.shared.clock, examiner);
        Everything { what_ifs: Some(what_ifs), ..self }
    }
}

/// The console, as one session sees it.
#[derive(Debug)]
pub struct View {
    pub console: Console,
    pub session: Session,
}

impl FromRequestParts<Console> for View {
    type Rejection = HttpError;

    async fn from_request_parts(parts: &mut Parts, console: &Console) -> Result<View, HttpError> {
        let SignedIn(session) = SignedIn::from_request_parts(parts, console).await?;
        Ok(View { console: console.clone(), session })
    }
}

impl View {
    fn all(&self) -> &Everything {
        &self.console.fleet
    }

    pub fn may(&self, role: Role, vehicle: &str) -> bool {
        self.session.has(role, vehicle)
    }

    /// For a moment, as all wait for it.
    pub fn fleet(&self) -> Seen<'_> {
        Seen { fleet: self.all().shared.fleet(), session: &self.session }
    }

    /// The vehicles that a search finds, the worst first.
    pub fn found(&self, q: &Search) -> Vec<Row> {
        let mut rows = self.fleet().rows(self.console.clock.now());
        rows.retain(|row| q.finds(row));
        rows
    }

    /// Somebody looks at the present of a vehicle, which tells each change at once for a minute then.
    pub async fn look(&self, id: &VehicleId) {
        let is_seen = self.fleet().vehicle(id).is_ok();
        if is_seen {
            self.all().shared.look(id).await;
        }
    }

    /// Reads what a vehicle told of a time by its own clock, in milliseconds since 1970.
    ///
    /// # Errors
    /// There is no such vehicle, or the hub does not answer.
    pub async fn history(&self, id: &VehicleId, from: i64, to: i64) -> Result<Known, HttpError> {
        let (skew_ms, told) = {
            let fleet = self.fleet();
            let vehicle = fleet.vehicle(id)?;
            let told = vehicle
                .picture
                .end
                .filter(|_| vehicle.picture.at_ms.is_some_and(|ms| (from..=to).contains(&ms)));
            (vehicle.skew_ms().unwrap_or(0), told)
        };
        let logs = self.all().shared.logs().ok_or(HttpError::Unavailable)?;
        let until = self.console.clock.now() + READ_WITHIN;
        let read = self.console.clock.by(until, async {
            let _turn = self.all().histories.acquire().await.map_err(|error| error.to_string())?;
            history::read(&logs, id, from, to, skew_ms).await
        });
        let read = read.await.ok_or(HttpError::TooSlow)?;
        let mut known = read.map_err(|why| {
            tracing::warn!("a history cannot be read: {why}");
            HttpError::Unavailable
        })?;
        if let Some(end) = told {
            known.was_told(end);
        }
        Ok(known)
    }

    /// The file of a recording, if it is here.
    ///
    /// # Errors
    /// There is no such vehicle.
    pub fn recording(&self, id: &VehicleId, number: u64) -> Result<PathBuf, HttpError> {
        self.fleet().vehicle(id)?;
        Ok(path_of(&self.all().recordings, id, number))
    }

    /// The server of the replays of recordings that are here.
    pub fn replays(&self) -> &Router {
        &self.all().replays
    }

    /// # Errors
    /// No configuration can be read here.
    pub fn what_ifs(&self) -> Result<SeenWhatIfs<'_>, HttpError> {
        let all = self.all().what_ifs.as_ref().ok_or(HttpError::NotFound)?;
        Ok(SeenWhatIfs { all, session: &self.session })
    }
}

/// The vehicles of a session.
pub struct Seen<'a> {
    fleet: MutexGuard<'a, Fleet>,
    session: &'a Session,
}

impl Seen<'_> {
    /// # Errors
    /// There is none, or the session does not see it: nobody learns which.
    pub fn vehicle(&self, id: &VehicleId) -> Result<&Vehicle, HttpError> {
        let seen = self.session.sees(id.as_str());
        self.fleet.vehicle(id).filter(|_| seen).ok_or(HttpError::NotFound)
    }

    pub fn row(&self, vehicle: &Vehicle, now: Timestamp) -> Row {
        self.fleet.row(vehicle, now)
    }

    /// The worst first.
    pub fn rows(&self, now: Timestamp) -> Vec<Row> {
        let mut rows = self.fleet.rows(now);
        rows.retain(|row| self.session.sees(&row.id));
        rows
    }

    pub fn incidents(&self) -> Vec<IncidentRow> {
        let mut rows = self.fleet.incidents();
        rows.retain(|row| self.session.sees(&row.vehicle));
        rows
    }

    pub fn hub_is_down(&self) -> bool {
        self.fleet.line().up_since.is_none()
    }

    /// Whether the recording of an incident may be asked for.
    ///
    /// # Errors
    /// Why not.
    pub fn may_ask(&self, id: &VehicleId, number: u64) -> Result<(), HttpError> {
        self.vehicle(id)?;
        self.fleet.may_ask(id, number).map_err(|why| match why {
            NotAsked::NoIncident => HttpError::NotFound,
            NotAsked::NoRecording => HttpError::Unfinished,
            NotAsked::TooMany => HttpError::TooMany,
        })
    }

    /// Asks for it, if that may be.
    ///
    /// # Errors
    /// Why not.
    pub fn ask(&mut self, id: &VehicleId, number: u64, now_ms: i64) -> Result<(), HttpError> {
        self.may_ask(id, number)?;
        self.fleet.ask(id, number, now_ms);
        Ok(())
    }

    /// It was removed here.
    pub fn recording_removed(&mut self, id: &VehicleId, number: u64) {
        if self.vehicle(id).is_ok() {
            self.fleet.recording_removed(id, number);
        }
    }
}

/// The what-ifs that a session sees: it sees every vehicle of their groups.
pub struct SeenWhatIfs<'a> {
    all: &'a Arc<WhatIfs>,
    session: &'a Session,
}

impl SeenWhatIfs<'_> {
    fn sees(&self, what_if: &WhatIf) -> bool {
        let is_whole = || what_if.vehicles.iter().all(|id| self.session.sees(id));
        // A what-if of an older version does not name its vehicles.
        !self.session.is_of_guest() || !what_if.vehicles.is_empty() && is_whole()
    }

    /// Makes something of all, the newest first.
    pub fn each<T>(&self, mut of: impl FnMut(&WhatIf) -> T) -> Vec<T> {
        let seen = |it: &WhatIf| self.sees(it).then(|| of(it));
        self.all.each(seen).into_iter().flatten().collect()
    }

    /// Makes something of the one with the number in an address.
    ///
    /// # Errors
    /// It is not, or no longer, kept, or the session does not see it.
    pub fn with<T>(&self, number: &str, of: impl FnOnce(&WhatIf) -> T) -> Result<T, HttpError> {
        let seen = |it: &WhatIf| self.sees(it).then(|| of(it));
        let number = number.parse().ok();
        number.and_then(|number| self.all.with(number, seen)).flatten().ok_or(HttpError::NotFound)
    }

    /// Whether the session may start one over these vehicles, or end it.
    pub fn may_run(&self, what_if: &WhatIf) -> bool {
        match self.session.is_of_guest() {
            true => {
                let mut vehicles = what_if.vehicles.iter();
                vehicles.len() > 0 && vehicles.all(|id| self.session.has(Role::Engineer, id))
            }
            false => self.session.role == Role::Engineer,
        }
    }

    pub fn has_room(&self) -> bool {
        self.all.has_room(&self.session.user)
    }

    /// Starts one, and returns its number. `None`: there is no room, or the session may not.
    pub async fn start(&self, what_if: WhatIf) -> Option<u64> {
        if !self.may_run(&what_if) {
            return None;
        }
        let all = self.all.clone();
        tokio::task::spawn_blocking(move || all.start(what_if)).await.ok()?
    }

    /// Ends one, which the session may.
    pub async fn cancel(&self, number: u64) {
        if self.all.with(number, |it| self.may_run(it)) == Some(true) {
            let all = self.all.clone();
            // A fault is in the log, and the page shows whether it goes on.
            let _ = tokio::task::spawn_blocking(move || all.cancel(number)).await;
        }
    }
}
