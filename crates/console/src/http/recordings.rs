//! The incidents of a vehicle on its page, and their recordings: an engineer asks for one, and takes it as a file.

use axum::extract::{Path, Request, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Redirect, Response};
use serde_json::json;
use telltale_clock::unix_ms;
use telltale_fleet::message::{NotSent, VehicleId};
use telltale_store::audit::{Action, Record};
use telltale_store::{Role, Session};
use telltale_web::common::{CameFrom, Reader, SignedIn, Speaks, json_answer, sent_recording};
use telltale_web::texts::console::ConsoleWords;
use telltale_web::texts::{HttpError, Lang};

use super::Console;
use crate::recordings::path_of;
use crate::state::recordings::{NotAsked, Step};
use crate::state::time;
use crate::state::vehicle::Vehicle;

/// Incidents of a page, the newest first; the rest is counted.
const INCIDENTS_MAX: usize = 20;

pub struct IncidentHtml {
    pub number: u64,
    pub at: String,
    pub lasts: bool,
    pub causes: String,
    /// Of its recording, if that is finished.
    pub size: String,
    /// How its recording came so far.
    pub step: &'static str,
    pub words: String,
    pub fetches: bool,
    pub downloads: bool,
}

/// The incidents of a page, and how many more there are.
pub fn incidents(vehicle: &Vehicle, role: Role, lang: Lang) -> (Vec<IncidentHtml>, usize) {
    let incident = |(number, it): (&u64, &telltale_fleet::message::Incident)| {
        let step = vehicle.recordings.get(number).map(|it| &it.step);
        let is_here = matches!(step, Some(Step::Here(_)));
        let may_fetch = role == Role::Engineer && it.sha256.is_some();
        let (name, words) = told(step, lang);
        IncidentHtml {
            number: *number,
            at: time(it.since),
            lasts: it.until.is_none(),
            causes: it.causes.join(", "),
            size: if it.sha256.is_some() { lang.size(it.bytes) } else { String::new() },
            step: name,
            words,
            fetches: may_fetch && !is_here && !step.is_some_and(Step::is_open),
            downloads: is_here && may_download(role),
        }
    };
    let shown = vehicle.incidents.iter().rev().take(INCIDENTS_MAX).map(incident);
    (shown.collect(), vehicle.incidents.len().saturating_sub(INCIDENTS_MAX))
}

/// The step in a word for programs, and in words for people.
pub fn told(step: Option<&Step>, lang: Lang) -> (&'static str, String) {
    let words = ConsoleWords::of(lang);
    let (name, text) = match step {
        None => ("none", ""),
        Some(Step::Asked) => ("asked", words.asked_for),
        Some(Step::Coming { pieces, have }) => {
            return (
                "coming",
                lang.recording_comes(have * 100 / pieces.pieces.max(1), &lang.size(pieces.bytes)),
            );
        }
        Some(Step::Here(_)) => ("here", words.recording_here),
        Some(Step::Refused(NotSent::Never)) => ("refused", words.sent_never),
        Some(Step::Refused(NotSent::Gone)) => ("refused", words.sent_gone),
        Some(Step::Refused(NotSent::NotFinished)) => ("refused", words.sent_not_finished),
        Some(Step::Refused(NotSent::TooLarge)) => ("refused", words.sent_too_large),
        Some(Step::Refused(NotSent::Unknown)) => ("refused", words.sent_unknown),
        Some(Step::Bad(why)) => return ("bad", format!("{} {why}", words.recording_bad)),
        Some(Step::Gone) => ("gone", words.recording_gone),
    };
    (name, text.to_owned())
}

fn may_download(role: Role) -> bool {
    matches!(role, Role::Engineer | Role::Authority)
}

/// The vehicle and the incident of an address.
fn named((id, number): (String, String)) -> Result<(VehicleId, u64), HttpError> {
    let number = number.parse().ok().filter(|it: &u64| it.to_string() == number);
    VehicleId::new(&id).zip(number).ok_or(HttpError::NotFound)
}

fn record(session: &Session, action: Action, source: std::net::IpAddr, on: &(VehicleId, u64)) -> Record {
    Record::of_session(session, action, source).on(format!("{}/{}", on.0, on.1))
}

/// `POST /vehicles/ID/incidents/NUMBER/fetch`: asks the vehicle for the recording.
pub async fn fetch(
    State(console): State<Console>,
    CameFrom(source): CameFrom,
    SignedIn(session): SignedIn,
    Path(path): Path<(String, String)>,
    reader: Reader,
) -> Result<Response, HttpError> {
    let on = named(path)?;
    let asked = |console: &Console| match console.shared.fleet().may_ask(&on.0, on.1) {
        Ok(()) => Ok(()),
        Err(NotAsked::NoIncident) => Err(HttpError::NotFound),
        Err(NotAsked::NoRecording) => Err(HttpError::Unfinished),
        Err(NotAsked::TooMany) => Err(HttpError::TooMany),
    };
    let record = record(&session, Action::RecordingAsked, source, &on);
    if session.role != Role::Engineer {
        console.store.record(record.refused("the role does not permit it"), None).await;
        return Err(HttpError::Forbidden);
    }
    asked(&console)?;
    if !console.store.record(record, None).await {
        return Err(HttpError::Storage);
    }
    // Others may have asked meanwhile.
    asked(&console)?;
    console.shared.fleet().ask(&on.0, on.1, unix_ms(console.clock.wall()));
    Ok(match reader.speaks {
        Speaks::Json => json_answer(StatusCode::ACCEPTED, &json!({})),
        Speaks::Html => Redirect::to(&format!("/vehicles/{}#incident-{}", on.0, on.1)).into_response(),
    })
}

/// `GET /vehicles/ID/incidents/NUMBER/recording`: the file, or the range that is asked for.
pub async fn download(
    State(console): State<Console>,
    CameFrom(source): CameFrom,
    SignedIn(session): SignedIn,
    Path(path): Path<(String, String)>,
    request: Request,
) -> Result<Response, HttpError> {
    let on = named(path)?;
    let here = {
        let fleet = console.shared.fleet();
        let transfer = fleet.vehicle(&on.0).and_then(|it| it.recordings.get(&on.1));
        match transfer.map(|it| &it.step) {
            Some(Step::Here(pieces)) => Some(pieces.sha256.clone()),
            _ => None,
        }
    };
    let record = record(&session, Action::RecordingExported, source, &on);
    if !may_download(session.role) {
        console.store.record(record.refused("the role does not permit it"), None).await;
        return Err(HttpError::Forbidden);
    }
    let file = path_of(&console.recordings, &on.0, on.1);
    let hash = here.ok_or(HttpError::NoRecording)?;
    if !file.is_file() {
        console.shared.fleet().recording_removed(&on.0, on.1);
        return Err(HttpError::NoRecording);
    }
    if !console.store.record(record, None).await {
        return Err(HttpError::Storage);
    }
    let name = format!("{}-incident-{}.mcap", on.0, on.1);
    Ok(sent_recording(&file, &name, &hash, request).await)
}
