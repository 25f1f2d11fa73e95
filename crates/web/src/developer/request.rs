//! A request for a developer page: the snapshot that is shown, and the parameters of its address.

use axum::extract::{FromRequestParts, Query};
use axum::http::request::Parts;

use crate::AppState;
use crate::http::guard::SignedIn;
use crate::http::respond::Reader;
use crate::pages::page_context;
use crate::texts::HttpError;
use crate::view::PageContext;
use crate::view::permitted;
use telltale_runtime::Published;
use telltale_store::Session;

use super::PageQuery;

/// The header by which a page's script asks for all rows, to make a file of them.
const ALL_ROWS: &str = "telltale-all-rows";

/// The parts that every developer page has.
pub struct PageRequest {
    pub published: Published,
    pub context: PageContext,
    pub query: PageQuery,
    pub reader: Reader,
    pub session: Session,
}

impl FromRequestParts<AppState> for PageRequest {
    type Rejection = HttpError;

    async fn from_request_parts(parts: &mut Parts, app: &AppState) -> Result<PageRequest, HttpError> {
        let SignedIn(session) = SignedIn::from_request_parts(parts, app).await?;
        let reader = Reader::of(&parts.uri, &parts.headers, &parts.extensions);
        // A malformed query counts as an empty one.
        let query = Query::<Vec<(String, String)>>::try_from_uri(&parts.uri);
        let query = PageQuery::of(query.map(|Query(pairs)| pairs).unwrap_or_default());
        let is_for_a_file = parts.headers.contains_key(ALL_ROWS);
        Ok(PageRequest {
            published: permitted(&app.published()),
            context: page_context(app, &session, &reader),
            query: if is_for_a_file { query.of_all_rows() } else { query },
            reader,
            session,
        })
    }
}
