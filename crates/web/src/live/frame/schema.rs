//! The JSON Schema of a snapshot and of the messages of a stream, of the structs that are sent.

#![expect(
    dead_code,
    reason = "these types say how `Parts` puts the parts together; only their schemas are made"
)]

use schemars::{JsonSchema, Schema};
use serde_json::{Value, json};

use super::json::{Group, Head, Module, Tail};

/// The whole state of the vehicle.
#[derive(JsonSchema)]
#[schemars(transform = is_whole)]
pub struct Snapshot<'a> {
    #[serde(flatten)]
    head: Head<'a>,
    /// The tiles; then statuses that nothing claims, once there are some, and the diagnosis of the diagnosis, once
    /// something is wrong with it. Empty while the vehicle is locked.
    groups: Vec<GroupTree<'a>>,
    #[serde(flatten)]
    tail: Tail<'a>,
}

/// A group with what is in it.
#[derive(JsonSchema)]
struct GroupTree<'a> {
    #[serde(flatten)]
    group: Group<'a>,
    modules: Vec<Module<'a>>,
    groups: Vec<GroupTree<'a>>,
}

/// The whole state of the vehicle without its modules, for `?groups`.
#[derive(JsonSchema)]
#[schemars(transform = is_whole)]
pub struct SnapshotOfGroups<'a> {
    #[serde(flatten)]
    head: Head<'a>,
    groups: Vec<GroupAlone<'a>>,
    #[serde(flatten)]
    tail: Tail<'a>,
}

/// A group without its modules.
#[derive(JsonSchema)]
struct GroupAlone<'a> {
    #[serde(flatten)]
    group: Group<'a>,
    groups: Vec<GroupAlone<'a>>,
}

/// The changes since the message before it, for `?deltas`: groups and modules that changed, wherever they stand in
/// the tree, and each list that changed. Members that are given replace the old ones.
#[derive(JsonSchema)]
#[schemars(transform = is_change)]
pub struct Changes<'a> {
    #[serde(flatten)]
    head: Head<'a>,
    groups: Vec<Group<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    modules: Option<Vec<Module<'a>>>,
    #[serde(flatten)]
    tail: Tail<'a>,
}

/// A message of the stream. One with `base` says what changed; another one replaces everything.
#[derive(JsonSchema)]
#[serde(untagged)]
pub enum StreamMessage<'a> {
    Snapshot(Snapshot<'a>),
    SnapshotOfGroups(SnapshotOfGroups<'a>),
    Changes(Changes<'a>),
}

fn is_whole(schema: &mut Schema) {
    if let Some(properties) = schema.get_mut("properties").and_then(Value::as_object_mut) {
        properties.remove("base");
    }
    for list in ["roots", "alarms", "shelved", "countermeasures", "signals"] {
        requires(schema, list);
    }
    schema.insert("not".to_owned(), json!({ "required": ["base"] }));
}

fn is_change(schema: &mut Schema) {
    requires(schema, "base");
}

fn requires(schema: &mut Schema, name: &str) {
    if let Some(required) = schema.get_mut("required").and_then(Value::as_array_mut) {
        required.push(name.into());
    }
}
