//! JSON Schemas of what programs are sent, made of the structs that are serialized.

pub mod words;

use schemars::generate::SchemaSettings;
use schemars::transform::RecursiveTransform;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde_json::Value;

/// The schema of a message or an answer, in a document of its own.
pub fn schema_of<T: JsonSchema>() -> Value {
    let mut schema = sent(SchemaSettings::draft2020_12()).into_generator().into_root_schema_for::<T>();
    schema.insert(
        "$comment".to_owned(),
        "Within version 1 keys are added and never removed: take no notice of others.".into(),
    );
    schema.to_value()
}

/// Settings for messages and answers: a member that may be left out is never null.
pub fn sent(settings: SchemaSettings) -> SchemaSettings {
    settings.for_serialize().with_transform(RecursiveTransform(|schema: &mut Schema| {
        let required = schema.get("required").and_then(Value::as_array).cloned().unwrap_or_default();
        let properties = schema.get_mut("properties").and_then(Value::as_object_mut);
        for (name, property) in properties.into_iter().flatten() {
            if !required.iter().any(|it| it == name) {
                without_null(property);
            }
        }
    }))
}

/// The schema of a member that is there or not, and never null.
pub fn without_null(schema: &mut Value) {
    let Some(object) = schema.as_object_mut() else { return };
    if let Some(Value::Array(kinds)) = object.get_mut("type") {
        kinds.retain(|kind| kind != "null");
        if let [kind] = &kinds[..] {
            let kind = kind.clone();
            object.insert("type".to_owned(), kind);
        }
    }
    if let Some(Value::Array(words)) = object.get_mut("enum") {
        words.retain(|word| !word.is_null());
    }
    if let Some(Value::Array(forms)) = object.get_mut("anyOf") {
        forms.retain(|form| form.get("type").is_none_or(|kind| kind != "null"));
        if let [Value::Object(form)] = &forms[..] {
            let form = form.clone();
            object.remove("anyOf");
            object.extend(form);
        }
    }
    if object.get("default").is_some_and(Value::is_null) {
        object.remove("default");
    }
}

/// The schema of a type, for an operation.
pub fn of<T: JsonSchema>(schemas: &mut SchemaGenerator) -> Schema {
    schemas.subschema_for::<T>()
}
