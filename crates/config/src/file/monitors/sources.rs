//! How the source of a monitor's value is written, and the terms of the paper's classification.

use crate::decode::{All, FromNode, Spanned};
use crate::fields::Fields;
use crate::file::forms::{self, FIELD, KEY, STATUS, TOPIC, TYPE, UNIT};
use telltale_engine::model::monitors::{Class, DIAGNOSTICS, FieldKind, StampClock};
use telltale_engine::model::sample::POSITIONS_MAX;
use telltale_yaml::decode::{scalar, word};
use telltale_yaml::schema::{default, needs_one, not_empty, one_of, words};
use telltale_yaml::{KeyDoc, Log, Members, Node, Problem, Schema, Span, key, map};

/// Topics of diagnostics; each has readers of its own.
pub(crate) const DIAGNOSTICS_MAX: usize = 32;
pub(crate) const PREFIX_BYTES_MAX: usize = 128;

#[derive(Debug)]
pub(crate) struct Topic {
    pub name: Spanned<String>,
    /// Without it, the type is named elsewhere in the file, or the publisher announces it.
    pub type_name: Option<Spanned<String>>,
}

impl Topic {
    /// The place of its type, or else of its name.
    pub fn place(&self) -> Span {
        self.type_name.as_ref().map_or(self.name.span, |type_name| type_name.span)
    }

    pub fn of(fields: &mut Fields) -> Option<Topic> {
        let (name, type_name) = (fields.required(TOPIC), fields.optional(TYPE));
        Some(Topic { name: name?, type_name })
    }

    /// Whether the configuration names this type.
    pub fn is_of(&self, type_name: &str) -> bool {
        self.type_name.as_ref().is_some_and(|it| it.value == type_name)
    }
}

impl FromNode for Topic {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, map("topic", "a topic").about("A topic and its type."), log)?;
        Topic::of(&mut fields)
    }
}

/// `diagnostics: { topics: [/diagnostics, { topic: /robot1/diagnostics, prefix: 'robot1: ' }] }`
#[derive(Debug)]
pub(crate) struct RawDiagnostics {
    pub topics: Vec<RawDiagnosticsTopic>,
    pub span: Span,
}

impl FromNode for RawDiagnostics {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let doc = map("diagnostics", "the diagnostics").about("The topics on which components report.");
        let mut fields = Fields::of(node, doc, log)?;
        let topics = key("topics")
            .about("Of diagnostic_msgs/msg/DiagnosticArray; their statuses share their names.")
            .rules(|| {
                let most = ("maxItems", DIAGNOSTICS_MAX.into());
                not_empty().into_iter().chain([most, default(vec![DIAGNOSTICS])]).collect()
            });
        let topics = fields.required(topics).map(|All(topics)| topics);
        Some(RawDiagnostics { topics: topics?, span: node.span })
    }
}

#[derive(Debug)]
pub(crate) struct RawDiagnosticsTopic {
    pub topic: Option<Spanned<String>>,
    pub prefix: Option<Spanned<String>>,
}

impl FromNode for RawDiagnosticsTopic {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if let Some(name) = scalar(node) {
            let topic = Some(Spanned { value: name.to_owned(), span: node.span });
            return Some(RawDiagnosticsTopic { topic, prefix: None });
        }
        let mut fields = Fields::of(node, map("diagnostics_topic", "a topic of diagnostics"), log)?;
        let prefix = key("prefix")
            .about("Stands in front of the name of each status of this topic.")
            .rules(|| vec![("maxLength", PREFIX_BYTES_MAX.into())]);
        Some(RawDiagnosticsTopic { topic: fields.required(TOPIC), prefix: fields.optional(prefix) })
    }

    fn form(schema: &mut Schema) -> Members {
        one_of([forms::topic_name(schema), schema.decoder(Self::from_node)])
    }
}

impl FromNode for StampClock {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "clock", &[("system", StampClock::System), ("ros", StampClock::Ros)])
    }

    fn form(_: &mut Schema) -> Members {
        words(["system", "ros"])
    }
}

pub(crate) const POSE: KeyDoc =
    key("pose").about("A Pose or a Transform, or a field that holds one.").form(forms::path);
const LIST: KeyDoc = key("list")
    .about("An array whose elements have `x` and `y`, or hold a field that has them: `poses`, `detections[].bbox.center.position`. At most 256 positions are compared.")
    .form(forms::path);
const _: () = assert!(POSITIONS_MAX == 256, "the text above says how many");

#[derive(Debug)]
pub(crate) enum Source {
    Field { topic: Topic, path: Spanned<String>, kind: FieldKind },
    Key { status: Spanned<String>, key: Spanned<String>, unit: Option<Spanned<String>> },
}

/// The keys of a single value: of a topic, or of a status.
pub(crate) fn may_have_source(fields: &mut Fields, field: KeyDoc) {
    [TOPIC, TYPE, field, STATUS, KEY, UNIT].into_iter().for_each(|key| fields.may_have::<String>(key));
}

impl Source {
    /// Reads the keys of a source that may be any part of a message, or the whole one without a `field`.
    pub fn part(fields: &mut Fields) -> Option<Source> {
        const PART: KeyDoc = key("field")
            .about("Any part of the message: a value, a message in it, an array. Without it, all of the message counts. Times with the name `stamp` never do.")
            .form(forms::path);
        fields.may_have::<String>(TOPIC);
        fields.may_have::<String>(TYPE);
        fields.may_have::<String>(PART);
        fields.may_have::<String>(STATUS);
        fields.may_have::<String>(KEY);
        fields.rule(|| needs_one(&[&["topic"], &["status", "key"]]));
        let mut there =
            |keys: &[&'static str]| keys.iter().filter(|key| fields.node(**key).is_some()).count();
        match (there(&["topic", "type", "field"]), there(&["status", "key"])) {
            (1.., 0) => {
                let (topic, path) = (Topic::of(fields)?, fields.optional("field"));
                let whole = || Spanned { value: String::new(), span: topic.name.span };
                let path = path.unwrap_or_else(whole);
                Some(Source::Field { topic, path, kind: FieldKind::Content })
            }
            (0, 1..) => {
                let (status, key) = (fields.required("status"), fields.required("key"));
                Some(Source::Key { status: status?, key: key?, unit: None })
            }
            (topic, _) => {
                let text = match topic {
                    0 => "it is not said where the value comes from",
                    _ => "the value comes either from a topic or from a status",
                };
                let problem = Problem::at(fields.span(), text);
                fields.log.push(problem.help("write `topic` and `type`, or `status` and `key`"));
                None
            }
        }
    }

    pub fn kind(&self) -> FieldKind {
        match self {
            Source::Field { kind, .. } => *kind,
            Source::Key { .. } => FieldKind::Scalar,
        }
    }

    /// Reads the keys of a source. `any`: whether it may be a pose or a list of positions.
    pub fn of(fields: &mut Fields, any: bool) -> Option<Source> {
        may_have_source(fields, FIELD);
        if any {
            fields.may_have::<String>(POSE);
            fields.may_have::<String>(LIST);
        }
        fields.rule(|| match any {
            true => {
                needs_one(&[&["topic", "field"], &["topic", "pose"], &["topic", "list"], &["status", "key"]])
            }
            false => needs_one(&[&["topic", "field"], &["status", "key"]]),
        });
        let mut there =
            |keys: &[&'static str]| keys.iter().filter(|key| fields.node(**key).is_some()).count();
        let (topics, keys) = (there(&["topic", "type", "field"]), there(&["status", "key", "unit"]));
        let others = if any { there(&["pose", "list"]) } else { 0 };
        let span = fields.span();
        if (topics + others == 0) == (keys == 0) {
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
            return Some(Source::Key { status: status?, key: key?, unit: fields.optional("unit") });
        }
        let topic = Topic::of(fields);
        if others > usize::from(fields.key_span("field").is_none()) {
            let problem = Problem::at(span, "either `field`, `pose` or `list`");
            fields.log.push(problem.help(
                "`field` for a single value, `pose` for a position with its rotation, `list` for many positions",
            ));
            return None;
        }
        let kinds = [("pose", FieldKind::Pose), ("list", FieldKind::Positions)];
        let named = kinds.into_iter().find(|(key, _)| others > 0 && fields.key_span(key).is_some());
        let (key, kind) = named.unwrap_or(("field", FieldKind::Scalar));
        let path = fields.required(key);
        Some(Source::Field { topic: topic?, path: path?, kind })
    }
}

/// One value.
pub(crate) struct ScalarSource(pub Source);

impl FromNode for ScalarSource {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let doc = map("source", "a source").about("A field of a topic, or a value of a status.");
        let mut fields = Fields::of(node, doc, log)?;
        Source::of(&mut fields, false).map(ScalarSource)
    }
}

/// One value, a pose, or a list of positions.
pub(crate) struct AnySource(pub Source);

impl FromNode for AnySource {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let about = "A field, a pose or a list of positions of a topic, or a value of a status.";
        let mut fields = Fields::of(node, map("any_source", "one of two sources").about(about), log)?;
        Source::of(&mut fields, true).map(AnySource)
    }
}

/// `{ location: isolated, information: content, flow: parallel }`
impl FromNode for Class {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let doc = map("class", "a class")
            .about("Where a diagnosis stands in the classification.")
            .rules(|| vec![("required", vec!["location", "information"].into())]);
        let mut fields = Fields::of(node, doc, log)?;
        let location = required_word(&mut fields, "location", ["isolated", "contextual"]);
        let information = required_word(&mut fields, "information", ["content", "meta"]);
        let doc = key("flow").form(|_| {
            vec![
                ("enum", FLOWS.map(Some).into_iter().chain([None]).collect::<Vec<_>>().into()),
                default(None::<&str>),
            ]
        });
        let flow = fields.node(doc).filter(|node| !node.is_null());
        let known = FLOWS.map(|word| (word, word));
        let found = flow.and_then(|node| word(node, fields.log, "flow", &known));
        Some(Class { location: location?, information: information?, flow: found })
    }
}

const FLOWS: [&str; 2] = ["sequential", "parallel"];

fn required_word(fields: &mut Fields, name: &'static str, words: [&'static str; 2]) -> Option<&'static str> {
    let found = fields.choice(key(name), name, &words.map(|word| (word, word)));
    if fields.key_span(name).is_none() {
        let problem = Problem::at(fields.span(), format!("a class needs `{name}`"));
        fields.log.push(problem.help(format!("add `{name}: {}` or `{name}: {}`", words[0], words[1])));
    }
    found
}
