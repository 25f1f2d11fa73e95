//! The topics that DDS discovery sees, with their publishers and subscribers.

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::query::{Asked, Count};
use super::table::{Format, Table};
use crate::AppState;
use crate::developer::topics::matches;
use crate::developer::topics::wanted::{Wanted, all_wanted};
use crate::texts::HttpError;
use telltale_engine::discovery::{Endpoint, TopicSeen};
use telltale_engine::snapshot::Snapshot;

/// Nodes that are named.
const NODES_MAX: usize = 2000;

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TopicsAsked {
    /// Part of the name of a topic, of a type or of a node.
    #[serde(default)]
    q: String,
    /// How many topics to skip: `next` of the page before.
    #[serde(default)]
    offset: u32,
    /// The largest number of topics to return.
    #[serde(default)]
    count: Count<100, 200>,
    format: Option<Format>,
}

/// Topics by name.
#[derive(Debug, Serialize, JsonSchema)]
pub struct TopicsAnswer<'a> {
    /// Whether discovery has looked yet.
    looked: bool,
    /// Participants other than Telltale's own.
    participants: usize,
    /// The announced nodes.
    nodes: &'a [String],
    topics: &'a [TopicRow<'a>],
    /// Topics beyond those that discovery lists.
    more: usize,
    /// For `offset` of the next page; `null` on the last one.
    next: Option<u64>,
}

#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "Topic")]
pub struct TopicRow<'a> {
    topic: &'a str,
    types: Vec<&'a str>,
    publishers: Vec<End<'a>>,
    subscribers: Vec<End<'a>>,
    /// Messages a second that Telltale received; `null` if it does not read the topic.
    rate_hz: Option<f32>,
    /// The standard deviation of the time from one message to the next, as they arrived, in milliseconds; `null` of fewer
    /// than three.
    jitter_ms: Option<f32>,
    /// The least and the most messages a second that frequency monitors allow without a WARNING; `null`: no limit.
    wanted_min_hz: Option<f64>,
    wanted_max_hz: Option<f64>,
    /// Fewer come than a monitor that matters now wants.
    too_slow: bool,
    /// The modules whose monitors read it.
    monitors: Vec<&'a str>,
    /// Why publishers and subscribers do not match.
    mismatches: Vec<&'static str>,
}

/// A publisher or a subscriber.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "Endpoint")]
pub struct End<'a> {
    /// `null` if no node is announced.
    node: Option<&'a str>,
    participant: &'a str,
    #[serde(rename = "type")]
    type_name: &'a str,
    reliable: bool,
    transient_local: bool,
    /// It is Telltale's.
    ours: bool,
}

const COLUMNS: [&str; 11] = [
    "topic",
    "types",
    "publishers",
    "subscribers",
    "rate_hz",
    "mismatches",
    "jitter_ms",
    "wanted_min_hz",
    "wanted_max_hz",
    "too_slow",
    "monitors",
];

/// `GET /api/v1/topics`
pub async fn get(
    State(app): State<AppState>,
    Asked(asked): Asked<TopicsAsked>,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let published = app.unlocked()?;
    let (snapshot, nothing) = (&*published.snapshot, Wanted::default());
    let wanted = all_wanted(snapshot);
    let seen = app.settings.discovery.as_ref().map(|seen| seen.borrow().clone()).unwrap_or_default();
    let text = asked.q.to_lowercase();
    let found: Vec<&TopicSeen> = seen.topics.iter().filter(|topic| matches(topic, &text)).collect();
    let (offset, count) = (asked.offset as usize, asked.count.0 as usize);
    let of = |topic: &TopicSeen| wanted.get(&*topic.name).unwrap_or(&nothing);
    let rows: Vec<TopicRow<'_>> =
        found.iter().skip(offset).take(count).map(|topic| row(snapshot, topic, of(topic))).collect();
    let next =
        (offset + rows.len() < found.len() && !rows.is_empty()).then_some((offset + rows.len()) as u64);
    let answer = TopicsAnswer {
        looked: seen.at.is_some(),
        participants: seen.participants,
        nodes: &seen.nodes[..seen.nodes.len().min(NODES_MAX)],
        topics: &rows,
        more: seen.more,
        next,
    };
    let table = Table { name: "topics", columns: &COLUMNS, rows: &rows, next };
    Ok(table.answer(Format::of(asked.format, &headers), &answer))
}

fn row<'a>(snapshot: &'a Snapshot, topic: &'a TopicSeen, wanted: &Wanted) -> TopicRow<'a> {
    TopicRow {
        topic: &topic.name,
        types: topic.types(),
        publishers: topic.publishers.iter().map(end).collect(),
        subscribers: topic.subscribers.iter().map(end).collect(),
        rate_hz: topic.rate_hz,
        jitter_ms: topic.jitter_ms,
        wanted_min_hz: wanted.least_hz,
        wanted_max_hz: wanted.most_hz,
        too_slow: wanted.is_too_slow(topic),
        monitors: wanted.monitors.iter().map(|&id| &*snapshot.module(id).0.id).collect(),
        mismatches: topic.mismatches().into_iter().map(|it| it.as_str()).collect(),
    }
}

fn end(end: &Endpoint) -> End<'_> {
    End {
        node: end.node.as_deref(),
        participant: &end.participant,
        type_name: &end.type_name,
        reliable: end.reliable,
        transient_local: end.transient_local,
        ours: end.ours,
    }
}
