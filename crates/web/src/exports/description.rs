//! The description of the interface itself: the OpenAPI document and the schemas.

use axum::Extension;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use serde_json::Value;

use crate::api::Description;
use crate::live::frame;

/// The media type of the OpenAPI document.
pub const OPENAPI: &str = "application/vnd.oai.openapi+json;version=3.1";
/// The media type of a JSON Schema.
pub const SCHEMA: &str = "application/schema+json";

/// `GET /api/v1/openapi.json`
pub async fn openapi(Extension(Description(document)): Extension<Description>) -> Response {
    ([(CONTENT_TYPE, OPENAPI)], document.to_string()).into_response()
}

/// `GET /api/v1/schema/snapshot.json`
pub async fn snapshot_schema() -> Response {
    schema(&frame::snapshot_schema())
}

/// `GET /api/v1/schema/stream.json`
pub async fn stream_schema() -> Response {
    schema(&frame::stream_schema())
}

fn schema(schema: &Value) -> Response {
    ([(CONTENT_TYPE, SCHEMA)], schema.to_string()).into_response()
}
