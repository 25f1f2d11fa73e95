//! The developer's pages: what was received, why a node shows what it shows, the configuration, and
//! the audit log.

use axum::extract::rejection::QueryRejection;
use axum::extract::{Extension, Query, State};
use axum::http::StatusCode;
use axum::response::{Html, IntoResponse, Response};
use serde::Deserialize;
use serde_json::json;
use tokio::sync::oneshot;

use super::answer::{Reader, Speaks, json_answer, refusal};
use super::audit::record_of;
use super::frame::permitted;
use super::guard::SignedIn;
use super::login::{Peer, source_of};
use super::pages::page_context;
use super::state::AppState;
use super::view::{self, AuditPage};
use super::wording::Trouble;
use crate::runtime::{Reread, Rereading};
use crate::store::audit::Action;
use crate::store::{Role, StoreError};

/// `GET /developer`
pub async fn statuses(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Html<String> {
    Html(view::developer_page(&permitted(&app.published()), &page_context(&app, &session, &reader)))
}

#[derive(Debug, Deserialize)]
pub struct NodeQuery {
    node: String,
}

/// `GET /developer/why?node=group/module`
pub async fn why(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
    Query(query): Query<NodeQuery>,
) -> Response {
    let published = permitted(&app.published());
    let Some(node) = published.snapshot.node(&query.node) else {
        return refusal(&reader, Trouble::NotFound);
    };
    Html(view::why_page(&published, node, &page_context(&app, &session, &reader))).into_response()
}

/// `GET /developer/configuration`: what the file would change, if it were taken now.
pub async fn configuration(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Response {
    match reread(&app, false).await {
        Ok(read) => {
            let may_take = session.role == Role::Developer;
            let context = page_context(&app, &session, &reader);
            Html(view::configuration_page(&read, may_take, &context)).into_response()
        }
        Err(trouble) => refusal(&reader, trouble),
    }
}

/// `POST /developer/configuration/reload`: the file is taken whole, or not at all.
pub async fn reload(
    State(app): State<AppState>,
    peer: Option<Extension<Peer>>,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Response {
    let read = match reread(&app, true).await {
        Ok(read) => read,
        Err(trouble) => return refusal(&reader, trouble),
    };
    let record = record_of(&session, Action::Configuration, source_of(peer.map(|Extension(peer)| peer)));
    let record = match (&read.problems, read.differences.as_slice()) {
        (Some(_), _) => record.refused("the file is wrong"),
        (None, []) => record.on("no difference"),
        (None, differences) => {
            record.on(format!("{} differences: {}", differences.len(), differences.join("; ")))
        }
    };
    if let Err(error) = app.audit(record).await {
        tracing::error!(%error, "a reload cannot be recorded");
        return refusal(&reader, Trouble::Unavailable);
    }
    let status = if read.problems.is_some() { StatusCode::UNPROCESSABLE_ENTITY } else { StatusCode::OK };
    match reader.speaks {
        Speaks::Json => {
            let Rereading { taken, differences, problems, warnings } = read;
            let answer = json!({
                "taken": taken, "differences": differences, "problems": problems, "warnings": warnings,
            });
            json_answer(status, &answer)
        }
        Speaks::Html => {
            let context = page_context(&app, &session, &reader);
            (status, Html(view::configuration_page(&read, true, &context))).into_response()
        }
    }
}

#[derive(Debug, Deserialize)]
pub struct AuditQuery {
    before: Option<u64>,
}

/// Records on one page of the audit log.
const AUDIT_ROWS: u32 = 100;

/// `GET /developer/audit?before=NUMBER`: the audit log, newest first, and whether its chain is whole.
pub async fn audit(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
    query: Result<Query<AuditQuery>, QueryRejection>,
) -> Response {
    let Ok(Query(AuditQuery { before })) = query else { return refusal(&reader, Trouble::NotFound) };
    // One reader at a time: to go through a long chain takes a while.
    let _turn = app.audit_readers.lock().await;
    let read = async {
        let entries = app.store.audit_entries(before, AUDIT_ROWS).await?;
        Ok::<_, StoreError>((entries, app.store.verify_audit().await?))
    };
    let (entries, verdict) = match read.await {
        Ok(read) => read,
        Err(error) => {
            tracing::error!(%error, "the audit log cannot be read");
            return refusal(&reader, Trouble::Unavailable);
        }
    };
    let is_full = entries.len() == AUDIT_ROWS as usize;
    let older = entries.last().filter(|last| is_full && last.number > 1).map(|last| last.number);
    let page = AuditPage { entries, older, verdict };
    Html(view::audit_page(&page, &page_context(&app, &session, &reader))).into_response()
}

async fn reread(app: &AppState, take: bool) -> Result<Rereading, Trouble> {
    let rereads = app.settings.rereads.as_ref().ok_or(Trouble::NotFound)?;
    let (reply, answer) = oneshot::channel();
    rereads.send(Reread { take, reply }).await.map_err(|_| Trouble::Unavailable)?;
    answer.await.map_err(|_| Trouble::Unavailable)
}
