//! The developer's pages: what was received, why a node shows what it shows, what is hidden, in
//! which ways it is diagnosed, the configuration, and the audit log.

use axum::extract::rejection::FormRejection;
use axum::extract::{Extension, Form, FromRequestParts, Query, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{Html, IntoResponse, Response};
use serde::Deserialize;
use serde_json::json;
use tokio::sync::oneshot;

use super::answer::{Reader, Speaks, json_answer, refusal};
use super::audit::record_of;
use super::frame::permitted;
use super::guard::{SignedIn, bearer};
use super::login::{Peer, source_of};
use super::pages::page_context;
use super::state::AppState;
use super::view::{self, Asked, AuditPage, PageContext, Window};
use super::wording::Trouble;
use crate::engine::model::Stage;
use crate::engine::time::Span;
use crate::runtime::{Published, Reread, Rereading};
use crate::store::audit::{Action, Record};
use crate::store::{Role, Session, StoreError};

/// What every page of the developer's is made from.
pub struct Visit {
    published: Published,
    context: PageContext,
    asked: Asked,
    reader: Reader,
    session: Session,
}

impl FromRequestParts<AppState> for Visit {
    type Rejection = Response;

    async fn from_request_parts(parts: &mut Parts, app: &AppState) -> Result<Visit, Response> {
        let SignedIn(session) = SignedIn::from_request_parts(parts, app).await?;
        let reader = Reader::of(&parts.uri, &parts.headers);
        // An address that cannot be read asks for nothing.
        let asked = Query::<Vec<(String, String)>>::try_from_uri(&parts.uri);
        Ok(Visit {
            published: permitted(&app.published()),
            context: page_context(app, &session, &reader),
            asked: Asked::of(asked.map(|Query(pairs)| pairs).unwrap_or_default()),
            reader,
            session,
        })
    }
}

/// `GET /developer?q=TEXT&level=STATE&group=PATH&sort=COLUMN&desc=1&page=N&pin=MODULE`
pub async fn statuses(State(app): State<AppState>, visit: Visit) -> Html<String> {
    Html(view::developer_page(&visit.published, &visit.context, &visit.asked, &app.trends))
}

/// `GET /developer/why?node=group/module`
pub async fn why(State(app): State<AppState>, visit: Visit) -> Response {
    let Some(node) = visit.published.snapshot.node(visit.asked.get("node")) else {
        return refusal(&visit.reader, Trouble::NotFound);
    };
    Html(view::why_page(&visit.published, node, &visit.context, &app.trends)).into_response()
}

/// `GET /developer/graph?open=GROUP`
pub async fn graph(visit: Visit) -> Html<String> {
    Html(view::graph_page(&visit.published, &visit.context, &visit.asked))
}

/// `GET /developer/timeline?node=NODE&span=SECONDS&until=MS&at=THOUSANDTHS`
pub async fn timeline(State(app): State<AppState>, visit: Visit) -> Html<String> {
    let Visit { published, context, asked, .. } = visit;
    let window = Window::of(&published, &asked);
    let past = match &app.settings.history {
        // Locked, nothing of the vehicle is shown: not its past either.
        Some(history) if published.snapshot.stage != Stage::Locked => {
            let past = history.past(window.query.clone()).await;
            past.inspect_err(|error| tracing::warn!(%error, "the history cannot be read")).ok()
        }
        _ => None,
    };
    Html(view::timeline_page(&published, &context, &asked, &window, past.as_ref()))
}

/// `GET /developer/masking?q=TEXT&page=N&page-idle=N`
pub async fn masking(visit: Visit) -> Html<String> {
    Html(view::masking_page(&visit.published, &visit.context, &visit.asked))
}

/// `GET /developer/coverage?cell=COLUMN PATH&page=N`
pub async fn coverage(visit: Visit) -> Html<String> {
    Html(view::coverage_page(&visit.published, &visit.context, &visit.asked))
}

/// `GET /developer/topics?q=TEXT&page=N`
pub async fn topics(State(app): State<AppState>, visit: Visit) -> Html<String> {
    let seen = app.settings.discovery.as_ref().map(|seen| seen.borrow().clone()).unwrap_or_default();
    Html(view::topics_page(&visit.published, &visit.context, &visit.asked, &seen))
}

/// `GET /developer/configuration?q=TEXT&file=NUMBER&page=N`: what the file would change, if it were
/// taken now, and what runs.
pub async fn configuration(State(app): State<AppState>, visit: Visit) -> Response {
    match reread(&app, false, None).await {
        Ok(read) => {
            let may_take = visit.session.role == Role::Developer;
            let page = view::configuration_page(
                &visit.published,
                &read,
                may_take.then_some(false),
                &visit.context,
                &visit.asked,
            );
            Html(page).into_response()
        }
        Err(trouble) => refusal(&visit.reader, trouble),
    }
}

/// What the page with the button showed.
#[derive(Debug, Deserialize)]
pub struct ReloadForm {
    shown: Option<String>,
}

/// `POST /developer/configuration/reload`: the file is taken whole, or not at all. A page says by
/// `shown` what it showed, and nothing else is taken; a program may leave that out and takes what
/// there is.
pub async fn reload(
    State(app): State<AppState>,
    peer: Option<Extension<Peer>>,
    headers: HeaderMap,
    visit: Visit,
    form: Result<Form<ReloadForm>, FormRejection>,
) -> Response {
    let shown = form.ok().and_then(|Form(form)| form.shown);
    // A request that does not say which page it looks at was shown nothing.
    let shown = if bearer(&headers).is_some() { shown } else { Some(shown.unwrap_or_default()) };
    let record =
        record_of(&visit.session, Action::Configuration, source_of(peer.map(|Extension(peer)| peer)));
    // Runs to its end also if nobody listens any more: the record says who had it taken.
    let taking = tokio::spawn(have_taken(app, shown, record));
    let (read, found) = match taking.await.unwrap_or(Err(Trouble::Unavailable)) {
        Ok(taken) => taken,
        Err(trouble) => return refusal(&visit.reader, trouble),
    };
    let status = match found {
        Found::Wrong => StatusCode::UNPROCESSABLE_ENTITY,
        Found::Other => StatusCode::CONFLICT,
        Found::Same | Found::Different => StatusCode::OK,
    };
    let is_other = found == Found::Other;
    match visit.reader.speaks {
        Speaks::Json => {
            let Rereading { taken, differences, problems, warnings, digest, .. } = read;
            let answer = json!({
                "taken": taken, "differences": differences, "problems": problems, "warnings": warnings,
                "shown": digest,
            });
            json_answer(status, &answer)
        }
        Speaks::Html => {
            let (visit, offer) = (&visit, Some(is_other));
            let page = view::configuration_page(&visit.published, &read, offer, &visit.context, &visit.asked);
            (status, Html(page)).into_response()
        }
    }
}

/// What a file is, against what runs and what was shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Found {
    Wrong,
    /// It is not what was shown.
    Other,
    /// It means the same as what runs.
    Same,
    Different,
}

impl Found {
    fn of(read: &Rereading, shown: Option<&str>) -> Found {
        match read {
            Rereading { problems: Some(_), .. } => Found::Wrong,
            _ if shown.is_some_and(|shown| shown != read.digest) => Found::Other,
            _ if read.differences.is_empty() => Found::Same,
            _ => Found::Different,
        }
    }

    fn record(self, record: Record, differences: &[String]) -> Record {
        match self {
            Found::Wrong => record.refused("the file is wrong"),
            Found::Other => record.refused("the file is not what was shown"),
            Found::Same => record.on("no difference"),
            Found::Different => {
                let count = differences.len();
                let what = if count == 1 { "difference" } else { "differences" };
                record.on(format!("{count} {what}: {}", differences.join("; ")))
            }
        }
    }
}

/// For a disk that is to take the record of a reload.
const RECORD_WITHIN: Span = Span::from_secs(4);

/// Has the file taken, if it is what was shown. Who asked for what is on the disk before that, so an
/// error means that nothing was changed; what came of it instead is recorded after.
async fn have_taken(
    app: AppState,
    shown: Option<String>,
    record: Record,
) -> Result<(Rereading, Found), Trouble> {
    let _turn = app.reloading.try_lock().map_err(|_| Trouble::Busy)?;
    let glance = reread(&app, false, None).await?;
    let expected = Found::of(&glance, shown.as_deref());
    let until = app.clock.now() + RECORD_WITHIN;
    let before = expected.record(record.clone(), &glance.differences);
    app.write_ahead(None, &before, until, ()).await.map_err(|not_done| not_done.trouble())?;
    // What was glanced at is taken and nothing else, also for whom nothing was shown.
    let shown = shown.unwrap_or(glance.digest);
    let read = match reread(&app, true, Some(shown.clone())).await {
        Ok(read) => read,
        Err(trouble) => {
            app.record(None, before.refused("nobody reads the file any more")).await;
            return Err(trouble);
        }
    };
    let found = Found::of(&read, Some(&shown));
    if found != expected {
        app.record(None, found.record(record, &read.differences)).await;
    }
    Ok((read, found))
}

/// Records on one page of the audit log.
const AUDIT_ROWS: u32 = 100;

/// `GET /developer/audit?before=NUMBER`: the audit log, newest first, and whether its chain is whole.
pub async fn audit(State(app): State<AppState>, visit: Visit) -> Response {
    let before = visit.asked.get("before");
    if !before.is_empty() && visit.asked.number("before").is_none() {
        return refusal(&visit.reader, Trouble::NotFound);
    }
    let before = visit.asked.number("before");
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
            return refusal(&visit.reader, Trouble::Unavailable);
        }
    };
    let is_full = entries.len() == AUDIT_ROWS as usize;
    let older = entries.last().filter(|last| is_full && last.number > 1).map(|last| last.number);
    let page = AuditPage { entries, older, verdict };
    Html(view::audit_page(&visit.published, &page, &visit.context)).into_response()
}

async fn reread(app: &AppState, take: bool, shown: Option<String>) -> Result<Rereading, Trouble> {
    let rereads = app.settings.rereads.as_ref().ok_or(Trouble::NotFound)?;
    let (reply, answer) = oneshot::channel();
    rereads.send(Reread { take, shown, reply }).await.map_err(|_| Trouble::Unavailable)?;
    answer.await.map_err(|_| Trouble::Unavailable)
}
