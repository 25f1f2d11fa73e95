//! Tables for programs: JSON, or CSV for who asks for it.

use axum::http::header::{ACCEPT, CONTENT_DISPOSITION, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::http::respond::{header, json_answer};
use crate::texts::{clean_lines, plain_json};

/// The header that says how to ask for what follows: the value of the parameter `before`, `after` or `offset`.
const NEXT: HeaderName = HeaderName::from_static("telltale-next");

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(inline)]
pub enum Format {
    Json,
    Csv,
}

impl Format {
    /// The format in the address, or else the one in the header `Accept`.
    pub fn of(asked: Option<Format>, headers: &HeaderMap) -> Format {
        let accepts = header(headers, ACCEPT.as_str()).unwrap_or_default();
        let is_csv = accepts.contains("text/csv") && !accepts.contains("application/json");
        asked.unwrap_or(if is_csv { Format::Csv } else { Format::Json })
    }
}

/// The rows of an answer.
pub struct Table<'a, R> {
    /// Of the file.
    pub name: &'static str,
    /// In their order in a CSV.
    pub columns: &'static [&'static str],
    pub rows: &'a [R],
    /// The parameter of the next page.
    pub next: Option<u64>,
}

impl<R: Serialize> Table<'_, R> {
    /// The CSV, or `json`.
    pub fn answer(&self, format: Format, json: &impl Serialize) -> Response {
        let mut answer = match format {
            Format::Json => match serde_json::to_value(json) {
                Ok(value) => json_answer(StatusCode::OK, &value),
                Err(error) => {
                    tracing::error!(%error, "a table cannot be written");
                    StatusCode::INTERNAL_SERVER_ERROR.into_response()
                }
            },
            Format::Csv => {
                let mut answer = csv(self.columns, self.rows).into_response();
                let headers = answer.headers_mut();
                headers.insert(
                    CONTENT_TYPE,
                    HeaderValue::from_static("text/csv; charset=utf-8; header=present"),
                );
                let name = format!("attachment; filename=\"{}.csv\"", self.name);
                headers.extend(HeaderValue::from_str(&name).ok().map(|name| (CONTENT_DISPOSITION, name)));
                answer
            }
        };
        answer.headers_mut().extend(self.next.map(|next| (NEXT, HeaderValue::from(next))));
        answer
    }
}

/// RFC 4180.
fn csv(columns: &[&str], rows: &[impl Serialize]) -> String {
    let mut out = String::new();
    let mut line = |cells: &mut dyn Iterator<Item = String>| {
        for (index, cell) in cells.enumerate() {
            if index > 0 {
                out.push(',');
            }
            out.push_str(&quoted(&cell));
        }
        out.push_str("\r\n");
    };
    line(&mut columns.iter().map(|it| (*it).to_owned()));
    for row in rows {
        let row = serde_json::to_value(row).unwrap_or_default();
        line(&mut columns.iter().map(|column| cell(row.get(column).unwrap_or(&Value::Null))));
    }
    out
}

/// Lists of words stand with spaces between them, other values as JSON.
fn cell(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => harmless(text),
        Value::Array(items) if items.iter().all(Value::is_string) => {
            let words: Vec<&str> = items.iter().filter_map(Value::as_str).collect();
            harmless(&words.join(" "))
        }
        other => plain_json(other.to_string()),
    }
}

/// A formula of a spreadsheet becomes a text, and a letter that acts on a terminal or on the direction of reading
/// is left out. Names and messages come from the vehicle's network.
fn harmless(text: &str) -> String {
    let text = clean_lines(&text.replace('\t', " "));
    let is_formula =
        text.trim_start().starts_with(['=', '+', '-', '@']) && text.trim().parse::<f64>().is_err();
    if is_formula { format!("'{text}") } else { text }
}

fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) {
        return format!("\"{}\"", cell.replace('"', "\"\""));
    }
    cell.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_table_reads_as_csv() {
        let rows = [
            json!({ "a": "x", "b": ["/n1", "/n2"], "c": null }),
            json!({ "a": "say \"hi\",\nthen", "b": [], "c": { "k": 1 } }),
            json!({ "a": "=SUM(A1)", "b": ["-3.5"], "c": -3.5 }),
            json!({ "a": "a\u{1b}[2J\u{9b}\u{202e}b\tc", "b": ["\u{202e}=1+1"], "c": { "k": "\u{202e}" } }),
            json!({ "a": "\t=1+1" }),
        ];
        let expected = "a,b,c\r\nx,/n1 /n2,\r\n\"say \"\"hi\"\",\nthen\",,\"{\"\"k\"\":1}\"\r\n'=SUM(A1),-3.5,-3.5\r\n\
             a[2Jb c,'=1+1,\"{\"\"k\"\":\"\"\\u202e\"\"}\"\r\n' =1+1,,\r\n";
        assert_eq!(csv(&["a", "b", "c"], &rows), expected);
    }

    #[test]
    fn the_address_counts_before_the_header() {
        let accepting = |text: &'static str| HeaderMap::from_iter([(ACCEPT, HeaderValue::from_static(text))]);
        assert_eq!(Format::of(None, &accepting("text/csv")), Format::Csv);
        assert_eq!(Format::of(None, &accepting("text/csv, application/json")), Format::Json);
        assert_eq!(Format::of(Some(Format::Json), &accepting("text/csv")), Format::Json);
        assert_eq!(Format::of(None, &HeaderMap::new()), Format::Json);
    }
}
