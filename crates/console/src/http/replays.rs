//! Replays of the recordings that vehicles sent: the operator's screen and the developer's pages as they were, to read. The
//! server behind is a vehicle's; who sees which recording is decided here.

use std::path::PathBuf;

use axum::Router;
use axum::extract::{Path, Request};
use axum::response::Response;
use telltale_clock::Clock;
use telltale_fleet::message::VehicleId;
use telltale_store::Store;
use telltale_web::common::passed_on;
use telltale_web::texts::HttpError;
use telltale_web::{Origins, ServedFile, ServedFiles, shown_files};

use super::recordings::numbered;
use super::view::View;
use crate::recordings::path_of;

/// The name of a recording in an address: `VEHICLE.NUMBER`.
fn named(name: &str) -> Option<(VehicleId, u64)> {
    let (id, number) = name.split_once('.')?;
    Some((VehicleId::new(id)?, numbered(number)?))
}

/// The server of the replays of all recordings in a folder.
pub fn server(folder: PathBuf, stored: (Store, Clock), origins: Origins, secure: bool) -> Router {
    let files = ServedFiles::new(move |name| {
        let (id, number) = named(name)?;
        let leave = format!("/vehicles/{id}#incident-{number}");
        Some(ServedFile::of_path(format!("{id} #{number}"), leave, path_of(&folder, &id, number)))
    });
    shown_files(files, stored, origins, secure)
}

/// `/replay/VEHICLE.NUMBER` and all behind it.
pub async fn replay(view: View, Path(path): Path<String>, request: Request) -> Result<Response, HttpError> {
    let (id, number) = path.split('/').next().and_then(named).ok_or(HttpError::NotFound)?;
    if !view.recording(&id, number)?.is_file() {
        return Err(HttpError::NoRecording);
    }
    Ok(passed_on(view.replays(), request).await)
}
