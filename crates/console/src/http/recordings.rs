//! The incidents of a vehicle on its page, and their recordings: an engineer asks for one, and takes it as a file.

use axum::extract::{Path, Request};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Redirect, Response};
use serde_json::json;
use telltale_clock::unix_ms;
use telltale_fleet::message::{NotSent, VehicleId};
use telltale_store::Role;
use telltale_store::audit::{Action, Record};
use telltale_web::common::{CameFrom, Reader, Speaks, json_answer, sent_recording};
use telltale_web::texts::console::ConsoleWords;
use telltale_web::texts::{HttpError, Lang};

use super::view::View;
use crate::state::recordings::Step;
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
    /// It can be replayed.
    pub is_here: bool,
}

/// The incidents of a page, and how many more there are.
pub fn incidents(vehicle: &Vehicle, view: &View, lang: Lang) -> (Vec<IncidentHtml>, usize) {
    let may_fetch = view.may(Role::Engineer, vehicle.id.as_str());
    let may_download = may_download(view, &vehicle.id);
    let incident = |(number, it): (&u64, &telltale_fleet::message::Incident)| {
        let step = vehicle.recordings.get(number).map(|it| &it.step);
        let is_here = vehicle.has_recording(*number);
        let may_fetch = may_fetch && it.sha256.is_some();
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
            downloads: is_here && may_download,
            is_here,
        }
    };
    let newest = vehicle.incidents.iter().rev().enumerate();
    let shown =
        newest.filter(|(place, (number, _))| *place < INCIDENTS_MAX || vehicle.has_recording(**number));
    let shown: Vec<IncidentHtml> = shown.map(|(_, it)| incident(it)).collect();
    let more = vehicle.incidents.len() - shown.len();
    (shown, more)
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

fn may_download(view: &View, id: &VehicleId) -> bool {
    [Role::Engineer, Role::Authority].into_iter().any(|role| view.may(role, id.as_str()))
}

/// The vehicle and the incident of an address.
fn named((id, number): (String, String)) -> Result<(VehicleId, u64), HttpError> {
    VehicleId::new(&id).zip(numbered(&number)).ok_or(HttpError::NotFound)
}

/// The number of an incident, which is written in one way alone.
pub fn numbered(text: &str) -> Option<u64> {
    text.parse().ok().filter(|it: &u64| it.to_string() == text)
}

fn record(view: &View, action: Action, source: std::net::IpAddr, on: &(VehicleId, u64)) -> Record {
    Record::of_session(&view.session, action, source).on(format!("{}/{}", on.0, on.1))
}

/// Refuses what the role does not permit, and records that. A vehicle that the session does not see is not there for it.
async fn permitted(view: &View, may: bool, id: &VehicleId, record: &Record) -> Result<(), HttpError> {
    let (why, error) = match () {
        () if may => return Ok(()),
        () if view.session.sees(id.as_str()) => ("the role does not permit it", HttpError::Forbidden),
        () => ("the user does not see this vehicle", HttpError::NotFound),
    };
    view.console.store.record(record.clone().refused(why), None).await;
    Err(error)
}

/// `POST /vehicles/ID/incidents/NUMBER/fetch`: asks the vehicle for the recording.
pub async fn fetch(
    view: View,
    CameFrom(source): CameFrom,
    Path(path): Path<(String, String)>,
    reader: Reader,
) -> Result<Response, HttpError> {
    let on = named(path)?;
    let record = record(&view, Action::RecordingAsked, source, &on);
    permitted(&view, view.may(Role::Engineer, on.0.as_str()), &on.0, &record).await?;
    view.fleet().may_ask(&on.0, on.1)?;
    if !view.console.store.record(record, None).await {
        return Err(HttpError::Storage);
    }
    // Others may have asked meanwhile.
    let now_ms = unix_ms(view.console.clock.wall());
    view.fleet().ask(&on.0, on.1, now_ms)?;
    Ok(match reader.speaks {
        Speaks::Json => json_answer(StatusCode::ACCEPTED, &json!({})),
        Speaks::Html => Redirect::to(&format!("/vehicles/{}#incident-{}", on.0, on.1)).into_response(),
    })
}

/// `GET /vehicles/ID/incidents/NUMBER/recording`: the file, or the range that is asked for.
pub async fn download(
    view: View,
    CameFrom(source): CameFrom,
    Path(path): Path<(String, String)>,
    request: Request,
) -> Result<Response, HttpError> {
    let on = named(path)?;
    let here = {
        let fleet = view.fleet();
        let transfer = fleet.vehicle(&on.0).ok().and_then(|it| it.recordings.get(&on.1));
        match transfer.map(|it| &it.step) {
            Some(Step::Here(pieces)) => Some(pieces.sha256.clone()),
            _ => None,
        }
    };
    let record = record(&view, Action::RecordingExported, source, &on);
    permitted(&view, may_download(&view, &on.0), &on.0, &record).await?;
    let hash = here.ok_or(HttpError::NoRecording)?;
    let file = view.recording(&on.0, on.1)?;
    if !file.is_file() {
        view.fleet().recording_removed(&on.0, on.1);
        return Err(HttpError::NoRecording);
    }
    if !view.console.store.record(record, None).await {
        return Err(HttpError::Storage);
    }
    let name = format!("{}-incident-{}.mcap", on.0, on.1);
    Ok(sent_recording(&file, &name, &hash, request).await)
}
