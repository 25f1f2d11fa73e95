//! The words on the wire, and times, as JSON Schema.

use schemars::{Schema, SchemaGenerator, json_schema};

use telltale_engine::model::Stage;
use telltale_engine::model::countermeasure::RequestKind;
use telltale_engine::snapshot::{CountermeasureState, Moving};
use telltale_engine::state::State;

/// One of these words.
pub fn of<'a>(words: impl IntoIterator<Item = &'a str>) -> Schema {
    let words: Vec<&str> = words.into_iter().collect();
    json_schema!({ "type": "string", "enum": words })
}

fn of_some<'a>(words: impl IntoIterator<Item = &'a str>) -> Schema {
    let words: Vec<Option<&str>> = words.into_iter().map(Some).chain([None]).collect();
    json_schema!({ "type": ["string", "null"], "enum": words })
}

pub fn state(_: &mut SchemaGenerator) -> Schema {
    of(State::ALL.map(State::as_str))
}

pub fn some_state(_: &mut SchemaGenerator) -> Schema {
    of_some(State::ALL.map(State::as_str))
}

pub fn stage(_: &mut SchemaGenerator) -> Schema {
    of(Stage::ALL.map(Stage::as_str))
}

pub fn some_stage(_: &mut SchemaGenerator) -> Schema {
    of_some(Stage::ALL.map(Stage::as_str))
}

pub fn moving(_: &mut SchemaGenerator) -> Schema {
    of(Moving::ALL.map(Moving::as_str))
}

pub fn request(_: &mut SchemaGenerator) -> Schema {
    of(RequestKind::ALL.map(RequestKind::as_str))
}

pub fn countermeasure_state(_: &mut SchemaGenerator) -> Schema {
    use CountermeasureState::{Engaged, Requested, Unconfirmed};
    of([Requested, Engaged, Unconfirmed].map(CountermeasureState::as_str))
}

pub fn location(_: &mut SchemaGenerator) -> Schema {
    of(["isolated", "contextual"])
}

pub fn information(_: &mut SchemaGenerator) -> Schema {
    of(["meta", "content"])
}

pub fn flow(_: &mut SchemaGenerator) -> Schema {
    of_some(["sequential", "parallel"])
}

/// Wall time in UTC.
pub fn time(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "type": "string", "format": "date-time", "pattern": "Z$", "examples": ["2026-11-20T12:00:00.123Z"] })
}

/// Wall time in UTC, or nothing.
pub fn some_time(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "type": ["string", "null"], "format": "date-time", "pattern": "Z$" })
}
