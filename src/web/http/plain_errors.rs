//! What the libraries below refuse in bare text, in the words and the form of this server.

use axum::extract::Request;
use axum::http::StatusCode;
use axum::http::header::{CONTENT_TYPE, RETRY_AFTER};
use axum::middleware::Next;
use axum::response::Response;

use super::errors::Trouble;
use super::respond::{Reader, refusal};

/// Lets every answer pass that is a page or JSON.
pub async fn in_words(request: Request, next: Next) -> Response {
    let reader = Reader::of(request.uri(), request.headers());
    let bare = next.run(request).await;
    let kind = bare.headers().get(CONTENT_TYPE).map(|kind| kind.as_bytes().starts_with(b"text/plain"));
    let trouble = match bare.status() {
        StatusCode::BAD_REQUEST => Trouble::BadRequest,
        StatusCode::REQUEST_TIMEOUT => Trouble::TooSlow,
        StatusCode::PAYLOAD_TOO_LARGE => Trouble::TooLarge,
        StatusCode::TOO_MANY_REQUESTS => Trouble::TooMany,
        StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE => Trouble::LongHeader,
        _ => return bare,
    };
    if kind == Some(false) {
        return bare;
    }
    let mut answer = refusal(&reader, trouble);
    if let Some(wait) = bare.headers().get(RETRY_AFTER) {
        answer.headers_mut().insert(RETRY_AFTER, wait.clone());
    }
    answer
}
