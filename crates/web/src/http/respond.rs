//! Answers in the format and language of the caller.

use std::convert::Infallible;

use axum::extract::rejection::FormRejection;
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::header::{ACCEPT, ACCEPT_LANGUAGE, CONTENT_TYPE, COOKIE};
use axum::http::request::Parts;
use axum::http::{Extensions, HeaderMap, StatusCode, Uri};
use axum::response::{Html, IntoResponse, Response};
use axum::{Extension, Form};
use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::texts::{HttpError, Lang, Words, plain_json};
use crate::view;
use crate::view::{Home, PagePart, Palette};
use telltale_engine::input::Refusal;

/// The format that a client reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Speaks {
    /// A browser.
    Html,
    /// A program.
    Json,
}

/// The format and language of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reader {
    pub speaks: Speaks,
    pub lang: Lang,
    pub palette: Palette,
    pub part: PagePart,
    pub home: Home,
}

/// The header by which a page's script names the part of the answer that it needs.
const PART: &str = "telltale-part";

impl Reader {
    /// `extensions` are those of the request: a server that is no vehicle's puts its [`Home`] there.
    pub fn of(uri: &Uri, headers: &HeaderMap, extensions: &Extensions) -> Reader {
        let accepts_json = header(headers, ACCEPT.as_str())
            .is_some_and(|accept| accept.contains("application/json") && !accept.contains("text/html"));
        let speaks = if accepts_json || is_for_programs(uri.path()) { Speaks::Json } else { Speaks::Html };
        let lang = cookie(headers, "lang").and_then(Lang::from_word).or_else(|| preferred(headers));
        let palette = cookie(headers, "palette").and_then(Palette::from_word);
        Reader {
            speaks,
            lang: lang.unwrap_or_default(),
            palette: palette.unwrap_or_default(),
            part: header(headers, PART).and_then(PagePart::from_word).unwrap_or_default(),
            home: extensions.get().copied().unwrap_or_default(),
        }
    }
}

/// Addresses at which nobody reads a page: of the API, and of the script of a replay.
fn is_for_programs(path: &str) -> bool {
    path.starts_with("/api/") || path.starts_with("/replay/") && path.ends_with("/state")
}

impl<S: Sync> FromRequestParts<S> for Reader {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Reader, Infallible> {
        Ok(Reader::of(&parts.uri, &parts.headers, &parts.extensions))
    }
}

/// A header that is text; the first, if it is there more than once.
pub fn header<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    headers.get(name)?.to_str().ok()
}

/// A cookie by its name; the first, if it is there more than once.
pub fn cookie<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    cookies(headers, name).next()
}

/// All cookies of this name.
pub fn cookies<'a>(headers: &'a HeaderMap, name: &str) -> impl Iterator<Item = &'a str> {
    let lines = headers.get_all(COOKIE).iter().filter_map(|line| line.to_str().ok());
    let pairs = lines.flat_map(|line| line.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.filter(move |(found, _)| *found == name).map(|(_, value)| value)
}

/// The first known language of `Accept-Language`. Browsers list the preferred one first.
fn preferred(headers: &HeaderMap) -> Option<Lang> {
    let tags = header(headers, ACCEPT_LANGUAGE.as_str())?.split(',');
    tags.filter_map(|tag| tag.trim().get(..2)).find_map(|tag| Lang::from_word(&tag.to_ascii_lowercase()))
}

/// Why a request was not answered as it was meant.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "Error")]
pub struct ErrorAnswer<'a> {
    /// For people, in the language of `Accept-Language`: English or German.
    pub error: &'a str,
}

impl ErrorAnswer<'_> {
    fn with(&self, status: StatusCode) -> Response {
        (status, axum::Json(self)).into_response()
    }
}

/// Why an action was not done.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "Refused")]
pub struct RefusedAnswer<'a> {
    /// One reason for each check that fails.
    pub refused: &'a [String],
    /// The present state, where the request was made for an older one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seq: Option<u64>,
}

/// An answer without words, which [`in_words`](super::plain_errors::in_words) says to the reader.
impl IntoResponse for HttpError {
    fn into_response(self) -> Response {
        (self.status(), Extension(self)).into_response()
    }
}

/// Says what is wrong: a page, or `{"error": ...}`.
pub fn refusal(reader: &Reader, trouble: HttpError) -> Response {
    refusal_with(reader, trouble, reader.lang.error_text(trouble))
}

/// The same with a text that says more.
fn refusal_with(reader: &Reader, trouble: HttpError, text: &str) -> Response {
    match reader.speaks {
        Speaks::Json => ErrorAnswer { error: text }.with(trouble.status()),
        Speaks::Html => page(reader, trouble.status(), reader.lang.error_title(trouble), text),
    }
}

fn page(reader: &Reader, status: StatusCode, title: &str, text: &str) -> Response {
    let Reader { home, lang, palette, .. } = *reader;
    (status, Html(view::message_page(status.as_u16(), title, text, home, lang, palette))).into_response()
}

/// A form that was sent.
#[derive(Debug)]
pub struct FormOf<T>(pub T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequest<S> for FormOf<T> {
    type Rejection = Response;

    async fn from_request(request: Request, state: &S) -> Result<FormOf<T>, Response> {
        let reader = Reader::of(request.uri(), request.headers(), request.extensions());
        let form = Form::from_request(request, state).await;
        form.map(|Form(form)| FormOf(form)).map_err(|rejection| bad_form(&reader, &rejection))
    }
}

/// Names the field of a form that cannot be read.
pub fn bad_form(reader: &Reader, rejection: &FormRejection) -> Response {
    let text = rejection.body_text();
    let why = text.split_once("form body: ").map_or("", |(_, why)| why);
    let missing = why.strip_prefix("missing field `").and_then(|rest| rest.split_once('`'));
    let field = missing.or_else(|| why.split_once(": ")).map_or("", |(field, _)| field);
    bad_field(reader, field)
}

/// Names the fields of a form that was read and has a wrong value.
pub fn bad_field(reader: &Reader, field: &str) -> Response {
    let is_name = |c: char| c.is_ascii_alphanumeric() || "_, ".contains(c);
    let general = reader.lang.error_text(HttpError::BadForm);
    if field.is_empty() || field.len() > FIELD_MAX || !field.chars().all(is_name) {
        return refusal(reader, HttpError::BadForm);
    }
    refusal_with(reader, HttpError::BadForm, &reader.lang.wrong_field(general, field))
}

/// A parameter of an address is unknown or has a wrong value: 400, and what to write.
pub fn bad_query(reader: &Reader, why: &str) -> Response {
    let why = &why[..why.floor_char_boundary(WHY_BYTES_MAX)];
    let text = reader.lang.bad_address(why);
    ErrorAnswer { error: &text }.with(StatusCode::BAD_REQUEST)
}

/// The part of a wrong address that is repeated.
const WHY_BYTES_MAX: usize = 200;

/// Longer names of fields are not repeated in an answer.
const FIELD_MAX: usize = 40;

/// Says what the engine did not grant: 409 with a page, or `{"refused": [...]}`.
pub fn refused(reader: &Reader, reasons: &[Refusal]) -> Response {
    let words: Vec<String> = reasons.iter().map(|reason| reader.lang.refusal(reason)).collect();
    refused_in_words(reader, &words, None)
}

/// The same in words; `seq` is the present state's where the request was made for an older one.
pub fn refused_in_words(reader: &Reader, reasons: &[String], seq: Option<u64>) -> Response {
    match reader.speaks {
        Speaks::Json => {
            (StatusCode::CONFLICT, axum::Json(RefusedAnswer { refused: reasons, seq })).into_response()
        }
        Speaks::Html => {
            page(reader, StatusCode::CONFLICT, Words::of(reader.lang).refused_title, &reasons.join(" "))
        }
    }
}

pub fn json_answer(status: StatusCode, value: &Value) -> Response {
    (status, [(CONTENT_TYPE, "application/json")], plain_json(value.to_string())).into_response()
}
