//! The JSON Schema of a file, made by the decoders themselves. Each decoder runs once on an empty map. It asks
//! for its keys there, each with a description; the type of the value gives the rest of the schema.

use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::Value;

use super::decode::Log;
use super::source::Span;
use super::tree::{Kind, Node};

/// The members of a JSON object, in the order of writing.
pub type Members = Vec<(&'static str, Json)>;

/// A JSON value whose objects keep their order.
#[derive(Debug, Clone, PartialEq)]
pub enum Json {
    Leaf(Value),
    List(Vec<Json>),
    Object(Members),
}

impl<T: Into<Value>> From<T> for Json {
    fn from(value: T) -> Json {
        Json::Leaf(value.into())
    }
}

impl Serialize for Json {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Json::Leaf(value) => value.serialize(serializer),
            Json::List(items) => items.serialize(serializer),
            Json::Object(members) => {
                let mut map = serializer.serialize_map(Some(members.len()))?;
                for (name, value) in members {
                    map.serialize_entry(name, value)?;
                }
                map.end()
            }
        }
    }
}

/// A key of a map with its documentation. The schema has the type of the key from the decoder of its value.
#[derive(Debug, Clone, Copy)]
pub struct KeyDoc {
    name: &'static str,
    about: &'static str,
    form: Option<fn(&mut Schema) -> Members>,
    rules: fn() -> Members,
}

pub const fn key(name: &'static str) -> KeyDoc {
    KeyDoc { name, about: "", form: None, rules: Vec::new }
}

impl KeyDoc {
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// The meaning of the key, in sentences.
    pub const fn about(self, about: &'static str) -> KeyDoc {
        KeyDoc { about, ..self }
    }

    pub fn own_form(&self) -> Option<fn(&mut Schema) -> Members> {
        self.form
    }

    /// The form of the value, if its Rust type is not enough.
    pub const fn form(self, form: fn(&mut Schema) -> Members) -> KeyDoc {
        KeyDoc { form: Some(form), ..self }
    }

    /// Bounds and the default.
    pub const fn rules(self, rules: fn() -> Members) -> KeyDoc {
        KeyDoc { rules, ..self }
    }
}

impl From<&'static str> for KeyDoc {
    fn from(name: &'static str) -> KeyDoc {
        key(name)
    }
}

/// A map of given keys with its documentation.
#[derive(Debug, Clone, Copy)]
pub struct MapDoc {
    /// Names its definition in the schema.
    name: &'static str,
    /// With its article, for messages: `a group`.
    title: &'static str,
    about: &'static str,
    rules: fn() -> Members,
}

pub const fn map(name: &'static str, title: &'static str) -> MapDoc {
    MapDoc { name, title, about: "", rules: Vec::new }
}

impl MapDoc {
    pub const fn title(&self) -> &'static str {
        self.title
    }

    pub const fn about(self, about: &'static str) -> MapDoc {
        MapDoc { about, ..self }
    }

    /// Which keys are needed together or exclude each other.
    pub const fn rules(self, rules: fn() -> Members) -> MapDoc {
        MapDoc { rules, ..self }
    }
}

impl From<&'static str> for MapDoc {
    /// A map that no schema describes.
    fn from(title: &'static str) -> MapDoc {
        map("", title)
    }
}

/// The definitions that were collected so far.
#[derive(Debug, Default)]
pub struct Schema {
    values: Vec<(&'static str, Members)>,
    maps: Vec<Map>,
    /// The map of the decoder that runs.
    opened: Option<&'static str>,
}

#[derive(Debug)]
struct Map {
    doc: MapDoc,
    required: Vec<&'static str>,
    rules: Members,
    properties: Members,
}

impl Schema {
    /// Refers to a definition, and makes it the first time.
    pub fn define(&mut self, name: &'static str, make: impl FnOnce(&mut Schema) -> Members) -> Members {
        if !self.values.iter().any(|(known, _)| *known == name) {
            let members = make(self);
            self.values.push((name, members));
        }
        reference(name)
    }

    /// Runs the decoder of a map on an empty map, and refers to the resulting definition.
    pub fn decoder<T>(&mut self, read: impl FnOnce(&Node, &mut Log) -> Option<T>) -> Members {
        let node = Node { span: Span { file: 0, start: 0, end: 0 }, kind: Kind::Mapping(Vec::new()) };
        let outer = self.opened.take();
        let mut log = Log::describing(std::mem::take(self));
        read(&node, &mut log);
        *self = log.into_schema();
        let opened = std::mem::replace(&mut self.opened, outer);
        reference(opened.expect("a decoder without a form of its own reads a map"))
    }

    /// Whether the map is new; a known one is not described again.
    pub fn open(&mut self, doc: MapDoc) -> bool {
        self.opened.get_or_insert(doc.name);
        let is_new = !self.maps.iter().any(|map| map.doc.name == doc.name);
        if is_new {
            let rules = (doc.rules)();
            self.maps.push(Map { doc, required: Vec::new(), rules, properties: Vec::new() });
        }
        is_new
    }

    pub fn property(&mut self, of: MapDoc, key: &KeyDoc, form: Members, is_required: bool) {
        let map = self.map(of);
        if is_required {
            map.required.push(key.name);
        }
        let mut members = described("description", key.about);
        for (name, value) in form.into_iter().chain((key.rules)()) {
            members.retain(|(known, _)| *known != name);
            members.push((name, value));
        }
        map.properties.push((key.name, Json::Object(members)));
    }

    pub fn rule(&mut self, of: MapDoc, rule: (&'static str, Json)) {
        self.map(of).rules.push(rule);
    }

    fn map(&mut self, doc: MapDoc) -> &mut Map {
        let map = self.maps.iter_mut().find(|map| map.doc.name == doc.name);
        map.expect("its decoder opened it before it asked for keys")
    }

    /// The whole schema of a file, by the decoder of its map.
    pub fn document<T>(read: impl FnOnce(&Node, &mut Log) -> Option<T>) -> String {
        let mut schema = Schema::default();
        schema.decoder(read);
        let mut maps = schema.maps.into_iter();
        let mut members = vec![("$schema", "https://json-schema.org/draft/2020-12/schema".into())];
        members.extend(maps.next().into_iter().flat_map(Map::members));
        let values = schema.values.into_iter().map(|(name, members)| (name, Json::Object(members)));
        let maps = maps.map(|map| (map.doc.name, Json::Object(map.members())));
        members.push(("$defs", Json::Object(values.chain(maps).collect())));
        let text = serde_json::to_string_pretty(&Json::Object(members));
        text.expect("its keys are strings and its numbers finite") + "\n"
    }
}

impl Map {
    fn members(self) -> Members {
        let mut members = vec![("title", self.doc.title.into())];
        members.extend(described("description", self.doc.about));
        members.extend([("type", "object".into()), ("additionalProperties", false.into())]);
        if !self.required.is_empty() {
            members.push(("required", self.required.into()));
        }
        members.extend(self.rules);
        members.push(("properties", Json::Object(self.properties)));
        members
    }
}

fn described(name: &'static str, text: &'static str) -> Members {
    if text.is_empty() { Vec::new() } else { vec![(name, text.into())] }
}

fn reference(name: &str) -> Members {
    vec![("$ref", format!("#/$defs/{name}").into())]
}

/// `{ "type": ... }`
pub fn of_type(name: &str) -> Members {
    vec![("type", name.into())]
}

/// A text that matches a pattern.
pub fn pattern(pattern: &str) -> Members {
    vec![("type", "string".into()), ("pattern", pattern.into())]
}

/// One of these words.
pub fn words<'a>(words: impl IntoIterator<Item = &'a str>) -> Members {
    vec![("enum", words.into_iter().collect::<Vec<_>>().into())]
}

pub fn list(item: Members) -> Members {
    vec![("type", vec!["array", "null"].into()), ("items", Json::Object(item))]
}

/// A map of free keys.
pub fn entries(value: Members) -> Members {
    vec![("type", vec!["object", "null"].into()), ("additionalProperties", Json::Object(value))]
}

/// One of several forms.
pub fn one_of(forms: impl IntoIterator<Item = Members>) -> Members {
    vec![("oneOf", Json::List(forms.into_iter().map(Json::Object).collect()))]
}

/// Exactly one of these sets of keys is there.
pub fn needs_one(sets: &[&[&'static str]]) -> (&'static str, Json) {
    ("oneOf", needed(sets))
}

/// At least one of these sets of keys is there.
pub fn needs_any(sets: &[&[&'static str]]) -> (&'static str, Json) {
    ("anyOf", needed(sets))
}

fn needed(sets: &[&[&'static str]]) -> Json {
    Json::List(sets.iter().map(|keys| Json::Object(vec![("required", keys.to_vec().into())])).collect())
}

pub fn default(value: impl Into<Json>) -> (&'static str, Json) {
    ("default", value.into())
}

pub fn least(value: impl Into<Json>) -> (&'static str, Json) {
    ("minimum", value.into())
}

pub fn most(value: impl Into<Json>) -> (&'static str, Json) {
    ("maximum", value.into())
}

pub fn not_empty() -> Members {
    vec![("type", "array".into()), ("minItems", 1.into())]
}
