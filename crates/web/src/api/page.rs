//! The page of the interface for programs: each route with its parameters, its answers and an example, made of the
//! OpenAPI document.

use askama::Template;
use axum::Extension;
use axum::response::Html;
use serde_json::{Map, Value};

use super::openapi::Description;
use crate::developer::request::PageRequest;
use crate::developer::{self, DevFrame, Page};
use crate::view::page::frame::PageFrame;
use crate::view::{View, html};

struct RouteGroup<'a> {
    name: &'a str,
    about: &'a str,
    routes: Vec<RouteHtml<'a>>,
}

struct RouteHtml<'a> {
    id: &'a str,
    method: String,
    path: &'a str,
    summary: &'a str,
    about: &'a str,
    /// Where it stands, its name, its bounds or words, what it is for.
    parameters: Vec<ParameterHtml<'a>>,
    answers: Vec<(&'a str, &'a str)>,
    curl: &'a str,
}

struct ParameterHtml<'a> {
    place: &'static str,
    name: &'a str,
    needed: bool,
    values: String,
    about: &'a str,
}

#[derive(Template)]
#[template(path = "developer/api.html")]
struct ApiHtml<'a> {
    frame: PageFrame,
    dev: DevFrame,
    version: &'a str,
    about: Vec<&'a str>,
    groups: Vec<RouteGroup<'a>>,
}

impl ApiHtml<'_> {
    /// The words of a text, and whether they stand between backquotes.
    fn marked<'t>(&self, text: &'t str) -> Vec<(bool, &'t str)> {
        text.split('`').enumerate().map(|(number, words)| (number % 2 == 1, words)).collect()
    }
}

/// `GET /developer/api`
pub async fn get(
    request: PageRequest,
    Extension(Description { document, .. }): Extension<Description>,
) -> Html<String> {
    let PageRequest { published, context, .. } = request;
    let view = &View::new(&published, context.lang, false);
    let mut dev = DevFrame::new(view, &context, Page::Api, 0);
    // It says nothing about the vehicle.
    (dev.fixed, dev.locked) = (true, false);
    let groups = list(&document["tags"]).iter().map(|tag| group(&document, tag)).collect();
    let about = text(&document["info"]["description"]).split("\n\n").collect();
    let version = text(&document["info"]["version"]);
    Html(html(&ApiHtml { frame: developer::frame(&context), dev, version, about, groups }))
}

fn group<'a>(document: &'a Value, tag: &'a Value) -> RouteGroup<'a> {
    let name = text(&tag["name"]);
    let paths = members(&document["paths"]);
    let all = paths.flat_map(|(path, methods)| members(methods).map(move |(method, it)| (path, method, it)));
    let tagged = all.filter(|(_, _, it)| it["tags"][0] == tag["name"]);
    let routes = tagged.map(|(path, method, it)| route(path, method, it)).collect();
    RouteGroup { name, about: text(&tag["description"]), routes }
}

fn route<'a>(path: &'a str, method: &str, it: &'a Value) -> RouteHtml<'a> {
    let parameter = |parameter: &'a Value| ParameterHtml {
        place: if parameter["in"] == "path" { "path" } else { "query" },
        name: text(&parameter["name"]),
        needed: parameter["required"] == true,
        values: values(&parameter["schema"]),
        about: text(&parameter["description"]),
    };
    let form = &it["requestBody"]["content"]["application/x-www-form-urlencoded"]["schema"];
    let field = |(name, schema): (&'a String, &'a Value)| ParameterHtml {
        place: "form",
        name,
        needed: list(&form["required"]).iter().any(|it| it == name),
        values: values(schema),
        about: text(&schema["description"]),
    };
    RouteHtml {
        id: text(&it["operationId"]),
        method: method.to_uppercase(),
        path,
        summary: text(&it["summary"]),
        about: text(&it["description"]),
        parameters: list(&it["parameters"])
            .iter()
            .map(parameter)
            .chain(members(&form["properties"]).map(field))
            .collect(),
        answers: members(&it["responses"])
            .map(|(status, it)| (&**status, text(&it["description"])))
            .collect(),
        curl: text(&it["x-curl"]),
    }
}

/// The type of a parameter.
fn values(schema: &Value) -> String {
    let words: Vec<&str> = list(&schema["enum"]).iter().map(text).collect();
    match (&schema["minimum"], &schema["maximum"]) {
        _ if !words.is_empty() => words.join(", "),
        (least, most) if !most.is_null() => format!("{least} \u{2013} {most}"),
        _ => {
            text(&schema["format"]).to_owned()
                + if schema["format"].is_null() { text(&schema["type"]) } else { "" }
        }
    }
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

fn members(value: &Value) -> impl Iterator<Item = (&String, &Value)> {
    value.as_object().into_iter().flat_map(Map::iter)
}
