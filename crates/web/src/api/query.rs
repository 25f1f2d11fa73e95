//! Parameters of an address: read into a type, or refused with what to write.

use axum::extract::{FromRequestParts, Query};
use axum::http::request::Parts;
use axum::response::Response;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer};

use crate::http::respond::{Reader, bad_query};
use crate::schema::words;

/// The parameters of an address. Unknown ones are for the type to refuse.
#[derive(Debug)]
pub struct Asked<T>(pub T);

impl<T: DeserializeOwned, S: Sync> FromRequestParts<S> for Asked<T> {
    type Rejection = Response;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Asked<T>, Response> {
        match Query::try_from_uri(&parts.uri) {
            Ok(Query(read)) => Ok(Asked(read)),
            Err(rejection) => {
                let text = rejection.body_text();
                let why = text.split_once("query string: ").map_or(&*text, |(_, why)| why);
                Err(bad_query(&Reader::of(&parts.uri, &parts.headers, &parts.extensions), why))
            }
        }
    }
}

/// An instant in an address: milliseconds since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Moment(pub i64);

impl<'de> Deserialize<'de> for Moment {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Moment, D::Error> {
        let text = String::deserialize(deserializer)?;
        let at = humantime::parse_rfc3339_weak(&text).ok();
        let since = at.and_then(|at| at.duration_since(std::time::UNIX_EPOCH).ok());
        let ms = since.and_then(|since| i64::try_from(since.as_millis()).ok());
        ms.map(Moment).ok_or_else(|| D::Error::custom("a time is written as 2026-11-20T12:00:00Z, in UTC"))
    }
}

impl JsonSchema for Moment {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Moment".into()
    }

    fn json_schema(schemas: &mut SchemaGenerator) -> Schema {
        words::time(schemas)
    }
}

/// How many rows an answer may have: one to `MAX`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Count<const UNASKED: u32, const MAX: u32>(pub u32);

impl<const UNASKED: u32, const MAX: u32> Default for Count<UNASKED, MAX> {
    fn default() -> Self {
        Count(UNASKED)
    }
}

impl<'de, const UNASKED: u32, const MAX: u32> Deserialize<'de> for Count<UNASKED, MAX> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        let count = text.parse().ok().filter(|count| (1..=MAX).contains(count));
        count.map(Count).ok_or_else(|| D::Error::custom(format_args!("count is a number from 1 to {MAX}")))
    }
}

impl<const UNASKED: u32, const MAX: u32> JsonSchema for Count<UNASKED, MAX> {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Count".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        schemars::json_schema!({ "type": "integer", "minimum": 1, "maximum": MAX, "default": UNASKED })
    }
}
