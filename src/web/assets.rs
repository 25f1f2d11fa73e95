//! The files below `static/`, embedded in the binary, under names that change with their content.

use std::sync::LazyLock;

use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use rust_embed::RustEmbed;
use sha2::{Digest, Sha256};

use super::view::LOGIN_ASSETS;

#[derive(RustEmbed)]
#[folder = "static/"]
struct Assets;

const ROOT: &str = "/static/";

/// One version over all files, so that a stylesheet names its fonts by relative paths and
/// still gets those it was made with.
static VERSION: LazyLock<String> = LazyLock::new(|| {
    let mut names: Vec<_> = Assets::iter().collect();
    names.sort();
    let mut hash = Sha256::new();
    for name in names {
        hash.update(name.as_bytes());
        if let Some(file) = Assets::get(&name) {
            hash.update(file.metadata.sha256_hash());
        }
    }
    hash.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect()
});

/// Where a page finds the file `static/NAME`: the address changes when any file does.
pub fn url(name: &str) -> String {
    format!("{ROOT}{}/{name}", *VERSION)
}

/// Whether the file at this address is served without a session.
pub fn is_open(address: &str) -> bool {
    let name = name(address);
    LOGIN_ASSETS.iter().any(|open| match open.strip_suffix('/') {
        Some(_) => name.starts_with(open),
        None => name == *open,
    })
}

/// The file at this address, if there is one. Browsers keep none, as they keep no page.
pub fn answer(address: &str) -> Option<Response> {
    let name = name(address);
    let file = Assets::get(name)?;
    Some(([(CONTENT_TYPE, content_type(name))], file.data).into_response())
}

/// The name of a file from its address, with or without the version.
fn name(address: &str) -> &str {
    let path = address.strip_prefix(ROOT).unwrap_or_default();
    let versioned = path.strip_prefix(VERSION.as_str()).and_then(|rest| rest.strip_prefix('/'));
    versioned.unwrap_or(path)
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
