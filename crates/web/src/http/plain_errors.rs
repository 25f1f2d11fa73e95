//! Says refusals in the language and the format of the reader: those of the handlers, which have no words yet, and those of
//! the HTTP libraries in plain text.

use axum::extract::Request;
use axum::http::StatusCode;
use axum::http::header::{CONTENT_TYPE, RETRY_AFTER};
use axum::middleware::Next;
use axum::response::Response;

use super::respond::{Reader, refusal};
use crate::texts::HttpError;

/// Gives refusals their words. Pages and JSON pass.
pub async fn in_words(request: Request, next: Next) -> Response {
    let reader = Reader::of(request.uri(), request.headers(), request.extensions());
    let is_configuration = request.uri().path().ends_with("/what-if");
    let plain = next.run(request).await;
    if let Some(&trouble) = plain.extensions().get::<HttpError>() {
        let mut answer = refusal(&reader, trouble);
        answer.headers_mut().extend(plain.headers().clone());
        return answer;
    }
    let kind = plain.headers().get(CONTENT_TYPE).map(|kind| kind.as_bytes().starts_with(b"text/plain"));
    let trouble = match plain.status() {
        StatusCode::BAD_REQUEST => HttpError::BadRequest,
        StatusCode::REQUEST_TIMEOUT => HttpError::TooSlow,
        StatusCode::PAYLOAD_TOO_LARGE if is_configuration => HttpError::LargeConfiguration,
        StatusCode::PAYLOAD_TOO_LARGE => HttpError::TooLarge,
        StatusCode::TOO_MANY_REQUESTS => HttpError::TooMany,
        StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE => HttpError::LongHeader,
        _ => return plain,
    };
    if kind == Some(false) {
        return plain;
    }
    let mut answer = refusal(&reader, trouble);
    if let Some(wait) = plain.headers().get(RETRY_AFTER) {
        answer.headers_mut().insert(RETRY_AFTER, wait.clone());
    }
    answer
}
