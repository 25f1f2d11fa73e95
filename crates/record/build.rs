//! Tells the program its version with the commit that it was built from, as `TELLTALE_VERSION`.
//!
//! The commit is `TELLTALE_COMMIT` of the environment, or what git says, or what `cargo package` noted. Without any
//! of these the version has none. Cargo runs this again only when another commit is checked out or made. A debug build
//! asks no git: this package and all above it would be compiled anew after each commit.

use std::path::Path;
use std::process::Command;

/// The repository, from this package.
const ROOT: &str = "../..";

/// The digits of a commit that are shown.
const DIGITS: usize = 12;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=TELLTALE_COMMIT");
    let commit = given().or_else(from_git).or_else(from_package);
    let version = env!("CARGO_PKG_VERSION");
    match commit {
        Some(commit) => println!("cargo:rustc-env=TELLTALE_VERSION={version} ({commit})"),
        None => println!("cargo:rustc-env=TELLTALE_VERSION={version}"),
    }
}

fn given() -> Option<String> {
    shortened(&std::env::var("TELLTALE_COMMIT").ok()?)
}

fn from_git() -> Option<String> {
    let is_debug = std::env::var("PROFILE").is_ok_and(|profile| profile == "debug");
    // A source without a repository of its own may lie inside another one.
    if is_debug || !Path::new(ROOT).join(".git").exists() {
        return None;
    }
    // Each commit and each checkout adds a line to this log; a name that is not there would run this always.
    let log = git(&["rev-parse", "--git-path", "logs/HEAD"])?;
    let head = git(&["rev-parse", "--git-path", "HEAD"])?;
    for path in [log, head].map(|path| Path::new(ROOT).join(path)) {
        if path.exists() {
            println!("cargo:rerun-if-changed={}", path.display());
        }
    }
    shortened(&git(&["rev-parse", "HEAD"])?)
}

fn from_package() -> Option<String> {
    let noted = std::fs::read_to_string(".cargo_vcs_info.json").ok()?;
    shortened(noted.split("\"sha1\"").nth(1)?.split('"').nth(1)?)
}

fn git(words: &[&str]) -> Option<String> {
    let said = Command::new("git")
        .current_dir(ROOT)
        .args(words)
        .output()
        .ok()
        .filter(|said| said.status.success())?;
    Some(String::from_utf8(said.stdout).ok()?.trim().to_owned())
}

fn shortened(commit: &str) -> Option<String> {
    let digits = commit.trim().get(..DIGITS)?;
    digits.chars().all(|it| it.is_ascii_hexdigit()).then(|| digits.to_owned())
}
