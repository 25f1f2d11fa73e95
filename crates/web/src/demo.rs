//! The page that switches faults of the simulated machine. A real one does not have it.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

use axum::extract::rejection::FormRejection;
use axum::extract::{Form, State};
use axum::http::StatusCode;
use axum::response::{Html, IntoResponse, Redirect, Response};
use serde::Deserialize;
use serde_json::json;
use tokio::sync::mpsc;

use super::admission::peer::CameFrom;
use super::http::guard::SignedIn;
use super::http::respond::{Reader, Speaks, json_answer};
use super::pages::page_context;
use super::view::{self, DemoFault};
use super::{AppState, Live};
use crate::texts::HttpError;
use telltale_store::audit::{Action, Record};

/// The faults of the simulated machine, and the channel that switches them.
#[derive(Debug)]
pub struct DemoFaults {
    faults: Vec<DemoFault>,
    switch: mpsc::Sender<FaultSwitch>,
    active: Mutex<BTreeSet<&'static str>>,
}

/// Turns one fault on or off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FaultSwitch {
    pub name: &'static str,
    pub active: bool,
}

impl DemoFaults {
    /// The faults that the simulation knows; it receives from `switch`.
    pub fn new(faults: Vec<DemoFault>, switch: mpsc::Sender<FaultSwitch>) -> DemoFaults {
        DemoFaults { faults, switch, active: Mutex::default() }
    }

    fn names(&self) -> Vec<&'static str> {
        self.faults.iter().map(|fault| fault.name).collect()
    }

    /// Switches a fault; false if the simulation does not take it.
    fn set(&self, switch: FaultSwitch) -> bool {
        let mut active = self.active.lock().unwrap_or_else(PoisonError::into_inner);
        if self.switch.try_send(switch).is_err() {
            return false;
        }
        if switch.active {
            active.insert(switch.name)
        } else {
            active.remove(switch.name)
        };
        true
    }
}

/// `GET /demo`
pub async fn page(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Result<Html<String>, HttpError> {
    let faults = app.settings.demo.as_ref().ok_or(HttpError::NotFound)?;
    let active = faults.active.lock().unwrap_or_else(PoisonError::into_inner).clone();
    Ok(Html(view::demo_page(&faults.faults, &active, &page_context(&app, &session, &reader))))
}

#[derive(Debug, Deserialize)]
pub struct FaultForm {
    name: String,
    active: bool,
}

/// `POST /demo/fault`
pub async fn fault(
    app: Live,
    CameFrom(source): CameFrom,
    SignedIn(session): SignedIn,
    reader: Reader,
    form: Result<Form<FaultForm>, FormRejection>,
) -> Result<Response, HttpError> {
    let faults = app.settings.demo.as_ref().ok_or(HttpError::NotFound)?;
    let form = match form {
        Ok(Form(form)) => form,
        Err(rejection) => {
            let wrong = json!({ "error": rejection.body_text(), "names": faults.names() });
            return Ok(json_answer(rejection.status(), &wrong));
        }
    };
    let Some(name) = faults.names().into_iter().find(|name| *name == form.name) else {
        let wrong = json!({ "error": format!("there is no fault {:?}", form.name), "names": faults.names() });
        return Ok(json_answer(StatusCode::UNPROCESSABLE_ENTITY, &wrong));
    };
    if !faults.set(FaultSwitch { name, active: form.active }) {
        return Err(HttpError::Unavailable);
    }
    let record = Record::of_session(&session, Action::Fault, source).on(format!("{name}: {}", form.active));
    if !app.store.record(record, None).await {
        return Err(HttpError::Unavailable);
    }
    Ok(match reader.speaks {
        Speaks::Json => json_answer(StatusCode::OK, &json!({ "name": name, "active": form.active })),
        Speaks::Html => Redirect::to("/demo").into_response(),
    })
}
