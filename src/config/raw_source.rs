//! Where the values of monitors come from, and the words of the paper's classification, as written.

use crate::engine::monitor::spec::FieldKind;
use crate::engine::snapshot::Class;
use crate::yaml::decode::word;
use crate::yaml::{Fields, FromNode, Log, Node, Problem, Spanned};

#[derive(Debug)]
pub(super) struct Topic {
    pub name: Spanned<String>,
    pub type_name: Spanned<String>,
}

impl Topic {
    pub fn of(fields: &mut Fields) -> Option<Topic> {
        let (name, type_name) = (fields.required("topic"), fields.required("type"));
        Some(Topic { name: name?, type_name: type_name? })
    }
}

impl FromNode for Topic {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a topic", log)?;
        let topic = Topic::of(&mut fields);
        fields.finish();
        topic
    }
}

#[derive(Debug)]
pub(super) enum Source {
    Field { topic: Topic, path: Spanned<String>, kind: FieldKind },
    Key { status: Spanned<String>, key: Spanned<String> },
}

impl Source {
    pub fn is_pose(&self) -> bool {
        matches!(self, Source::Field { kind: FieldKind::Pose, .. })
    }

    /// Reads the keys of a source. `poses`: whether one may be named here.
    pub fn of(fields: &mut Fields, poses: bool) -> Option<Source> {
        let mut there = |keys: &[&'static str]| keys.iter().filter(|key| fields.node(key).is_some()).count();
        let (topics, keys) = (there(&["topic", "type", "field"]), there(&["status", "key"]));
        let poses = if poses { there(&["pose"]) } else { 0 };
        let span = fields.span();
        if (topics + poses == 0) == (keys == 0) {
            let text = match keys {
                0 => "it is not said where the value comes from",
                _ => "the value comes either from a topic or from a status",
            };
            let problem = Problem::at(span, text);
            fields.log.push(problem.help("write `topic`, `type` and `field`, or `status` and `key`"));
            return None;
        }
        if keys > 0 {
            let (status, key) = (fields.required("status"), fields.required("key"));
            return Some(Source::Key { status: status?, key: key? });
        }
        let topic = Topic::of(fields);
        if poses > 0 && fields.key_span("field").is_some() {
            let problem = Problem::at(span, "either `field` or `pose`");
            fields
                .log
                .push(problem.help("`pose` for a position with its rotation, `field` for a single value"));
            return None;
        }
        let (key, kind) = if poses > 0 { ("pose", FieldKind::Pose) } else { ("field", FieldKind::Scalar) };
        let path = fields.required(key);
        Some(Source::Field { topic: topic?, path: path?, kind })
    }
}

/// One value.
pub(super) struct ScalarSource(pub Source);

impl FromNode for ScalarSource {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a source", log)?;
        let source = Source::of(&mut fields, false);
        fields.finish();
        source.map(ScalarSource)
    }
}

/// One value, or a pose.
pub(super) struct AnySource(pub Source);

impl FromNode for AnySource {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "one of two sources", log)?;
        let source = Source::of(&mut fields, true);
        fields.finish();
        source.map(AnySource)
    }
}

/// `{ location: isolated, information: content, flow: parallel }`
impl FromNode for Class {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a class", log)?;
        let location = required_word(&mut fields, "location", ["isolated", "contextual"]);
        let information = required_word(&mut fields, "information", ["content", "meta"]);
        let flow = fields.node("flow").filter(|node| !node.is_null());
        let known = ["sequential", "parallel"].map(|word| (word, word));
        let found = flow.and_then(|node| word(node, fields.log, "flow", &known));
        fields.finish();
        Some(Class { location: location?, information: information?, flow: found })
    }
}

fn required_word(fields: &mut Fields, key: &'static str, words: [&'static str; 2]) -> Option<&'static str> {
    let Some(node) = fields.node(key) else {
        let problem = Problem::at(fields.span(), format!("a class needs `{key}`"));
        fields.log.push(problem.help(format!("add `{key}: {}` or `{key}: {}`", words[0], words[1])));
        return None;
    };
    word(node, fields.log, key, &words.map(|word| (word, word)))
}
