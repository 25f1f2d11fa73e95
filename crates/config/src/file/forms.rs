//! How names, paths and durations are written, for the schema; and the keys that several maps share.

use super::ros_names::PATH_BYTES_MAX;
use crate::describe::words;
use telltale_engine::time;
use telltale_yaml::schema::{Json, default, not_empty, of_type, one_of, pattern};
use telltale_yaml::{KeyDoc, Members, Schema, key};

/// A name with its namespace, as ROS 2 writes it.
const FULL_NAME: &str = "^(/[A-Za-z_][A-Za-z0-9_]*)+$";

pub(super) const ID: KeyDoc = key("id").form(id);
pub(super) const TOPIC: KeyDoc = key("topic").form(topic_name);
pub(super) const TYPE: KeyDoc = key("type").form(type_name);
pub(super) const FIELD: KeyDoc = key("field").form(path);
pub(super) const STATUS: KeyDoc = key("status").about("The exact name of a status.");
pub(super) const KEY: KeyDoc = key("key").about(
    "One of the keys of its values. `12.5` is a number, `true`, `True` and `TRUE` are booleans; UNKNOWN while the status is STALE.",
);
pub(super) const UNIT: KeyDoc = key("unit").about("The unit that may follow the number: `V` of `25.60 V`.");
pub(super) const WRITERS: KeyDoc = key("writers")
    .about("The nodes whose reports of the status count. A report by another node is ignored, and is a WARNING of `telltale`. Whole names, as `ros2 node list` has them.")
    .form(writers);
pub(super) const FORGET_AFTER: KeyDoc = key("forget_after").about(
    "After this long without a report, the last report no longer counts; a module that a filter made leaves. Not shorter than `timeout`; with the same value, a silent module is forgotten at once.",
);

pub(super) fn id(schema: &mut Schema) -> Members {
    schema.define("id", |_| {
        let types = vec!["string", "number"];
        let about = "Part of a node's name.";
        vec![("description", about.into()), ("type", types.into()), ("pattern", "^[A-Za-z0-9_.-]+$".into())]
    })
}

/// A group or a module.
pub(super) fn node(schema: &mut Schema) -> Members {
    let about = "A group or module by its full name: `group`, `group/module`, `group/group/module`.";
    schema.define("node", |_| with_about(about, of_type("string")))
}

pub(super) fn nodes(schema: &mut Schema) -> Members {
    telltale_yaml::schema::list(node(schema))
}

pub(super) fn duration(schema: &mut Schema) -> Members {
    schema.define("duration", |_| {
        let form = pattern("^[0-9]+(\\.[0-9]+)? *(ns|us|µs|ms|s|m|h|d)$");
        example(&["2s", "250ms"], with_about("A number with its unit.", form))
    })
}

pub(super) fn rate(schema: &mut Schema) -> Members {
    schema.define("rate", |_| {
        let types = vec!["number", "string"];
        let form = vec![("type", types.into()), ("pattern", "^-?[0-9.]+ *(Hz)?$".into())];
        example(&["20 Hz"], with_about("In hertz, with or without the unit.", form))
    })
}

pub(super) fn topic_name(schema: &mut Schema) -> Members {
    schema.define("topic_name", |_| example(&["/mission/active"], pattern(FULL_NAME)))
}

pub(super) fn type_name(schema: &mut Schema) -> Members {
    schema.define("type_name", |_| {
        let about = "Without this key, the type is the one that the file gives the topic elsewhere, or that its publisher announces.";
        let form = pattern("^[A-Za-z0-9_]+/msg/[A-Za-z0-9_]+$");
        example(&["std_msgs/msg/Bool"], with_about(about, form))
    })
}

pub(super) fn path(schema: &mut Schema) -> Members {
    schema.define("path", |_| {
        let form = [of_type("string"), vec![("maxLength", PATH_BYTES_MAX.into())]].concat();
        let examples = [
            "twist.twist.linear.x",
            "poses[0].position.x",
            "status_list[-1].status",
            "transforms[child_frame_id=base_link].transform.translation.x",
        ];
        example(&examples, with_about("Path of a field in the message.", form))
    })
}

fn writers(_: &mut Schema) -> Members {
    let items = ("items", Json::Object(pattern(FULL_NAME)));
    let example = Json::List(vec![vec!["/sensors/lidar_driver"].into()]);
    [not_empty(), vec![items, ("examples", example)]].concat()
}

/// `false`, or a map.
pub(super) fn or_off(map: Members) -> Members {
    one_of([vec![("const", false.into())], map])
}

/// The default of a duration.
pub(super) fn default_span(span: time::Span) -> (&'static str, Json) {
    default(words::span(span))
}

pub(super) fn with_about(about: &str, form: Members) -> Members {
    [vec![("description", about.into())], form].concat()
}

pub(super) fn example(examples: &[&str], form: Members) -> Members {
    [form, vec![("examples", examples.to_vec().into())]].concat()
}
