//! What commands print: outside text begins no line of its own, and a reader who has had enough ends nothing by a panic.

use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use serde_json::Value;

use crate::folder::TestFolder;
use crate::program::{self, run_with, telltale};

const CONFIG: &str = "vehicle: { id: r, stages: none }\nother: { show: counted }\ngroups:\n  - id: base\n    \
                      modules: [{ id: motors, status: 'base: motors', timeout: 2s, stale: error }]\n  - id: odd\n    \
                      match: [{ namespace: odd }]\n    empty: ok\n";

fn folder(name: &str) -> TestFolder {
    let folder = TestFolder::new(name);
    std::fs::create_dir_all(&*folder).expect("a folder can be made");
    folder
}

fn file(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("it can be written");
    path.display().to_string()
}

fn root(path: &str) -> String {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(path).display().to_string()
}

fn run(words: &[&str]) -> (String, String, Option<i32>) {
    let Output { stdout, stderr, status } = program::run(words);
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("it is text");
    (text(stdout), text(stderr), status.code())
}

/// The exit code where nobody reads what it prints.
fn unread(words: &[&str]) -> Option<i32> {
    let closed = || {
        let (reader, writer) = std::io::pipe().expect("a pipe can be made");
        drop(reader);
        Stdio::from(writer)
    };
    let status = telltale(words).stdout(closed()).stderr(closed()).status();
    status.expect("the program can be run").code()
}

/// Characters that move the cursor, or turn the direction of reading.
fn acts(text: &str) -> bool {
    text.chars().any(|it| it != '\n' && it.is_control() || ('\u{202a}'..='\u{202e}').contains(&it))
}

/// A recording with a status whose name and message hold line feeds and what looks like further lines of a replay.
#[test]
fn a_recorded_name_begins_no_line_of_a_replay() {
    let folder = folder("newlines");
    let config = file(&folder, "replay.yaml", CONFIG);
    let recording = root("tests/record/newlines.mcap");
    let (json, _, code) = run(&["replay", &recording, "--config", &config, "--all", "--json"]);
    assert_eq!(code, Some(0));
    let lines: Vec<Value> =
        json.lines().map(|line| serde_json::from_str(line).expect("it is JSON")).collect();
    let names = lines.iter().filter_map(|line| line["node"].as_str());
    assert!(names.clone().any(|name| name.contains('\n')), "the recording has such a name: {json}");
    assert!(!acts(&json), "{json}");
    let (text, _, code) = run(&["replay", &recording, "--config", &config, "--all"]);
    // Beside a line for each change there is the day.
    assert_eq!((text.lines().count(), code), (lines.len() + 1, Some(0)), "{text}");
    assert!(text.contains("\\n") && !acts(&text), "{text}");
    let other = file(&folder, "other.yaml", &CONFIG.replace("timeout: 2s", "timeout: 1s"));
    let (text, err, _) = run(&["replay", &recording, "--config", &config, "--what-if", &other]);
    assert!(!acts(&text) && !acts(&err), "{text}{err}");
}

#[test]
fn a_text_of_a_file_begins_no_line_of_what_is_said_of_it() {
    let folder = folder("forged-lines");
    let forged = "x\\nfile.yaml:1:1: forged\\r\\e[2J\\u202E";
    let named = file(
        &folder,
        "named.yaml",
        &format!(
            "vehicle: {{ stages: none, name: \"{forged}\" }}\ngroups:\n- {{ id: a, name: \"{forged}\", match: [{{ name: \"{forged}\" }}] }}\n"
        ),
    );
    let plain = file(
        &folder,
        "plain.yaml",
        "vehicle: { stages: none }\ngroups:\n- { id: a, match: [{ name: x }] }\n",
    );
    let lines_of = |words: &[&str]| {
        let (out, err, _) = run(words);
        assert!(!acts(&out) && !acts(&err), "{out}{err}");
        (out.lines().count(), format!("{out}{err}"))
    };
    let (forged_lines, text) = lines_of(&["check", &named]);
    assert_eq!(forged_lines, lines_of(&["check", &plain]).0, "{text}");
    let (count, text) = lines_of(&["diff", &plain, &named]);
    assert!(count > 0 && text.lines().all(|line| !line.starts_with("file.yaml")), "{text}");
    for kind in ["--dot", "--svg", "--json"] {
        lines_of(&["check", kind, &named]);
    }
    // A key, and a node that is not there.
    let wrong = file(
        &folder,
        "wrong.yaml",
        &format!("\"{forged}\": 1\ngroups: [{{ id: a, depends_on: [\"{forged}\"] }}]\n"),
    );
    let (_, text) = lines_of(&["check", &wrong]);
    assert!(text.contains("unknown key"), "{text}");
    let is_forged =
        |line: &str| line.trim_start_matches([' ', '│', '×']).starts_with("file.yaml:1:1: forged");
    assert!(!text.lines().any(is_forged), "{text}");
    // A name on the command line.
    let (_, text) = lines_of(&["check", &format!("{}/no\n\u{1b}[2Jfile", folder.display())]);
    assert!(text.contains("does not exist"), "{text}");
}

#[test]
fn no_command_panics_where_nobody_reads() {
    let folder = folder("closed-pipes");
    let good = file(&folder, "good.yaml", CONFIG);
    let wrong = file(&folder, "wrong.yaml", "groups: 1\n");
    let data = folder.join("data").display().to_string();
    telltale::yaml::private_file::make_folder(Path::new(&data)).expect("a folder can be made");
    let secret = "a long secret of one\n".repeat(2);
    let added = run_with(["user", "add", "dora", "--role", "developer", "--data", &data], &secret);
    assert!(added.status.success(), "{added:?}");
    let (recording, scenario) =
        (root("tests/record/newlines.mcap"), root("config/scenarios/forget-after.yaml"));
    let (arm, none) = (root("tests/import/arm.yaml"), folder.join("none").display().to_string());
    let missing = folder.join("missing.yaml").display().to_string();
    let made = folder.join("tls").display().to_string();
    let of = |words: &str| -> Vec<String> {
        let paths = [
            ("GOOD", &good),
            ("WRONG", &wrong),
            ("DATA", &data),
            ("RECORDING", &recording),
            ("SCENARIO", &scenario),
            ("ARM", &arm),
            ("NONE", &none),
            ("MISSING", &missing),
            ("TLS", &made),
        ];
        let path = |word: &str| paths.iter().find(|(name, _)| *name == word).map(|(_, path)| (*path).clone());
        words.split(' ').map(|word| path(word).unwrap_or_else(|| word.to_owned())).collect()
    };
    for words in [
        "check GOOD",
        "check WRONG",
        "check MISSING",
        "check --json GOOD",
        "check --svg GOOD",
        "check --dot GOOD",
        "check --schema",
        "diff GOOD GOOD",
        "diff GOOD WRONG",
        "import ARM",
        "import ARM -o NONE",
        "import WRONG",
        "scenario SCENARIO",
        "scenario --json SCENARIO",
        "replay RECORDING --config GOOD",
        "replay RECORDING --config GOOD --json",
        "replay RECORDING",
        "replay RECORDING --config GOOD --what-if GOOD",
        "api",
        "completions bash",
        "user list --data DATA",
        "user list --json --data DATA",
        "user token dora --data DATA",
        "user tokens --data DATA",
        "user revoke 9 --data DATA",
        "audit verify --data DATA",
        "data check --data DATA",
        "data check --json --data DATA",
        "data repair --data DATA",
        "incident list --data DATA",
        "incident list --json --data DATA",
        "incident verify --data DATA",
        "incident prune --data DATA",
        "incident prune --dry-run --data DATA",
        "incident keep 1 --data DATA",
        "incident export 1 --data DATA",
        "tls self-signed --replace --data TLS",
        "history --data DATA --at 2026-11-22T03:50:00Z --node a --figure NONE",
        "demo --domain 999",
        "serve --config WRONG",
        "--help",
        "check",
        "nonsense",
    ] {
        let words = of(words);
        let words: Vec<&str> = words.iter().map(|word| &**word).collect();
        let read = run(&words);
        let code = unread(&words);
        assert!(matches!(code, Some(0..=2)) && code == read.2, "{words:?}: {code:?} unread, {read:?} read");
    }
}

#[test]
fn what_cannot_be_written_is_an_error() {
    let full = || std::fs::File::options().write(true).open("/dev/full").expect("Linux has it");
    let output = telltale(["api"]).stdout(full()).output().expect("the program can be run");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("standard output cannot be written") && output.status.code() == Some(2), "{said}");
}
