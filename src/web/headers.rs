//! Headers that every answer has.

use axum::extract::Request;
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, HeaderName, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderValue};
use axum::middleware::Next;
use axum::response::Response;

/// Scripts and styles from here only, none inline; nothing may frame a page.
const POLICY: &str = "default-src 'self'; script-src 'self'; style-src 'self'; connect-src 'self'; \
    img-src 'self'; object-src 'none'; base-uri 'none'; frame-ancestors 'none'; form-action 'self'";

const ALWAYS: [(HeaderName, &str); 5] = [
    (CONTENT_SECURITY_POLICY, POLICY),
    (X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (REFERRER_POLICY, "no-referrer"),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    (CACHE_CONTROL, "no-store"),
];

/// The middleware around everything else.
pub async fn secure(request: Request, next: Next) -> Response {
    let mut answer = next.run(request).await;
    set(answer.headers_mut());
    answer
}

/// The same for an answer that no router made, from its bytes: the headers follow its first line.
pub fn dressed(answer: &[u8]) -> Vec<u8> {
    let end = answer.windows(2).position(|pair| pair == b"\r\n");
    let (line, rest) = answer.split_at(end.map_or(0, |end| end + 2));
    let mut dressed = line.to_vec();
    for (name, value) in ALWAYS.into_iter().filter(|_| end.is_some()) {
        dressed.extend_from_slice(format!("{name}: {value}\r\n").as_bytes());
    }
    dressed.extend_from_slice(rest);
    dressed
}

fn set(headers: &mut HeaderMap) {
    for (name, value) in ALWAYS {
        headers.insert(name, HeaderValue::from_static(value));
    }
}
