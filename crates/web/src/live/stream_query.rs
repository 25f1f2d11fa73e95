//! The address of the stream for programs, and the answer to a request for it without a WebSocket.

use axum::http::header::{CONNECTION, HOST, SEC_WEBSOCKET_VERSION, UPGRADE};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use schemars::JsonSchema;
use serde::Deserialize;

use super::frame::Form;
use crate::AppState;
use crate::http::respond::header;

/// The form of a stream. A key in the address is enough; its value says nothing.
#[derive(Debug, Deserialize, JsonSchema)]
pub struct StreamQuery {
    /// Groups without their modules.
    groups: Option<String>,
    /// First the whole, then what changed.
    deltas: Option<String>,
}

impl StreamQuery {
    pub(super) fn form(&self) -> Form {
        Form { groups: self.groups.is_some(), deltas: self.deltas.is_some() }
    }
}

/// The answer to a request for the stream that opens no WebSocket.
pub(super) fn how_to_stream(app: &AppState, headers: &HeaderMap) -> Response {
    let scheme = if app.settings.secure { "wss" } else { "ws" };
    let host = header(headers, HOST.as_str()).unwrap_or("VEHICLE");
    let text = HOW_TO_STREAM.replace("URL", &format!("{scheme}://{host}/api/v1/stream"));
    let headers = [(UPGRADE, "websocket"), (CONNECTION, "upgrade"), (SEC_WEBSOCKET_VERSION, "13")];
    (StatusCode::UPGRADE_REQUIRED, headers, text).into_response()
}

const HOW_TO_STREAM: &str = "\
This address is a WebSocket: each message is the state of the vehicle as JSON.
Connect to URL with the header `Authorization: Bearer TOKEN`,
with a token from `telltale user token NAME`. In Python, with the package websockets:

    import json
    from websockets.sync.client import connect

    with connect(\"URL\", additional_headers={\"Authorization\": \"Bearer TOKEN\"}, max_size=None) as stream:
        for message in stream:
            print(json.loads(message)[\"overall\"])

?groups leaves out the modules, ?deltas sends only what changed. A browser or a program with a session cookie
sends the header Origin as well. /api/v1/schema/stream.json is the JSON Schema of the messages.
GET /api/v1/snapshot answers the state once.
";
