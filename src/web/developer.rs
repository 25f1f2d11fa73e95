//! The developer's pages: what was received, why a node shows what it shows, what is hidden, in
//! which ways it is diagnosed, and the configuration.

use axum::extract::{FromRequestParts, Query, State};
use axum::http::StatusCode;
use axum::http::request::Parts;
use axum::response::{Html, IntoResponse, Response};
use serde_json::json;
use tokio::sync::oneshot;

use super::answer::{Reader, Speaks, json_answer, refusal};
use super::frame::permitted;
use super::guard::SignedIn;
use super::pages::page_context;
use super::state::AppState;
use super::view::{self, Asked, PageContext, Window};
use super::wording::Trouble;
use crate::engine::model::Stage;
use crate::runtime::{Published, Reread, Rereading};
use crate::store::Role;

/// What every page of the developer's is made from.
pub struct Visit {
    published: Published,
    context: PageContext,
    asked: Asked,
    reader: Reader,
    may_change: bool,
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
            may_change: session.role == Role::Developer,
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

/// `GET /developer/masking?q=TEXT`
pub async fn masking(visit: Visit) -> Html<String> {
    Html(view::masking_page(&visit.published, &visit.context, &visit.asked))
}

/// `GET /developer/coverage?cell=COLUMN PATH`
pub async fn coverage(visit: Visit) -> Html<String> {
    Html(view::coverage_page(&visit.published, &visit.context, &visit.asked))
}

/// `GET /developer/topics?q=TEXT`
pub async fn topics(State(app): State<AppState>, visit: Visit) -> Html<String> {
    let seen = app.settings.discovery.as_ref().map(|seen| seen.borrow().clone()).unwrap_or_default();
    Html(view::topics_page(&visit.published, &visit.context, &visit.asked, &seen))
}

/// `GET /developer/configuration`: what the file would change, if it were taken now.
pub async fn configuration(State(app): State<AppState>, visit: Visit) -> Response {
    match reread(&app, false).await {
        Ok(read) => {
            let page = view::configuration_page(&visit.published, &read, visit.may_change, &visit.context);
            Html(page).into_response()
        }
        Err(trouble) => refusal(&visit.reader, trouble),
    }
}

/// `POST /developer/configuration/reload`: the file is taken whole, or not at all.
pub async fn reload(State(app): State<AppState>, visit: Visit) -> Response {
    let read = match reread(&app, true).await {
        Ok(read) => read,
        Err(trouble) => return refusal(&visit.reader, trouble),
    };
    let status = if read.problems.is_some() { StatusCode::UNPROCESSABLE_ENTITY } else { StatusCode::OK };
    match visit.reader.speaks {
        Speaks::Json => {
            let Rereading { taken, differences, problems, warnings } = read;
            let answer = json!({
                "taken": taken, "differences": differences, "problems": problems, "warnings": warnings,
            });
            json_answer(status, &answer)
        }
        Speaks::Html => {
            let page = view::configuration_page(&visit.published, &read, true, &visit.context);
            (status, Html(page)).into_response()
        }
    }
}

async fn reread(app: &AppState, take: bool) -> Result<Rereading, Trouble> {
    let rereads = app.settings.rereads.as_ref().ok_or(Trouble::NotFound)?;
    let (reply, answer) = oneshot::channel();
    rereads.send(Reread { take, reply }).await.map_err(|_| Trouble::Unavailable)?;
    answer.await.map_err(|_| Trouble::Unavailable)
}
