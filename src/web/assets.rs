//! The files below `static/`, embedded in the binary, under names that change with their content.

use std::sync::LazyLock;

use rust_embed::RustEmbed;
use sha2::{Digest, Sha256};

#[derive(RustEmbed)]
#[folder = "static/"]
struct Assets;

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
    format!("/static/{}/{name}", *VERSION)
}
