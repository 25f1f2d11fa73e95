//! The files below `static/`, embedded in the binary, under names that change with their content.

use std::collections::HashMap;
use std::io::Read as _;
use std::sync::LazyLock;
use telltale_engine::text::hex;

use axum::body::Bytes;
use axum::http::header::{
    ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_TYPE, ETAG, IF_NONE_MATCH, VARY,
};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use flate2::Compression;
use flate2::read::GzEncoder;
use rust_embed::RustEmbed;
use sha2::{Digest, Sha256};

/// Files below `static/` that the login page needs: served without a session, so none of them may
/// name a part of the vehicle. An entry that ends in `/` names a folder.
const LOGIN_ASSETS: &[&str] = &[
    "telltale.css",
    "page.js",
    "pad.js",
    "icon.svg",
    "telltale.webmanifest",
    "vendor/inter-latin-wght-normal.woff2",
];

#[derive(RustEmbed)]
#[folder = "../../static/"]
struct Assets;

const ROOT: &str = "/static/";

/// For what anybody may have, and for what needs a session: no proxy may keep that for others.
const KEPT_BY_ALL: HeaderValue = HeaderValue::from_static("public, max-age=31536000, immutable");
const KEPT_BY_THE_BROWSER: HeaderValue = HeaderValue::from_static("private, max-age=31536000, immutable");

/// A file, or a document that stays as it is, in the forms in which it is sent.
#[derive(Debug)]
pub struct File {
    plain: Form,
    /// `None` where it is hardly smaller.
    compressed: Option<Form>,
}

#[derive(Debug)]
struct Form {
    data: Bytes,
    tag: HeaderValue,
}

/// All files, read and compressed when the first page is asked for. A development build has them from
/// the disk: start it again after a change.
static FILES: LazyLock<HashMap<String, File>> = LazyLock::new(|| {
    let files = Assets::iter().filter_map(|name| Some((name.to_string(), File::of(Assets::get(&name)?))));
    files.collect()
});

/// One version over all files, so that a stylesheet names its fonts by relative paths and
/// still gets those it was made with.
static VERSION: LazyLock<String> = LazyLock::new(|| {
    let mut names: Vec<_> = FILES.iter().collect();
    names.sort_by_key(|(name, _)| *name);
    let mut hash = Sha256::new();
    for (name, file) in names {
        hash.update(name.as_bytes());
        hash.update(&file.plain.tag);
    }
    hex(&hash.finalize()[..8])
});

impl File {
    fn of(file: rust_embed::EmbeddedFile) -> File {
        let hash = hex(&file.metadata.sha256_hash()[..8]);
        File::new(file.data.into_owned().into(), &hash)
    }

    /// A document, compressed here once and for all.
    pub fn json(document: &serde_json::Value) -> File {
        let data = Bytes::from(document.to_string());
        let hash = hex(&Sha256::digest(&data)[..8]);
        File::new(data, &hash)
    }

    fn new(data: Bytes, hash: &str) -> File {
        let mut small = Vec::new();
        // Only the disk makes reading fail.
        let _ = GzEncoder::new(&*data, Compression::best()).read_to_end(&mut small);
        let is_worth_it = !small.is_empty() && small.len() < data.len() / 10 * 9;
        File {
            plain: Form::new(data, hash),
            compressed: is_worth_it.then(|| Form::new(small.into(), &format!("{hash}-gzip"))),
        }
    }

    /// The form that the browser takes; nothing if it has that already.
    pub fn answer(&self, content_type: &'static str, headers: &HeaderMap) -> Response {
        let compressed = self.compressed.as_ref().filter(|_| takes_gzip(headers));
        let form = compressed.unwrap_or(&self.plain);
        let mut answer = match has(headers, &form.tag) {
            true => StatusCode::NOT_MODIFIED.into_response(),
            false => form.data.clone().into_response(),
        };
        let about = answer.headers_mut();
        about.insert(ETAG, form.tag.clone());
        about.insert(VARY, HeaderValue::from_static("accept-encoding"));
        about.insert(CONTENT_TYPE, HeaderValue::from_static(content_type));
        if compressed.is_some() {
            about.insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
        }
        answer
    }
}

impl Form {
    /// Two forms of a file are not the same bytes, so they have different tags.
    fn new(data: Bytes, tag: &str) -> Form {
        let tag = HeaderValue::try_from(format!("\"{tag}\"")).expect("hexadecimal digits are visible ASCII");
        Form { data, tag }
    }
}

/// Where a page finds the file `static/NAME`: the address changes when any file does.
pub fn url(name: &str) -> String {
    format!("{ROOT}{}/{name}", *VERSION)
}

/// Whether the file at this address is served without a session.
pub fn is_open(address: &str) -> bool {
    let (name, _) = parts(address);
    LOGIN_ASSETS.iter().any(|open| match open.strip_suffix('/') {
        Some(_) => name.starts_with(open),
        None => name == *open,
    })
}

/// The file at this address, if there is one. A browser keeps it for as long as its address has the
/// version: at that address it never changes.
pub fn answer(address: &str, headers: &HeaderMap) -> Option<Response> {
    let (name, is_versioned) = parts(address);
    let mut answer = FILES.get(name)?.answer(content_type(name), headers);
    if is_versioned {
        let kept = if is_open(address) { KEPT_BY_ALL } else { KEPT_BY_THE_BROWSER };
        answer.headers_mut().insert(CACHE_CONTROL, kept);
    }
    Some(answer)
}

/// The members of a header that is a list.
fn list<'a>(headers: &'a HeaderMap, name: &axum::http::HeaderName) -> impl Iterator<Item = &'a str> {
    headers
        .get_all(name)
        .into_iter()
        .filter_map(|it| it.to_str().ok())
        .flat_map(|it| it.split(','))
        .map(str::trim)
}

fn takes_gzip(headers: &HeaderMap) -> bool {
    list(headers, &ACCEPT_ENCODING).any(|it| {
        let (coding, weight) = it.split_once(';').unwrap_or((it, ""));
        let is_refused = weight.trim().strip_prefix("q=").is_some_and(|q| q.parse() == Ok(0.0));
        coding.trim().eq_ignore_ascii_case("gzip") && !is_refused
    })
}

/// Whether the browser has what has this tag.
fn has(headers: &HeaderMap, tag: &HeaderValue) -> bool {
    list(headers, &IF_NONE_MATCH).any(|it| it == "*" || it.strip_prefix("W/").unwrap_or(it) == tag)
}

/// The name of a file from its address, and whether the address has the version.
fn parts(address: &str) -> (&str, bool) {
    let path = address.strip_prefix(ROOT).unwrap_or_default();
    let versioned = path.strip_prefix(VERSION.as_str()).and_then(|rest| rest.strip_prefix('/'));
    (versioned.unwrap_or(path), versioned.is_some())
}

fn content_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map(|(_, extension)| extension) {
        Some("css") => "text/css; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("svg") => "image/svg+xml",
        Some("png") => "image/png",
        Some("ico") => "image/x-icon",
        Some("woff2") => "font/woff2",
        Some("webmanifest") => "application/manifest+json",
        Some("ogg") => "audio/ogg",
        Some("wav") => "audio/wav",
        _ => "application/octet-stream",
    }
}
