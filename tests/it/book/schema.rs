//! A JSON Schema as a page: a table for each map of the configuration, and the forms of values.

use std::fmt::{self, Write as _};

use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};

/// JSON whose objects keep their order, which is that of the decoders.
#[derive(Debug, Clone, PartialEq)]
enum Json {
    Null,
    Text(String),
    /// A number or a truth value, as it is written.
    Plain(String),
    List(Vec<Json>),
    Object(Vec<(String, Json)>),
}

impl<'de> Deserialize<'de> for Json {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Json, D::Error> {
        from.deserialize_any(JsonVisitor)
    }
}

struct JsonVisitor;

impl<'de> Visitor<'de> for JsonVisitor {
    type Value = Json;

    fn expecting(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("JSON")
    }

    fn visit_unit<E>(self) -> Result<Json, E> {
        Ok(Json::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Json, E> {
        Ok(Json::Plain(value.to_string()))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Json, E> {
        Ok(Json::Plain(value.to_string()))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Json, E> {
        Ok(Json::Plain(value.to_string()))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Json, E> {
        Ok(Json::Plain(value.to_string()))
    }

    fn visit_str<E>(self, value: &str) -> Result<Json, E> {
        Ok(Json::Text(value.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Json, A::Error> {
        let mut list = Vec::new();
        while let Some(item) = items.next_element()? {
            list.push(item);
        }
        Ok(Json::List(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Json, A::Error> {
        let mut object = Vec::new();
        while let Some(entry) = entries.next_entry()? {
            object.push(entry);
        }
        Ok(Json::Object(object))
    }
}

impl Json {
    fn get(&self, name: &str) -> Option<&Json> {
        match self {
            Json::Object(members) => members.iter().find(|(known, _)| known == name).map(|(_, value)| value),
            _ => None,
        }
    }

    fn text(&self, name: &str) -> Option<&str> {
        match self.get(name) {
            Some(Json::Text(text)) => Some(text),
            _ => None,
        }
    }

    fn items(&self, name: &str) -> &[Json] {
        match self.get(name) {
            Some(Json::List(items)) => items,
            _ => &[],
        }
    }

    fn members(&self, name: &str) -> &[(String, Json)] {
        match self.get(name) {
            Some(Json::Object(members)) => members,
            _ => &[],
        }
    }
}

/// The value as it is written in a configuration.
impl fmt::Display for Json {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Json::Null => out.write_str("null"),
            Json::Text(text) | Json::Plain(text) => out.write_str(text),
            Json::List(items) => {
                let items: Vec<String> = items.iter().map(Json::to_string).collect();
                write!(out, "[{}]", items.join(", "))
            }
            Json::Object(members) => {
                let members: Vec<String> =
                    members.iter().map(|(name, value)| format!("{name}: {value}")).collect();
                write!(out, "{{ {} }}", members.join(", "))
            }
        }
    }
}

/// The page of a schema.
pub fn page(schema: &str) -> String {
    let schema: Json = serde_json::from_str(schema).expect("the program prints JSON");
    let mut out = String::new();
    let _ = writeln!(out, "## The file\n\n{}\n", schema.text("description").unwrap_or_default());
    table(&mut out, &schema);
    let definitions = schema.members("$defs");
    let (maps, values): (Vec<_>, Vec<_>) =
        definitions.iter().partition(|(_, it)| it.get("properties").is_some());
    for (name, map) in maps {
        let title = map.text("title").unwrap_or(name);
        let about = map.text("description").map_or(String::new(), |it| format!(": {}", decapitalized(it)));
        let _ = writeln!(out, "\n## {name}\n\n{}{}\n", capitalized(title), full_stop(&about));
        table(&mut out, map);
    }
    out.push_str("\n# Forms of values\n");
    for (name, value) in values {
        let _ = writeln!(out, "\n## {name}\n");
        if let Some(about) = value.text("description") {
            let _ = writeln!(out, "{about}\n");
        }
        let _ = write!(out, "{}", capitalized(&form(value)));
        if let Some(pattern) = value.text("pattern") {
            let _ = write!(out, ", as `{pattern}`");
        }
        if let Some(most) = value.get("maxLength") {
            let _ = write!(out, ", at most {most} bytes");
        }
        let examples: Vec<String> = value.items("examples").iter().map(|it| format!("`{it}`")).collect();
        if !examples.is_empty() {
            let _ = write!(out, ". Examples: {}", examples.join(", "));
        }
        out.push_str(".\n");
    }
    out
}

/// The keys of a map.
fn table(out: &mut String, map: &Json) {
    out.push_str("| key | value | without it | |\n|---|---|---|---|\n");
    for (key, value) in map.members("properties") {
        let required = map.items("required").contains(&Json::Text(key.clone()));
        let default = match value.get("default") {
            Some(default) => format!("`{default}`"),
            None if required => "an error".to_owned(),
            None => String::new(),
        };
        let mut facts: Vec<String> = value.text("description").map(str::to_owned).into_iter().collect();
        for (bound, word) in [("minimum", "At least"), ("maximum", "At most"), ("maxItems", "At most")] {
            if let Some(limit) = value.get(bound) {
                facts.push(format!("{word} {limit}."));
            }
        }
        let row = [format!("`{key}`"), form(value), default, facts.join(" ")];
        let _ = writeln!(out, "| {} |", row.map(|cell| cell.replace('|', "\\|")).join(" | "));
    }
    let needed: Vec<String> = ["oneOf", "anyOf"].into_iter().filter_map(|name| needed(map, name)).collect();
    if !needed.is_empty() {
        let _ = writeln!(out, "\n{}", needed.join(" "));
    }
}

/// Which keys are needed together.
fn needed(map: &Json, name: &str) -> Option<String> {
    let sets: Vec<String> = map
        .items(name)
        .iter()
        .map(|set| {
            set.items("required").iter().map(|key| format!("`{key}`")).collect::<Vec<_>>().join(" with ")
        })
        .filter(|set| !set.is_empty())
        .collect();
    let word = if name == "oneOf" { "Exactly" } else { "At least" };
    (!sets.is_empty()).then(|| format!("{word} one is needed: {}.", sets.join("; ")))
}

/// The kind of value in a few words, with links to its definition.
fn form(value: &Json) -> String {
    if let Some(name) = value.text("$ref").and_then(|it| it.strip_prefix("#/$defs/")) {
        return format!("[{name}](#{name})");
    }
    let words = value.items("enum");
    if !words.is_empty() {
        return words.iter().map(|it| format!("`{it}`")).collect::<Vec<_>>().join(", ");
    }
    if let Some(constant) = value.get("const") {
        return format!("`{constant}`");
    }
    let forms: Vec<String> = value.items("oneOf").iter().map(form).filter(|it| !it.is_empty()).collect();
    if !forms.is_empty() {
        return forms.join(" or ");
    }
    let kinds: Vec<String> = match value.get("type") {
        Some(Json::List(kinds)) => kinds.iter().map(Json::to_string).filter(|it| it != "null").collect(),
        Some(kind) => vec![kind.to_string()],
        None => Vec::new(),
    };
    match kinds.first().map(String::as_str) {
        Some("array") => match value.get("items").map(form).filter(|it| !it.is_empty()) {
            Some(item) => format!("list of {item}"),
            None => "list".into(),
        },
        Some("object") => match value.get("additionalProperties").map(form).filter(|it| !it.is_empty()) {
            Some(item) => format!("map of names to {item}"),
            None => "map".into(),
        },
        Some(_) => kinds.iter().map(|it| kind(it)).collect::<Vec<_>>().join(" or "),
        None => String::new(),
    }
}

fn kind(name: &str) -> &str {
    match name {
        "string" => "text",
        "boolean" => "`true`, `false`",
        "integer" => "whole number",
        other => other,
    }
}

fn capitalized(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or(String::new(), |first| first.to_uppercase().chain(chars).collect())
}

fn decapitalized(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or(String::new(), |first| first.to_lowercase().chain(chars).collect())
}

fn full_stop(text: &str) -> String {
    if text.ends_with('.') { text.to_owned() } else { format!("{text}.") }
}
