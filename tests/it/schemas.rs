//! Documents against JSON Schemas. Strict: an object has no member that its schema does not name.

use boon::{Compiler, SchemaIndex, Schemas};
use serde_json::{Value, json};

const ADDRESS: &str = "http://test/schema.json";

/// A schema of a document that was made strict.
pub struct Strict {
    schemas: Schemas,
    index: SchemaIndex,
}

impl Strict {
    /// The schema at a JSON pointer in the document.
    pub fn at(document: &Value, pointer: &str) -> Strict {
        let mut document = document.clone();
        close(&mut document);
        let (mut schemas, mut compiler) = (Schemas::new(), Compiler::new());
        compiler.add_resource(ADDRESS, document).unwrap();
        let index = compiler.compile(&format!("{ADDRESS}#{pointer}"), &mut schemas);
        let index = index.unwrap_or_else(|error| panic!("{pointer}: {error}"));
        Strict { schemas, index }
    }

    /// Why a document does not fit.
    pub fn fault(&self, value: &Value) -> Option<String> {
        self.schemas.validate(value, self.index).err().map(|error| format!("{error:#}\n{value}"))
    }
}

/// Says of each schema of an object that it names all members.
fn close(schema: &mut Value) {
    match schema {
        Value::Object(object) => {
            object.values_mut().for_each(close);
            let is_schema = object.get("type").is_some_and(|kind| kind == "object");
            if is_schema && object.contains_key("properties") && !object.contains_key("oneOf") {
                object.insert("additionalProperties".to_owned(), json!(false));
            }
        }
        Value::Array(items) => items.iter_mut().for_each(close),
        _ => {}
    }
}
