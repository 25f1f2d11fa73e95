//! The description of each route for programs: its parameters and answers, in words and types. The table of routes
//! refers to these.

mod incidents;
mod operator;

pub use incidents::{INCIDENT, INCIDENTS, KEEP, MARK, NOTE, RECORDING};
pub use operator::{
    ACKNOWLEDGE, ACKNOWLEDGE_OVER, CLEARANCE, CONFIRM_CLEARANCE, CONFIRM_RELEASE, LOCALIZE, LOGIN, LOGOUT,
    RELEASE, RESET, SHELVE, SHUTDOWN, STOP, UNSHELVE, WITHDRAW,
};

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde_json::json;

use super::audit::{AuditAnswer, AuditAsked};
use super::history::{HistoryAnswer, HistoryAsked};
use super::openapi;
use super::operation::{Content, Operation, Tag};
use super::statistics::{StatisticsAnswer, StatisticsAsked};
use super::statuses::{StatusesAnswer, StatusesAsked};
use super::topics::{TopicsAnswer, TopicsAsked};
use super::values::{ValuesAnswer, ValuesAsked};
use crate::live::frame::{SnapshotSchema, StreamMessage};
use crate::live::stream_query::StreamQuery;
use crate::schema::of;

const BAD_QUERY: (u16, &str) = (400, "A parameter is unknown or has a wrong value; the answer names it.");
const LOCKED: (u16, &str) = (409, "The vehicle is locked: no diagnosis is shown before an operator logs in.");
const UNAVAILABLE: (u16, &str) = (503, "It cannot be read now. Try again.");
/// Of forms.
const BAD_FORM: (u16, &str) = (422, "A field is missing or wrong; the answer names it.");

pub const SNAPSHOT: Operation = Operation {
    id: "snapshot",
    summary: "The state of the vehicle",
    about: "What the operator's page shows, as one object. While the vehicle is locked its lists are empty. An \
        answer that would be larger than 16 MiB leaves something out and says so in `left_out`.",
    answer: Content::Json(of::<SnapshotSchema<'static>>),
    ..Operation::PLAIN
};

pub const STREAM: Operation = Operation {
    id: "stream",
    summary: "The state of the vehicle, live",
    about: "A WebSocket. Each message is a snapshot, or with `?deltas` what changed since the message before. A \
        program that reads slowly skips states. Not described by OpenAPI: the messages; their schema is in \
        `x-messages` and at `/api/v1/schema/stream.json`.",
    query: Some(of::<StreamQuery>),
    answer: Content::Stream(of::<StreamMessage<'static>>),
    refusals: &[(503, "The user has too many streams open.")],
    ..Operation::PLAIN
};

pub const STATUSES: Operation = Operation {
    id: "statuses",
    tag: Tag::Tables,
    summary: "The modules as a table",
    about: "Each module as in a snapshot, filtered, in pages.",
    query: Some(of::<StatusesAsked>),
    answer: Content::Table(of::<StatusesAnswer<'static>>),
    refusals: &[BAD_QUERY, LOCKED],
    example: "?level=abnormal&format=csv",
    ..Operation::PLAIN
};

pub const HISTORY: Operation = Operation {
    id: "history",
    tag: Tag::Tables,
    summary: "What happened between two instants",
    about: "States of nodes, stages, signals and alarms, the oldest first, in pages. A program that goes on with \
        `after` gets each record once.",
    query: Some(of::<HistoryAsked>),
    answer: Content::Table(of::<HistoryAnswer<'static>>),
    refusals: &[BAD_QUERY, LOCKED, UNAVAILABLE],
    example: "?node=sensors&since=2026-11-20T12:00:00Z&count=100",
    ..Operation::PLAIN
};

pub const STATISTICS: Operation = Operation {
    id: "statistics",
    tag: Tag::Tables,
    summary: "The alarms between two instants summed up, and the time in each stage",
    about: "As ISA-18.2 counts: alarms an hour, on 100 km and in ten minutes, how soon they were acknowledged, and of each \
        node how many, how long, the mean time between failures and whether it chatters; all of it by version of \
        Telltale too. Without `since` of a week. Of days whose records are gone, the whole day counts. A CSV has the \
        nodes.",
    query: Some(of::<StatisticsAsked>),
    answer: Content::Table(of::<StatisticsAnswer<'static>>),
    refusals: &[BAD_QUERY, LOCKED, UNAVAILABLE],
    example: "?since=2026-11-20T12:00:00Z",
    ..Operation::PLAIN
};

pub const VALUES: Operation = Operation {
    id: "values",
    tag: Tag::Tables,
    summary: "The numbers of a module in the last five minutes, or over days",
    about: "The numbers that the page of a node draws. Without an instant those of the last five minutes: one row for \
        each number, every two seconds. With `since` or `until` each minute, of more than two days each hour, with the \
        least, the mean by time and the greatest; `resolution` chooses otherwise. When the minutes are too many for \
        their room, the oldest become hours, and much later the oldest hours are removed: `minutes_since` and \
        `hours_since` say from when on there are any. Numbers that are not finite are left out.",
    query: Some(of::<ValuesAsked>),
    answer: Content::Table(of::<ValuesAnswer<'static>>),
    refusals: &[BAD_QUERY, (404, "There is no such module."), LOCKED, UNAVAILABLE],
    example: "?node=sensors/velodyne_packet_alive&since=2026-11-20T12:00:00Z&format=csv",
    ..Operation::PLAIN
};

pub const TOPICS: Operation = Operation {
    id: "topics",
    tag: Tag::Tables,
    summary: "The topics that discovery sees",
    about: "With their publishers and subscribers, and why these do not match.",
    query: Some(of::<TopicsAsked>),
    answer: Content::Table(of::<TopicsAnswer<'static>>),
    refusals: &[BAD_QUERY, LOCKED],
    example: "?q=diagnostics",
    ..Operation::PLAIN
};

pub const AUDIT: Operation = Operation {
    id: "audit",
    tag: Tag::Tables,
    summary: "The audit log",
    about: "Who did what, the newest first, in pages.",
    query: Some(of::<AuditAsked>),
    answer: Content::Table(of::<AuditAnswer<'static>>),
    refusals: &[BAD_QUERY, UNAVAILABLE],
    example: "?count=20&format=csv",
    ..Operation::PLAIN
};

pub const OPENAPI: Operation = Operation {
    id: "openapi",
    tag: Tag::Description,
    summary: "This document",
    about: "It says nothing about the vehicle. `telltale api` prints it without a server.",
    answer: Content::Description(openapi::OPENAPI),
    ..Operation::PLAIN
};

pub const SNAPSHOT_SCHEMA: Operation = Operation {
    id: "snapshot_schema",
    tag: Tag::Description,
    summary: "The JSON Schema of a snapshot",
    about: "`telltale api snapshot` prints it without a server.",
    answer: Content::Description(openapi::SCHEMA),
    ..Operation::PLAIN
};

pub const STREAM_SCHEMA: Operation = Operation {
    id: "stream_schema",
    tag: Tag::Description,
    summary: "The JSON Schema of the messages of the stream",
    about: "`telltale api stream` prints it without a server.",
    answer: Content::Description(openapi::SCHEMA),
    ..Operation::PLAIN
};

pub const HEALTHZ: Operation = Operation {
    id: "healthz",
    tag: Tag::Session,
    summary: "The process answers",
    answer: Content::Text,
    ..Operation::PLAIN
};

pub const READYZ: Operation = Operation {
    id: "readyz",
    tag: Tag::Session,
    summary: "The engine, the bridge to ROS 2 and the store work",
    answer: Content::Text,
    refusals: &[(503, "They do not.")],
    ..Operation::PLAIN
};

/// A list of these.
fn list<T: JsonSchema>(schemas: &mut SchemaGenerator) -> Schema {
    let items = of::<T>(schemas).to_value();
    let schema = json!({ "type": "array", "items": items });
    schema.try_into().expect("an object is a schema")
}
