//! The rules of the house that the compiler does not hold: who may use whom, how long a file may
//! be, where a clock is read, that no template is dead, and how pages, scripts and styles begin.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Each room of `src` and what it may use of the others, beside what it holds itself. `cli` and
/// the crate's root wire everything.
const MAY_USE: &[(&str, &[&str])] = &[
    ("engine", &[]),
    ("input_file", &[]),
    ("yaml", &["input_file"]),
    ("config", &["engine", "yaml"]),
    ("import", &["engine", "yaml", "config"]),
    ("clock", &["engine"]),
    ("init", &["engine", "yaml"]),
    ("record", &["engine", "clock", "input_file", "msg"]),
    ("latency", &["engine"]),
    ("runtime", &["engine", "clock", "latency", "msg", "record"]),
    ("msg", &["engine", "input_file"]),
    ("replay", &["engine", "input_file", "yaml", "config", "msg", "record"]),
    ("ros", &["engine", "clock", "msg"]),
    ("store", &["engine", "clock", "latency", "record", "yaml"]),
    ("picture", &["engine", "yaml"]),
    ("sim", &["engine", "yaml", "config", "picture"]),
    ("web", &["engine", "clock", "latency", "runtime", "store", "picture", "record", "replay"]),
    ("metrics", &["engine", "latency", "record", "runtime", "web"]),
];

/// Words that must not stand in the pure core. Its types derive serde's traits; the format of a file is another
/// room's affair.
const IMPURE: &[&str] = &[
    "tokio",
    "serde_json",
    "tracing",
    "std::fs",
    "std::net",
    "std::thread",
    "std::env",
    "async fn",
    "println!",
];

const LINES_MAX: usize = 600;
const COLUMNS_MAX: usize = 140;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = below(folder, extension);
    found.sort();
    assert!(!found.is_empty(), "nothing to look at in {}", folder.display());
    found
}

fn below(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    for entry in entries {
        let path = entry.expect("the folder can be listed").path();
        if path.is_dir() {
            found.extend(below(&path, extension));
        } else if path.extension().is_some_and(|it| it == extension) {
            found.push(path);
        }
    }
    found
}

/// The room of a source file: its first folder under `src`, or its own name there.
fn room(file: &Path) -> String {
    let inside = file.strip_prefix(root().join("src")).expect("it was found there");
    let first = inside.components().next().expect("a file has a name").as_os_str().to_string_lossy();
    first.trim_end_matches(".rs").to_owned()
}

/// The source without its comments and without the tests at its end.
fn code(file: &Path) -> String {
    let text = fs::read_to_string(file).expect("sources are readable");
    let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    code.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

#[test]
fn rooms_use_only_what_they_may() {
    let mut wrong = Vec::new();
    for file in files(&root().join("src"), "rs") {
        let room = room(&file);
        let Some((_, allowed)) = MAY_USE.iter().find(|(name, _)| *name == room) else { continue };
        let code = code(&file);
        assert!(!code.contains("crate::{"), "{}: name each room in a `use` of its own", file.display());
        for used in code.split("crate::").skip(1) {
            let used: String = used.chars().take_while(|it| it.is_alphanumeric() || *it == '_').collect();
            if used != room && !allowed.contains(&used.as_str()) {
                wrong.push(format!("{} uses {used}", file.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The modules that a file imports, each as its path from `src`.
fn imports(file: &Path) -> Vec<Vec<String>> {
    let inside = file.strip_prefix(root().join("src")).expect("it was found there").with_extension("");
    let mut own: Vec<String> = inside.iter().map(|it| it.to_string_lossy().into_owned()).collect();
    if own.last().is_some_and(|it| it == "mod") {
        own.pop();
    }
    let mut found = Vec::new();
    let code = code(file);
    for (start, _) in code.match_indices("crate::").chain(code.match_indices("super::")) {
        if code[..start].ends_with(|it: char| it == ':' || it.is_alphanumeric()) {
            continue;
        }
        let path = code[start..].split(|it: char| !(it.is_alphanumeric() || it == '_' || it == ':'));
        let mut path: Vec<&str> =
            path.take(1).flat_map(|it| it.split("::")).filter(|it| !it.is_empty()).collect();
        let mut base = if path[0] == "crate" { Vec::new() } else { own.clone() };
        while path.first().is_some_and(|it| ["crate", "super"].contains(it)) {
            if path.remove(0) == "super" {
                base.pop();
            }
        }
        base.extend(
            path.into_iter().take_while(|it| it.starts_with(|it: char| it.is_lowercase())).map(str::to_owned),
        );
        found.push(base);
    }
    found.iter().map(|it| [&own[..], &["->".to_owned()], it].concat()).collect()
}

/// What stands beside one another in a folder never imports in a circle, where a folder is part of it:
/// so each folder can be read, tried and changed with only what is below it.
#[test]
fn no_circle_of_imports_goes_through_a_folder() {
    let mut edges: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let src = root().join("src");
    for file in files(&src, "rs") {
        if file.iter().any(|it| it == "tests" || it == "tests.rs") {
            continue;
        }
        for line in imports(&file) {
            let arrow = line.iter().position(|it| it == "->").expect("it was put there");
            let (from, to) = (&line[..arrow], &line[arrow + 1..]);
            let common = from.iter().zip(to).take_while(|(from, to)| from == to).count();
            let is_module = |path: &[String]| {
                let at = src.join(path.join("/"));
                at.is_dir() || at.with_extension("rs").is_file()
            };
            if common < from.len() && common < to.len() && is_module(&to[..=common]) {
                edges.entry(from[..=common].join("/")).or_default().insert(to[..=common].join("/"));
            }
        }
    }
    let reached = |start: &str| {
        let (mut seen, mut next) = (BTreeSet::new(), vec![start]);
        while let Some(at) = next.pop() {
            for to in edges.get(at).into_iter().flatten() {
                if seen.insert(to.as_str()) {
                    next.push(to);
                }
            }
        }
        seen
    };
    let folders = edges.keys().filter(|it| src.join(it).join("mod.rs").is_file());
    let circles: Vec<&String> = folders.filter(|it| reached(it).contains(it.as_str())).collect();
    assert!(circles.is_empty(), "these import what imports them: {circles:#?}");
}

/// The rows of the table in `docs/architecture.md` that says how the folders of a room stand on one
/// another: each row names modules that may import those of rows above it and of its own.
fn table_of(room: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(root().join("docs/architecture.md")).expect("the document is readable");
    let head = format!("| folder of `{room}` |");
    let lines = text.lines().skip_while(|line| !line.starts_with(&head)).skip(2);
    lines
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.split('|').nth(1).unwrap_or_default().split('`').skip(1).step_by(2))
        .map(|names| names.map(|it| it.trim_end_matches('/').to_owned()).collect())
        .collect()
}

#[test]
fn folders_stand_on_one_another_as_the_document_says() {
    for room in ["config", "engine", "web", "web/view"] {
        let rows = table_of(room);
        let row_of = |name: &str| rows.iter().position(|row| row.iter().any(|it| it == name));
        let folder = root().join("src").join(room);
        for name in rows.iter().flatten() {
            let is_there = folder.join(name).is_dir() || folder.join(name).with_extension("rs").is_file();
            assert!(is_there, "the table of {room} names `{name}`, which is not there");
        }
        let mut wrong = Vec::new();
        for file in files(&folder, "rs") {
            if file.iter().any(|it| it == "tests" || it == "tests.rs") {
                continue;
            }
            let inside = file.strip_prefix(&folder).expect("it was found there");
            let own = inside.iter().next().expect("a file has a name").to_string_lossy();
            let own = own.trim_end_matches(".rs");
            if folder.join(own).join("mod.rs").is_file() {
                assert!(row_of(own).is_some(), "the table of {room} lacks the folder `{own}/`");
            }
            for line in imports(&file) {
                let arrow = line.iter().position(|it| it == "->").expect("it was put there");
                let to = line[arrow + 1..].join("/");
                let Some(to) = to.strip_prefix(room).and_then(|rest| rest.strip_prefix('/')) else {
                    continue;
                };
                let to = to.split('/').next().unwrap_or_default();
                if row_of(own).is_some_and(|own| row_of(to).is_some_and(|to| to > own)) {
                    wrong.push(format!("{} imports {to}", file.display()));
                }
            }
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
    }
}

#[test]
fn every_room_has_a_rule() {
    for file in files(&root().join("src"), "rs") {
        let room = room(&file);
        let known = MAY_USE.iter().any(|(name, _)| *name == room) || ["main", "lib", "cli"].contains(&&*room);
        assert!(known, "{} belongs to no room that this test knows", file.display());
    }
}

#[test]
fn the_core_is_pure() {
    for file in files(&root().join("src/engine"), "rs") {
        let code = code(&file);
        for word in IMPURE {
            assert!(!code.contains(word), "{} holds `{word}`", file.display());
        }
    }
}

#[test]
fn clocks_are_read_in_one_file() {
    for file in files(&root().join("src"), "rs") {
        if file.ends_with("src/clock.rs") {
            continue;
        }
        let code = code(&file);
        for word in ["Instant::now", "SystemTime::now", "UtcDateTime::now"] {
            assert!(!code.contains(word), "{} holds `{word}`: ask clock::Clock", file.display());
        }
    }
}

#[test]
fn files_are_short_enough_to_be_read() {
    let mut long = Vec::new();
    for folder in ["src", "tests/it"] {
        for file in files(&root().join(folder), "rs") {
            let lines = fs::read_to_string(&file).expect("sources are readable").lines().count();
            if lines > LINES_MAX {
                long.push(format!("{}: {lines} lines", file.display()));
            }
        }
    }
    assert!(long.is_empty(), "{long:#?}");
}

#[test]
fn scripts_and_styles_have_lines_that_can_be_read() {
    let mut long = Vec::new();
    for file in files(&root().join("static"), "js").into_iter().chain(files(&root().join("static"), "css")) {
        if file.iter().any(|it| it == "vendor") {
            continue;
        }
        let text = fs::read_to_string(&file).expect("static files are readable");
        let over = text.lines().enumerate().filter(|(_, line)| line.chars().count() > COLUMNS_MAX);
        long.extend(over.map(|(index, _)| format!("{}:{}", file.display(), index + 1)));
    }
    assert!(long.is_empty(), "longer than {COLUMNS_MAX} columns: {long:#?}");
}

#[test]
fn pages_scripts_and_styles_say_first_what_they_are_for() {
    for (folder, extension, opening) in
        [("static", "js", "// "), ("static", "css", "/* "), ("templates", "html", "{# ")]
    {
        for file in files(&root().join(folder), extension) {
            let text = fs::read_to_string(&file).expect("they are readable");
            let is_vendored = file.iter().any(|it| it == "vendor");
            assert!(is_vendored || text.starts_with(opening), "{} has no first line", file.display());
        }
    }
}

#[test]
fn no_template_is_dead() {
    let sources: String = files(&root().join("src"), "rs").iter().map(|file| code(file)).collect();
    let templates = files(&root().join("templates"), "html");
    let texts: Vec<String> =
        templates.iter().map(|file| fs::read_to_string(file).expect("templates are readable")).collect();
    for file in &templates {
        let name = file.strip_prefix(root().join("templates")).expect("it was found there");
        let quoted = format!("\"{}\"", name.display());
        let used = sources.contains(&quoted) || texts.iter().any(|text| text.contains(&quoted));
        assert!(used, "templates/{} is used by nothing", name.display());
    }
}
