//! The OpenAPI document, made of the table of routes, and the answers with this document and with the schemas.

use std::sync::{Arc, LazyLock, OnceLock};

use axum::Extension;
use axum::http::{HeaderMap, Method};
use axum::response::Response;
use schemars::SchemaGenerator;
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value, json};

use super::VERSION;
use super::operation::{Content, Operation, SchemaOf, Tag};
use crate::assets::File;
use crate::http::guard::{Access, cookie_name};
use crate::http::respond::{ErrorAnswer, RefusedAnswer};
use crate::live::frame;
use crate::schema::{of, sent, without_null};
use telltale_store::Role;

const ABOUT: &str = "The interface of Telltale for programs. Programs send `Authorization: Bearer TOKEN`, with a token from \
    `telltale user token NAME`; operators have no tokens and send the cookie of their session. What acts by a cookie \
    needs the header `Origin` with the server's own address. Errors are `{\"error\": \"...\"}`, what the state of the vehicle \
    does not permit is `{\"refused\": [...]}`.\n\nThe version of the interface is the `1` in its paths. Within it routes, \
    parameters, keys and words may be added, and none is removed or changes its meaning: take no notice of what you \
    do not know.";

/// The media type of the OpenAPI document.
pub const OPENAPI: &str = "application/vnd.oai.openapi+json;version=3.1";
/// The media type of a JSON Schema.
pub const SCHEMA: &str = "application/schema+json";

/// The OpenAPI document of a server.
#[derive(Debug, Clone)]
pub struct Description {
    pub document: Arc<Value>,
    /// Made when somebody asks for it.
    file: Arc<OnceLock<File>>,
}

impl Description {
    pub fn of(document: Value) -> Description {
        Description { document: Arc::new(document), file: Arc::default() }
    }
}

/// `GET /api/v1/openapi.json`
pub async fn get(Extension(description): Extension<Description>, headers: HeaderMap) -> Response {
    let file = description.file.get_or_init(|| File::json(&description.document));
    file.answer(OPENAPI, &headers)
}

/// `GET /api/v1/schema/snapshot.json`
pub async fn snapshot_schema(headers: HeaderMap) -> Response {
    static FILE: LazyLock<File> = LazyLock::new(|| File::json(&frame::snapshot_schema()));
    FILE.answer(SCHEMA, &headers)
}

/// `GET /api/v1/schema/stream.json`
pub async fn stream_schema(headers: HeaderMap) -> Response {
    static FILE: LazyLock<File> = LazyLock::new(|| File::json(&frame::stream_schema()));
    FILE.answer(SCHEMA, &headers)
}

/// A route with its description.
#[derive(Debug, Clone)]
pub struct Described<'a> {
    pub method: Method,
    pub path: &'a str,
    pub access: Access,
    pub operation: &'a Operation,
}

/// What a document says of its interface as a whole.
#[derive(Debug)]
pub struct About {
    pub title: &'static str,
    pub text: &'static str,
    /// The users that have tokens.
    pub token: &'static str,
}

/// Of a vehicle's own server.
pub const VEHICLE: About = About {
    title: "Telltale",
    text: ABOUT,
    token: "Of `telltale user token NAME`, for a developer or an authority.",
};

/// The document of these routes. `secure` says how the cookie is named.
pub fn document<'a>(about: &About, routes: impl Iterator<Item = Described<'a>>, secure: bool) -> Value {
    let mut schemas = generator();
    let mut paths = Map::new();
    let mut used = Vec::new();
    for route in routes {
        used.push(route.operation.tag);
        let path = route.operation.path.unwrap_or(route.path);
        let entry = paths.entry(path).or_insert_with(|| json!({}));
        entry[route.method.as_str().to_lowercase()] = operation(&route, path, &mut schemas);
    }
    let tags = Tag::ALL.iter().filter(|tag| used.contains(tag));
    let tags: Vec<Value> =
        tags.map(|tag| json!({ "name": tag.as_str(), "description": tag.about() })).collect();
    json!({
        "openapi": "3.1.0",
        "info": {
            "title": about.title,
            "version": VERSION,
            "x-telltale-version": env!("CARGO_PKG_VERSION"),
            "description": about.text,
            "license": { "name": "Apache-2.0", "identifier": "Apache-2.0" },
        },
        "servers": [{ "url": "/" }],
        "tags": tags,
        "paths": paths,
        "components": {
            "schemas": schemas.take_definitions(true),
            "securitySchemes": {
                "token": {
                    "type": "http", "scheme": "bearer",
                    "description": about.token,
                },
                "session": {
                    "type": "apiKey", "in": "cookie", "name": cookie_name(secure),
                    "description": "The cookie that `POST /login` sets.",
                },
            },
        },
    })
}

fn generator() -> SchemaGenerator {
    let mut settings = sent(SchemaSettings::draft2020_12());
    settings.definitions_path = "/components/schemas".into();
    settings.meta_schema = None;
    settings.into_generator()
}

fn operation(route: &Described<'_>, path: &str, schemas: &mut SchemaGenerator) -> Value {
    let &Described { access, operation: it, .. } = route;
    let in_path = it.in_path.iter().map(|(name, about, example)| {
        json!({ "name": name, "in": "path", "required": true, "description": about, "schema": { "type": "string" },
                "example": example })
    });
    let mut parameters: Vec<Value> = in_path.collect();
    parameters.extend(it.query.into_iter().flat_map(query));
    let mut value = json!({
        "operationId": it.id,
        "tags": [it.tag.as_str()],
        "summary": it.summary,
        "description": about(it.about, access),
        "parameters": parameters,
        "responses": answers(route, schemas),
        "security": security(access, it),
        "x-roles": roles(access).iter().map(|role| role.as_str()).collect::<Vec<_>>(),
        "x-curl": curl(route, path),
    });
    if let Some(form) = it.form {
        let (schema, is_needed) = taken(form);
        value["requestBody"] = json!({
            "required": is_needed,
            "content": { "application/x-www-form-urlencoded": { "schema": schema } },
        });
    }
    value
}

fn about(about: &str, access: Access) -> String {
    let who = match access {
        Access::Open | Access::Asset => "Needs no session.".to_owned(),
        Access::Session => "For every user.".to_owned(),
        Access::Roles(roles) => {
            let words: Vec<&str> = roles.iter().map(|role| role.as_str()).collect();
            format!("For the roles: {}.", words.join(", "))
        }
    };
    format!("{about} {who}").trim_start().to_owned()
}

fn roles(access: Access) -> &'static [Role] {
    match access {
        Access::Open | Access::Asset => &[],
        Access::Session => &Role::OF_VEHICLE,
        Access::Roles(roles) => roles,
    }
}

/// Whether a token can use a route: operators have none.
fn takes_token(access: Access, operation: &Operation) -> bool {
    !operation.session_alone && roles(access).iter().any(|role| *role != Role::Operator)
}

fn security(access: Access, operation: &Operation) -> Value {
    match access {
        Access::Open | Access::Asset => json!([]),
        _ if takes_token(access, operation) => json!([{ "token": [] }, { "session": [] }]),
        _ => json!([{ "session": [] }]),
    }
}

/// The schema of a form or a query. Nothing in it refers to another schema.
fn taken(of: SchemaOf) -> (Value, bool) {
    let mut settings = SchemaSettings::draft2020_12();
    settings.inline_subschemas = true;
    let mut schema = of(&mut settings.into_generator()).to_value();
    let needed = schema.get("required").and_then(Value::as_array).is_some_and(|it| !it.is_empty());
    if let Some(object) = schema.as_object_mut() {
        object.remove("title");
        // Fields that are not known are ignored in forms, as they always were.
        object.remove("additionalProperties");
        for property in
            object.get_mut("properties").and_then(Value::as_object_mut).into_iter().flat_map(Map::values_mut)
        {
            without_null(property);
            bound(property);
        }
    }
    (schema, needed)
}

/// The largest number of a field that has 32 bits.
fn bound(property: &mut Value) {
    if property["format"] == "uint32" && property["maximum"].is_null() {
        property["maximum"] = u32::MAX.into();
    }
}

fn query(of: SchemaOf) -> Vec<Value> {
    let (schema, _) = taken(of);
    let needed = |name: &str| {
        schema.get("required").and_then(Value::as_array).is_some_and(|all| all.iter().any(|it| it == name))
    };
    let properties = schema.get("properties").and_then(Value::as_object);
    let parameter = |(name, schema): (&String, &Value)| {
        let mut schema = schema.clone();
        let about = schema.as_object_mut().and_then(|it| it.remove("description"));
        let mut value = json!({ "name": name, "in": "query", "required": needed(name), "schema": schema });
        if let Some(about) = about {
            value["description"] = about;
        }
        value
    };
    properties.into_iter().flatten().map(parameter).collect()
}

fn answers(route: &Described<'_>, schemas: &mut SchemaGenerator) -> Value {
    let &Described { ref method, access, operation: it, .. } = route;
    let json_of = |schema: Value| json!({ "application/json": { "schema": schema } });
    let error = json_of(of::<ErrorAnswer>(schemas).to_value());
    let refused = json_of(of::<RefusedAnswer>(schemas).to_value());
    let mut answers = Map::new();
    let (status, about, content) = match it.answer {
        Content::Json(schema) => ("200", "Done.", json_of(schema(schemas).to_value())),
        Content::Description(media) => ("200", "Done.", json!({ media: { "schema": { "type": "object" } } })),
        Content::Table(schema) => {
            let mut content = json_of(schema(schemas).to_value());
            content["text/csv"] = json!({ "schema": { "type": "string" } });
            ("200", "The rows.", content)
        }
        Content::Begun => ("202", "It was asked for.", json!({ "application/json": {} })),
        Content::Text => ("200", "It does.", json!({ "text/plain": { "schema": { "type": "string" } } })),
        Content::Mcap => {
            ("200", "The file, or the range that is asked for.", json!({ "application/octet-stream": {} }))
        }
        Content::Stream(_) => ("101", "The WebSocket is open.", Value::Null),
    };
    let mut done = json!({ "description": about });
    if !content.is_null() {
        done["content"] = content;
    }
    if let Content::Table(_) = it.answer {
        done["headers"] = json!({ "Telltale-Next": {
            "description": "For the next page: the value of `after`, `before` or `offset`. It lacks on the last page.",
            "schema": { "type": "integer" },
        } });
    }
    answers.insert(status.to_owned(), done);
    if let Content::Stream(schema) = it.answer {
        answers["101"]["x-messages"] = schema(schemas).to_value();
        let text = json!({ "text/plain": { "schema": { "type": "string" } } });
        answers.insert(
            "426".to_owned(),
            json!({ "description": "A plain GET: the text says how to use it.",
            "headers": { "Upgrade": { "schema": { "type": "string" } } }, "content": text }),
        );
    }
    if access != Access::Open {
        answers.insert("401".to_owned(), json!({ "description": "No session.", "content": error }));
    }
    if matches!(access, Access::Roles(_)) || method != Method::GET {
        let about = "The role does not permit it, or the request comes from another page.";
        answers.insert("403".to_owned(), json!({ "description": about, "content": error }));
    }
    for (status, about) in it.refusals {
        let content = if *status == 409 && it.tag == Tag::Operator { &refused } else { &error };
        answers.insert(status.to_string(), json!({ "description": about, "content": content }));
    }
    let about = "Another refusal, which says what to do.";
    answers.insert("default".to_owned(), json!({ "description": about, "content": error }));
    Value::Object(answers)
}

/// The example for a shell: `$URL`, and `$TOKEN` or the cookies in `$SESSION`.
fn curl(route: &Described<'_>, path: &str) -> String {
    let &Described { ref method, access, operation: it, .. } = route;
    let mut words = vec!["curl".to_owned()];
    match access {
        Access::Open | Access::Asset => {}
        _ if takes_token(access, it) => words.push("-H \"Authorization: Bearer $TOKEN\"".to_owned()),
        _ => words.push("-b \"$SESSION\"".to_owned()),
    }
    let is_get = method == Method::GET;
    if !is_get && !takes_token(access, it) {
        words.push("-H \"Origin: $URL\" -H \"Accept: application/json\"".to_owned());
    }
    if it.id == "login" {
        words.push("-c \"$SESSION\"".to_owned());
    }
    if !is_get {
        words.push(format!("-d '{}'", it.example));
    }
    if let Content::Mcap = it.answer {
        words.push("-O".to_owned());
    }
    let fill =
        |path: String, (name, _, example): &(&str, &str, &str)| path.replace(&format!("{{{name}}}"), example);
    let path = it.in_path.iter().fold(path.to_owned(), fill);
    let query = if is_get { it.example } else { "" };
    words.push(format!("\"$URL{path}{query}\""));
    words.join(" ")
}
