//! The rules of the house that neither the compiler nor clippy holds: circles of imports, where modules stand, how long a
//! file may be, that no template is dead, how pages, scripts and styles begin, and the sentences of the documentation
//! about the house.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Words that must not stand in the pure core; its packages are those of `crates/engine/Cargo.toml`.
const IMPURE: &[&str] = &["std::fs", "std::net", "std::thread", "std::env", "async fn", "println!"];

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

/// The folders of the packages, with their names.
fn packages() -> BTreeMap<String, PathBuf> {
    let crates = fs::read_dir(root().join("crates")).expect("the folder can be listed");
    let crates = crates.map(|entry| entry.expect("the folder can be listed").path());
    let named = crates.map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), path));
    named.chain([("telltale".into(), root())]).collect()
}

/// The sources of all packages.
fn sources() -> Vec<PathBuf> {
    packages().values().flat_map(|package| files(&package.join("src"), "rs")).collect()
}

/// The tests from outside.
fn tests() -> Vec<PathBuf> {
    ["tests/it", "crates/web/tests"].iter().flat_map(|folder| files(&root().join(folder), "rs")).collect()
}

/// The source without its comments and without the tests at its end.
fn code(file: &Path) -> String {
    let text = fs::read_to_string(file).expect("sources are readable");
    let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    code.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

/// The packages of this repository that a package needs, without those of its tests.
fn needs(package: &Path) -> BTreeSet<String> {
    let text = fs::read_to_string(package.join("Cargo.toml")).expect("a package has a manifest");
    let lines = text.lines().skip_while(|line| *line != "[dependencies]").skip(1);
    let lines = lines.take_while(|line| !line.starts_with('['));
    lines.filter_map(|line| Some(line.strip_prefix("telltale-")?.split('.').next()?.to_owned())).collect()
}

#[test]
fn the_document_names_each_package_with_what_it_needs() {
    let text = fs::read_to_string(root().join("docs/architecture.md")).expect("the document is readable");
    let rows = text.lines().skip_while(|line| !line.starts_with("| package |")).skip(2);
    let cells = rows.take_while(|line| line.starts_with('|')).map(|line| line.split('|').collect::<Vec<_>>());
    let names =
        |cell: &str| -> Vec<String> { cell.split('`').skip(1).step_by(2).map(str::to_owned).collect() };
    let said: BTreeMap<String, BTreeSet<String>> =
        cells.map(|cells| (names(cells[1])[0].clone(), names(cells[3]).into_iter().collect())).collect();
    let all: BTreeSet<String> = packages().into_keys().filter(|name| name != "telltale").collect();
    let needed = packages().into_iter().map(|(name, path)| (name, needs(&path)));
    let needed =
        needed.map(
            |(name, needs)| if needs == all { (name, BTreeSet::from(["all".into()])) } else { (name, needs) },
        );
    assert_eq!(said, needed.collect());
}

/// What the document names with a file's extension or as a folder lies at the end of some path here.
#[test]
fn the_document_names_no_file_that_is_not_there() {
    let text = fs::read_to_string(root().join("docs/architecture.md")).expect("the document is readable");
    // As it lies here, and as the page shortens it.
    let both = |path: &Path| {
        let path = format!("/{}", path.strip_prefix(root()).expect("it was found there").display());
        let short = path.replacen("/crates/", "/", 1).replacen("/src/", "/", 1);
        [path, short]
    };
    let mut known: Vec<String> = Vec::new();
    for folder in ["src", "crates", "docs", "static", "templates", "tests", "config", "benches"] {
        for extension in ["rs", "md", "js", "css", "html", "yaml", "py", "sh", "json"] {
            known.extend(below(&root().join(folder), extension).iter().flat_map(|it| both(it)));
        }
    }
    let is_there = |name: &str| {
        let end = format!("/{}", name.trim_end_matches('/'));
        known.iter().any(|path| match name.ends_with('/') {
            true => path.contains(&format!("{end}/")),
            false => path.ends_with(&end),
        })
    };
    let looks_like_a_file = |name: &str| {
        // `KIND.rs` stands for many.
        let is_path = name.chars().all(|it| it.is_lowercase() || it.is_numeric() || "/_.-".contains(it));
        let is_file = [".rs", ".md", ".js", ".css", ".html", ".yaml", ".py", ".sh"]
            .iter()
            .any(|end| name.ends_with(end));
        is_path && !name.starts_with('/') && (is_file || name.ends_with('/'))
    };
    let named = text.split("```").step_by(2).flat_map(|text| text.split('`').skip(1).step_by(2));
    let gone: Vec<&str> = named.filter(|name| looks_like_a_file(name) && !is_there(name)).collect();
    assert!(gone.is_empty(), "docs/architecture.md names what is not there: {gone:#?}");
}

/// The paths that a `use` names, with those in its braces, and each other path from the package's root or from the
/// module around.
fn paths(code: &str) -> Vec<Vec<&str>> {
    let mut found = Vec::new();
    let starts = code.match_indices("crate::").chain(code.match_indices("super::"));
    for (start, _) in starts {
        if code[..start].ends_with(|it: char| it == ':' || it.is_alphanumeric() || it == '_' || it == '$') {
            continue;
        }
        expand(&code[start..], &mut Vec::new(), &mut found);
    }
    found
}

/// Reads one path with its braces and returns the rest of the text.
fn expand<'c>(mut text: &'c str, before: &mut Vec<&'c str>, found: &mut Vec<Vec<&'c str>>) -> &'c str {
    let depth = before.len();
    loop {
        let end = text.find(|it: char| !(it.is_alphanumeric() || it == '_')).unwrap_or(text.len());
        before.push(&text[..end]);
        text = &text[end..];
        let Some(rest) = text.strip_prefix("::") else { break };
        text = rest;
        let Some(inside) = text.strip_prefix('{') else { continue };
        text = inside.trim_start();
        while !text.is_empty() && !text.starts_with('}') {
            text = expand(text, before, found).trim_start();
            text = text.strip_prefix(',').unwrap_or(text).trim_start();
        }
        before.truncate(depth);
        return text.strip_prefix('}').unwrap_or(text);
    }
    found.push(before.clone());
    before.truncate(depth);
    // `as name`, or a glob.
    let end = text.find([',', '}', ';', '\n', '(', ')', ' ']).unwrap_or(text.len());
    let text = &text[end..];
    text.strip_prefix(" as ").map_or(text, |rest| &rest[rest.find([',', '}', ';']).unwrap_or(rest.len())..])
}

#[test]
fn paths_are_read_with_their_braces() {
    let code =
        "use crate::a::{self, b::{C, d}, e as f};\nuse super::g;\nlet x = crate::h::I::new(); $crate::j::k";
    let read: Vec<String> = paths(code).iter().map(|path| path.join("::")).collect();
    let expected =
        ["crate::a::self", "crate::a::b::C", "crate::a::b::d", "crate::a::e", "crate::h::I::new", "super::g"];
    assert_eq!(read, expected);
}

/// The modules that a file imports, each as its path from the package's root.
fn imports(src: &Path, file: &Path) -> Vec<(Vec<String>, Vec<String>)> {
    let inside = file.strip_prefix(src).expect("it was found there").with_extension("");
    let mut own: Vec<String> = inside.iter().map(|it| it.to_string_lossy().into_owned()).collect();
    if own.last().is_some_and(|it| it == "mod") || own == ["lib"] {
        own.pop();
    }
    let code = code(file);
    let absolute = |path: Vec<&str>| {
        let mut base = if path[0] == "crate" { Vec::new() } else { own.clone() };
        let mut rest = &path[..];
        while let Some(&first) = rest.first().filter(|it| ["crate", "super"].contains(*it)) {
            rest = &rest[1..];
            if first == "super" {
                base.pop();
            }
        }
        let names =
            rest.iter().take_while(|it| it.starts_with(|it: char| it.is_lowercase()) && **it != "self");
        base.extend(names.map(|it| (*it).to_owned()));
        base
    };
    paths(&code).into_iter().map(|path| (own.clone(), absolute(path))).collect()
}

/// What stands beside one another in a folder never imports in a circle, where a folder is part of it:
/// so each folder can be read, tried and changed with only what is below it.
#[test]
fn no_circle_of_imports_goes_through_a_folder() {
    for (name, package) in packages() {
        let src = package.join("src");
        let mut edges: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for file in files(&src, "rs") {
            if file.iter().any(|it| it == "tests" || it == "tests.rs") {
                continue;
            }
            for (from, to) in imports(&src, &file) {
                let common = from.iter().zip(&to).take_while(|(from, to)| from == to).count();
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
        let folders = edges.keys().filter(|it| src.join(it).is_dir());
        let circles: Vec<&String> = folders.filter(|it| reached(it).contains(it.as_str())).collect();
        assert!(circles.is_empty(), "these of {name} import what imports them: {circles:#?}");
    }
}

/// A module with parts has one form: the folder holds all of it, in `mod.rs` and beside.
#[test]
fn no_file_stands_beside_a_folder_of_its_name() {
    let all = sources().into_iter().chain(tests());
    let beside: Vec<PathBuf> = all.filter(|file| file.with_extension("").is_dir()).collect();
    assert!(beside.is_empty(), "move these to `mod.rs` in their folders: {beside:#?}");
}

#[test]
fn the_core_is_pure() {
    for file in files(&root().join("crates/engine/src"), "rs") {
        let code = code(&file);
        for word in IMPURE {
            assert!(!code.contains(word), "{} holds `{word}`", file.display());
        }
    }
}

#[test]
fn files_are_short_enough_to_be_read() {
    let mut long = Vec::new();
    for file in sources().into_iter().chain(tests()) {
        let lines = fs::read_to_string(&file).expect("sources are readable").lines().count();
        if lines > LINES_MAX {
            long.push(format!("{}: {lines} lines", file.display()));
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
fn files_say_first_what_they_are_for() {
    let rust = ["src", "crates", "tests", "benches"].map(|folder| (folder, "rs", "//! "));
    let pages = [("static", "js", "// "), ("static", "css", "/* "), ("templates", "html", "{# ")];
    for (folder, extension, opening) in rust.into_iter().chain(pages) {
        for file in files(&root().join(folder), extension) {
            let text = fs::read_to_string(&file).expect("they are readable");
            let is_vendored = file.iter().any(|it| it == "vendor");
            assert!(is_vendored || text.starts_with(opening), "{} has no first line", file.display());
        }
    }
}

#[test]
fn no_template_is_dead() {
    let sources: String = sources().iter().map(|file| code(file)).collect();
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

/// The words of each language stand in `web/texts/` alone, so that another language is a column there.
#[test]
fn the_languages_of_the_pages_stand_in_one_table() {
    const BESIDE: [&str; 5] = ["Lang::De", "Lang::En =>", "== Lang::En", ".choose(\"", "\"de\""];
    let web = root().join("crates/web/src");
    let outside = files(&web, "rs").into_iter().filter(|file| !file.starts_with(web.join("texts")));
    let pages =
        files(&root().join("templates"), "html").into_iter().chain(files(&root().join("static"), "js"));
    for file in outside.chain(pages) {
        if file.iter().any(|it| it == "vendor" || it == "tests" || it == "tests.rs") {
            continue;
        }
        let code = code(&file);
        let is_german = code.contains(|letter| "äöüÄÖÜß".contains(letter));
        let asks = BESIDE.iter().any(|word| code.contains(word));
        assert!(!is_german && !asks, "{} says or asks for a language: web/texts/ does", file.display());
    }
}

#[test]
fn the_tests_that_hold_a_requirement_are_there() {
    let text = fs::read_to_string(root().join("docs/security.md")).expect("it is readable");
    let (_, table) = text.split_once("## Which test holds what").expect("it has the table");
    let table = table.split("\n## ").next().unwrap_or_default();
    let named = table.split('`').skip(1).step_by(2).filter(|name| !name.contains(['/', '.', ' ']));
    let named: BTreeSet<&str> = named.filter(|name| name.matches('_').count() > 1).collect();
    assert!(named.len() > 100, "{} tests are named", named.len());
    let tests = files(&root().join("tests"), "rs").into_iter().chain(files(&root().join("tests"), "py"));
    let sources: Vec<String> = tests
        .chain(files(&root().join("crates"), "rs"))
        .chain(sources())
        .map(|file| fs::read_to_string(file).unwrap())
        .collect();
    let is_there = |name: &&str| {
        let heads = [format!("fn {name}("), format!("def {name}(")];
        sources.iter().any(|text| heads.iter().any(|head| text.contains(head)))
    };
    let missing: Vec<&&str> = named.iter().filter(|name| !is_there(name)).collect();
    assert!(missing.is_empty(), "docs/security.md names {missing:?}");
}
