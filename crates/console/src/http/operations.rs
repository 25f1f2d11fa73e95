//! The routes of the console for programs, in words and types, and the OpenAPI document that is made of them.

use axum::http::HeaderMap;
use axum::response::Response;
use axum::{Extension, http::Method};
use serde_json::Value;
use telltale_store::Role;
use telltale_web::Access;
use telltale_web::common::SignedIn;
use telltale_web::describe::{self, About, Content, Described, Description, OPENAPI, Operation, Tag, of};

use super::answers::{IncidentsAsked, OwnIncident, SnapshotAnswer, SnapshotAsked, TableAsked, VehiclesAsked};
use super::grouped::CauseGroup;
use super::history::{HistoryAnswer, HistoryAsked};
use super::log::LineHtml;
use super::routes;
use super::what_ifs::{Answer, Line, StartForm};
use crate::state::Row;
use crate::state::incidents::Group;

const ABOUT: About = About {
    title: "Telltale, the console of a fleet",
    text: "The interface of a fleet's console for programs. Programs send `Authorization: Bearer TOKEN`, with a token from \
        `telltale user token NAME`. Nothing here acts on a vehicle. Errors are `{\"error\": \"...\"}`.\n\nThe version of the \
        interface is the `1` in its paths. Within it routes, parameters, keys and words may be added, and none is removed or \
        changes its meaning: take no notice of what you do not know.",
    token: "Of `telltale user token NAME`.",
};

/// Everybody who may use a console.
const EACH: Access = Access::Roles(&Role::OF_CONSOLE);

/// A described route: its method, its roles, and its words.
pub type Told = (Method, Access, &'static Operation);

const VEHICLE: (&str, &str, &str) = ("id", "The name of a vehicle on the hub.", "shuttle-03");
const NUMBER: (&str, &str, &str) = ("number", "The number of an incident of this vehicle.", "7");
const BAD_QUERY: (u16, &str) =
    (400, "A parameter is unknown or has a wrong value; the answer says what to write.");
const NO_VEHICLE: (u16, &str) = (404, "No such vehicle was heard.");
const TOO_SLOW: (u16, &str) = (408, "The hub does not give out the log in time. Ask for a shorter time.");
const NO_HUB: (u16, &str) = (503, "The hub does not answer, and the log lies there. Try again.");

const OF_VEHICLE: Operation = Operation { in_path: &[VEHICLE], ..Operation::PLAIN };
const OF_INCIDENT: Operation =
    Operation { tag: Tag::Incidents, in_path: &[VEHICLE, NUMBER], ..Operation::PLAIN };

pub const VEHICLES: Told = (
    Method::GET,
    EACH,
    &Operation {
        id: "vehicles",
        tag: Tag::Tables,
        summary: "All vehicles",
        about: "Each in one line, the one that needs somebody most first.",
        query: Some(of::<VehiclesAsked>),
        answer: Content::Table(of::<Vec<Row>>),
        refusals: &[BAD_QUERY],
        example: "?q=lidar&format=csv",
        ..Operation::PLAIN
    },
);

pub const SNAPSHOT: Told = (
    Method::GET,
    EACH,
    &Operation {
        id: "snapshot",
        summary: "What all nodes of a vehicle show",
        about: "From its last keyframe and what changed since; `at` asks for a moment of its log.",
        query: Some(of::<SnapshotAsked>),
        answer: Content::Json(of::<SnapshotAnswer>),
        refusals: &[
            BAD_QUERY,
            (404, "No such vehicle was heard, or the moment is still to come."),
            TOO_SLOW,
            NO_HUB,
        ],
        example: "?at=2026-11-20T12:00:00Z",
        ..OF_VEHICLE
    },
);

pub const HISTORY: Told = (
    Method::GET,
    EACH,
    &Operation {
        id: "history",
        tag: Tag::Tables,
        summary: "What a vehicle told between two instants",
        about: "By its own clock; without an instant of the last hour. `unknown` lists the gaps in between.",
        query: Some(of::<HistoryAsked>),
        answer: Content::Table(of::<HistoryAnswer>),
        refusals: &[BAD_QUERY, NO_VEHICLE, TOO_SLOW, NO_HUB],
        example: "?from=2026-11-20T12:00:00Z",
        ..OF_VEHICLE
    },
);

pub const LOG: Told = (
    Method::GET,
    EACH,
    &Operation {
        id: "log",
        tag: Tag::Tables,
        summary: "The log of a vehicle as people read it",
        about: "Alarms, stages, the ends of Telltale, and the gaps, the oldest first.",
        query: Some(of::<HistoryAsked>),
        answer: Content::Table(of::<Vec<LineHtml>>),
        refusals: &[BAD_QUERY, NO_VEHICLE, TOO_SLOW, NO_HUB],
        example: "?from=2026-11-20T12:00:00Z&format=csv",
        ..OF_VEHICLE
    },
);

pub const INCIDENTS_OF_VEHICLE: Told = (
    Method::GET,
    EACH,
    &Operation {
        id: "vehicle_incidents",
        tag: Tag::Incidents,
        summary: "The incidents of a vehicle",
        about: "The newest first, with how their recordings came so far.",
        query: Some(of::<TableAsked>),
        answer: Content::Table(of::<Vec<OwnIncident>>),
        refusals: &[BAD_QUERY, NO_VEHICLE],
        example: "?format=csv",
        ..OF_VEHICLE
    },
);

pub const GROUPS: Told = (
    Method::GET,
    EACH,
    &Operation {
        id: "groups",
        tag: Tag::Tables,
        summary: "The vehicles that are not well, by cause",
        about: "The worst group first, then the largest. Vehicles that are not heard are grouped by that.",
        query: Some(of::<VehiclesAsked>),
        answer: Content::Table(of::<Vec<CauseGroup<'static>>>),
        refusals: &[BAD_QUERY],
        example: "?format=csv",
        ..Operation::PLAIN
    },
);

pub const INCIDENTS: Told = (
    Method::GET,
    EACH,
    &Operation {
        id: "incidents",
        tag: Tag::Incidents,
        summary: "The incidents of all vehicles in groups",
        about: "The largest group first.",
        query: Some(of::<IncidentsAsked>),
        answer: Content::Table(of::<Vec<Group>>),
        refusals: &[BAD_QUERY],
        example: "?group=version",
        ..Operation::PLAIN
    },
);

pub const FETCH: Told = (
    Method::POST,
    Access::Roles(&[Role::Engineer]),
    &Operation {
        id: "fetch",
        summary: "Ask a vehicle for the recording of an incident",
        about: "The console asks until the vehicle answers. It is no order: the vehicle's configuration decides.",
        answer: Content::Begun,
        refusals: &[
            (404, "The vehicle told of no such incident."),
            (409, "It is still recorded."),
            (429, "Too many recordings are awaited."),
            (503, "The audit log takes no record, so nothing was asked for."),
        ],
        ..OF_INCIDENT
    },
);

pub const RECORDING: Told = (
    Method::GET,
    Access::Roles(&[Role::Engineer, Role::Authority]),
    &Operation {
        id: "recording",
        summary: "The recording of an incident",
        about: "An MCAP file; ranges of it too.",
        answer: Content::Mcap,
        refusals: &[(404, "It is not here."), (503, "The audit log takes no record, so nothing is sent.")],
        ..OF_INCIDENT
    },
);

const WHAT_IF_NUMBER: (&str, &str, &str) = ("number", "The number of a what-if.", "3");

pub const WHAT_IFS: Told = (
    Method::GET,
    EACH,
    &Operation {
        id: "what_ifs",
        tag: Tag::Incidents,
        summary: "The what-ifs over groups of incidents",
        about: "Those that are kept, the newest first.",
        query: Some(of::<TableAsked>),
        answer: Content::Table(of::<Vec<Line>>),
        refusals: &[BAD_QUERY],
        example: "?format=csv",
        ..Operation::PLAIN
    },
);

pub const WHAT_IF: Told = (
    Method::GET,
    EACH,
    &Operation {
        id: "what_if",
        tag: Tag::Incidents,
        summary: "The result of a what-if so far",
        about: "A CSV has its rows alone: one for each recording that was judged.",
        in_path: &[WHAT_IF_NUMBER],
        query: Some(of::<TableAsked>),
        answer: Content::Table(of::<Answer>),
        refusals: &[BAD_QUERY, (404, "It is not, or no longer, kept.")],
        example: "?format=csv",
        ..Operation::PLAIN
    },
);

pub const WHAT_IF_START: Told = (
    Method::POST,
    Access::Roles(&[Role::Engineer]),
    &Operation {
        id: "what_if_start",
        tag: Tag::Incidents,
        summary: "Judge the fetched recordings of a group by another configuration",
        about: "In the background, one after the other. The answer has its `number`. No vehicle takes notice of it.",
        form: Some(of::<StartForm>),
        answer: Content::Begun,
        refusals: &[
            (404, "There is no such group."),
            (409, "No recording of the group is here."),
            (413, "The configuration is larger than 256 KiB."),
            (422, "A field lacks or is wrong."),
            (429, "The last one of this user is not over, or too many wait."),
            (503, "The audit log takes no record, so nothing was started."),
        ],
        example: "group=cause&of=sensors/lidar&name=vehicle.yaml&text=groups:",
        ..Operation::PLAIN
    },
);

pub const WHAT_IF_CANCEL: Told = (
    Method::POST,
    Access::Roles(&[Role::Engineer]),
    &Operation {
        id: "what_if_cancel",
        tag: Tag::Incidents,
        summary: "End a what-if before its end",
        about: "The result so far stays.",
        in_path: &[WHAT_IF_NUMBER],
        answer: Content::Begun,
        refusals: &[
            (404, "It is not, or no longer, kept."),
            (503, "The audit log takes no record, so it goes on."),
        ],
        ..Operation::PLAIN
    },
);

pub const DOCUMENT: Told = (
    Method::GET,
    EACH,
    &Operation {
        id: "openapi",
        tag: Tag::Description,
        summary: "This document",
        about: "It says nothing about the vehicles.",
        answer: Content::Description(OPENAPI),
        ..Operation::PLAIN
    },
);

pub const HEALTHZ: Told = (
    Method::GET,
    Access::Open,
    &Operation {
        id: "healthz",
        tag: Tag::Session,
        summary: "Whether the console runs",
        answer: Content::Text,
        ..Operation::PLAIN
    },
);

pub const READYZ: Told = (
    Method::GET,
    Access::Open,
    &Operation {
        id: "readyz",
        tag: Tag::Session,
        summary: "Whether the console works",
        about: "Also while the hub is away.",
        answer: Content::Text,
        refusals: &[(503, "Its store does not answer.")],
        ..Operation::PLAIN
    },
);

/// The OpenAPI document of all routes that are for programs.
pub fn document(secure: bool) -> Value {
    let routes = routes();
    let all = routes.iter().flat_map(|route| route.told.iter().map(move |told| (route.path, told)));
    let all = all.map(|(path, (method, access, operation))| Described {
        method: method.clone(),
        path,
        access: *access,
        operation,
    });
    describe::document(&ABOUT, all, secure)
}

/// `GET /api/v1/openapi.json`
pub async fn openapi(_: SignedIn, description: Extension<Description>, headers: HeaderMap) -> Response {
    describe::openapi(description, headers).await
}
