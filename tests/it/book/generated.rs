//! Pages that are made from the program: `BLESS=1 cargo test --test it book` writes them anew.

use std::fmt::Write as _;
use std::path::Path;

use super::{read, root, schema};
use crate::program::run;

/// Compares a page with what is made today, or with BLESS=1 writes it.
#[track_caller]
fn up_to_date(page: &str, made: &str) {
    let path = root().join(page);
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, made).unwrap_or_else(|error| panic!("{page}: {error}"));
    }
    let written = if Path::new(&path).exists() { read(&path) } else { String::new() };
    let differs =
        made.lines().zip(written.lines().chain(std::iter::repeat(""))).find(|(new, old)| new != old);
    let hint = "write it anew: BLESS=1 cargo test --test it book";
    assert!(written == made, "{page} is out of date; {hint}. First difference (new, old): {differs:?}");
}

fn telltale(words: &[&str]) -> String {
    let output = run(words);
    assert!(output.status.success(), "telltale {words:?}: {output:?}");
    String::from_utf8(output.stdout).expect("it prints text")
}

#[test]
fn the_reference_of_the_configuration_is_up_to_date() {
    let head = "# Every key of the configuration\n\nThis page is made from the program's own JSON Schema (`telltale check --schema`). \
        [Configuring Telltale](../configuration.md) explains what the keys are for, with examples.\n\n";
    up_to_date(
        "docs/reference/configuration.md",
        &format!("{head}{}", schema::page(&telltale(&["check", "--schema"]))),
    );
}

#[test]
fn the_reference_of_the_commands_is_up_to_date() {
    let mut page = String::from(
        "# Commands\n\nThis page is what each command prints with `--help`. Exit codes: 0; 1, the answer is no; 2, wrong usage or \
        configuration.\n",
    );
    describe(&mut page, &[]);
    up_to_date("docs/reference/commands.md", &page);
}

/// The help of a command and of all below it.
fn describe(page: &mut String, command: &[&str]) {
    let words = [command, &["--help"]].concat();
    let help = telltale(&words);
    let lines: Vec<&str> = help.lines().map(str::trim_end).collect();
    let title = ["telltale"].iter().chain(command).copied().collect::<Vec<_>>().join(" ");
    let _ = writeln!(page, "\n## {title}\n\n```text\n{}\n```", lines.join("\n"));
    let below =
        lines.iter().skip_while(|line| **line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let names = below.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    for name in names.filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help") {
        describe(page, &[command, &[name]].concat());
    }
}

/// A row of docs/reference/limits.md names where its bound is declared; the declaration has that value.
#[test]
fn the_limits_are_those_of_the_source() {
    let page = read(&root().join("docs/reference/limits.md"));
    let mut wrong = Vec::new();
    let mut checked = 0;
    for line in page.lines().filter(|line| line.starts_with('|')) {
        let Some(cell) = line.trim_end_matches('|').rsplit('|').next().map(str::trim) else { continue };
        let mut parts = cell.split('`').filter(|it| !it.trim().is_empty());
        let (Some(file), Some(declared)) = (parts.next(), parts.next()) else { continue };
        let (package, inside) = file.split_once('/').expect("a package and a file");
        let of_package = root().join("crates").join(package).join("src").join(inside);
        let source = read(&if of_package.is_file() { of_package } else { root().join("src").join(file) });
        let (name, value) =
            declared.split_once(" = ").unwrap_or_else(|| panic!("limits.md: `NAME = VALUE`: {line}"));
        let declares = |line: &str| {
            let line = line
                .trim_start_matches("pub ")
                .trim_start_matches("pub(super) ")
                .trim_start_matches("pub(crate) ");
            let rest = line.strip_prefix("const ").and_then(|it| it.strip_prefix(name));
            rest.is_some_and(|it| it.starts_with(':') && it.ends_with(&format!(" = {value};")))
        };
        checked += 1;
        if !source.lines().any(|line| declares(line.trim())) {
            wrong.push(format!("{file} does not declare {declared}"));
        }
    }
    assert!(wrong.is_empty() && checked > 10, "{checked} checked, wrong: {wrong:#?}");
}
