//! The guard before every route: the host name, the origin of what is posted, and the session. Routes that need one ask for
//! [`SignedIn`].

use axum::extract::{Request, State};
use axum::http::Method;
use axum::http::header::HOST;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use telltale_store::{Role, Session, Token};
use telltale_web::common::{SignedIn, admitted, bearer, has_own_origin, one_session};
use telltale_web::texts::HttpError;

use super::Console;

impl Console {
    /// The open session of a token, of a user who may use a console.
    fn session(&self, token: &Token) -> Option<Session> {
        let session = self.store.session(token)?;
        let counts = session.expires > self.clock.now() && Role::OF_CONSOLE.contains(&session.role);
        counts.then_some(session)
    }
}

/// The middleware around all routes and unknown paths.
pub async fn guard(State(console): State<Console>, request: Request, next: Next) -> Response {
    let headers = request.headers();
    let host = headers.get(HOST).and_then(|host| host.to_str().ok());
    if !host.is_some_and(|host| console.origins.has_host(host)) {
        return HttpError::ForeignHost.into_response();
    }
    let token = bearer(headers);
    let session = match token {
        Some(token) => Token::parse(token).and_then(|token| console.session(&token)),
        None => one_session(headers, console.secure, |token| console.session(token)),
    };
    let reads = matches!(*request.method(), Method::GET | Method::HEAD);
    if !reads && token.is_none() && !has_own_origin(&console.origins, headers) && is_form(&request) {
        return HttpError::ForeignOrigin.into_response();
    }
    let mut request = match admitted(request, session.as_ref()).await {
        Ok(request) => request,
        Err(trouble) => return trouble.into_response(),
    };
    if let Some(session) = session {
        request.extensions_mut().insert(SignedIn(session));
    }
    next.run(request).await
}

/// The addresses that take a post. All others refuse it.
fn is_form(request: &Request) -> bool {
    let path = request.uri().path();
    let ends = |begin, end| path.starts_with(begin) && path.ends_with(end);
    matches!(path, "/login" | "/logout" | "/incidents/what-if")
        || ends("/vehicles/", "/fetch")
        || ends("/what-ifs/", "/cancel")
}
