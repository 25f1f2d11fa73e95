//! The commands `check`, `user` and others as programs and shells use them.

use std::path::PathBuf;

use serde_json::{Value, json};

use crate::folder::TestFolder;
use crate::program::{run_with, said};

fn problems(input: &str) -> (Value, Option<i32>) {
    let (out, err, code) = said(&run_with(&["check", "--json", "-"], input));
    assert_eq!(err, "", "{out}");
    (serde_json::from_str(&out).expect("it is JSON"), code)
}

const GOOD: &str = "vehicle: { stages: none }\ngroups: [{ id: a, modules: [{ id: m, status: s }] }]\n";

#[test]
fn check_reads_standard_input_and_is_quiet_when_asked() {
    let (out, err, code) = said(&run_with(&["check", "-"], GOOD));
    assert!(out.contains("1 group, 1 module, 0 stops. No errors.") && err.is_empty(), "{out}{err}");
    assert_eq!(code, Some(0));
    assert_eq!(said(&run_with(&["check", "-q", "-"], GOOD)), (String::new(), String::new(), Some(0)));
    let (out, err, code) = said(&run_with(&["check", "--quiet", "-"], "groups: 1\n"));
    assert!(out.is_empty() && err.contains("standard input:1:9"), "{out}{err}");
    assert_eq!(code, Some(2));
}

#[test]
fn check_tells_programs_where_what_is_wrong() {
    assert_eq!(problems(GOOD), (json!({ "ok": true, "problems": [], "more": 0, "assumed": [] }), Some(0)));
    let (found, code) =
        problems("groups:\n- id: a\n  modules:\n  - { id: m, status: s }\n  - { id: m, status: t }\n");
    let place = |line: u32, column: u32, message: &str| json!({ "file": "standard input", "line": line, "column": column, "message": message });
    let problem = json!({
        "severity": "error", "file": "standard input", "line": 5, "column": 11,
        "message": "module `a/m` is declared twice", "help": "rename or remove one of the two",
        "also": [place(4, 11, "first here")],
    });
    assert_eq!(found, json!({ "ok": false, "problems": [problem], "more": 0, "assumed": [] }));
    assert_eq!(code, Some(2));
    // Nothing can fail in a group without members: a warning, with which a vehicle runs.
    let dead = "vehicle: { stages: none }\nsignals: { s: { topic: /s, type: std_msgs/msg/Bool } }\ngroups:\n- { id: b, when: { signals: { s: true } }, modules: [{ id: n, when: { signals: { s: false } }, status: t }] }\n";
    let (found, code) = problems(dead);
    assert_eq!(
        (&found["ok"], &found["problems"][0]["severity"]),
        (&json!(true), &json!("warning")),
        "{found}"
    );
    assert_eq!(code, Some(0));
    let (out, _, code) = said(&run_with(&["check", "--json", "/nowhere.yaml"], ""));
    let found: Value = serde_json::from_str(&out).expect("it is JSON");
    assert_eq!((&found["problems"][0]["line"], code), (&Value::Null, Some(2)), "{found}");
    assert_eq!(found["problems"][0]["file"], "/nowhere.yaml");
    let quietly = |input| said(&run_with(&["check", "--json", "-q", "-"], input));
    assert_eq!(quietly(GOOD), (String::new(), String::new(), Some(0)), "nothing where nothing is wrong");
    let (out, _, code) = quietly("groups: 1\n");
    let found: Value = serde_json::from_str(&out).expect("it is JSON");
    assert_eq!((found["problems"].as_array().map(Vec::len), code), (Some(1), Some(2)), "{found}");
}

#[test]
fn diff_says_what_two_files_mean_differently() {
    let folder = TestFolder::new("diff");
    std::fs::create_dir(&*folder).unwrap();
    let path = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let good = path("good.yaml", GOOD);
    let same = path("same.yaml", &format!("# a comment\n{}", GOOD.replace("status: s", "\"status\": 's'")));
    let new = path(
        "new.yaml",
        "vehicle: { stages: none }\ngroups: [{ id: a, modules: [{ id: m, status: s, timeout: 3s }, { id: n, status: t }] }]\n",
    );
    let wrong = path("wrong.yaml", "groups:\n  - 1\n");
    assert_eq!(said(&run_with(&["diff", &good, &same], "")), (String::new(), String::new(), Some(0)));
    assert_eq!(said(&run_with(&["diff", "-", &good], GOOD)).2, Some(0));
    let (out, err, code) = said(&run_with(&["diff", &good, &new], ""));
    let lines: Vec<&str> = out.lines().collect();
    assert!(lines[0].starts_with("module `a/m`: policy from "), "{out}{err}");
    assert_eq!((lines[1], lines.len(), code), ("module `a/n` is new", 2, Some(1)));
    let (out, _, code) = said(&run_with(&["diff", "--json", &new, &good], ""));
    let found: Value = serde_json::from_str(&out).expect("it is JSON");
    assert_eq!((&found["differs"], code), (&json!(true), Some(1)));
    assert_eq!(
        found["differences"][0],
        json!({ "change": "removed", "subject": "module `a/n`", "detail": "" })
    );
    let (out, _, code) = said(&run_with(&["diff", "--json", &good, &same], ""));
    assert_eq!((&*out, code), ("{\"differences\":[],\"differs\":false}\n", Some(0)));
    // Both are told.
    let (out, err, code) = said(&run_with(&["diff", &wrong, "/nowhere.yaml"], ""));
    assert!(out.is_empty() && err.contains("wrong.yaml:2:5") && err.contains("/nowhere.yaml"), "{err}");
    assert_eq!(code, Some(2));
    let (_, err, code) = said(&run_with(&["diff", "-", "-"], GOOD));
    assert!(err.contains("only one of the two"), "{err}");
    assert_eq!(code, Some(2));
}

#[test]
fn check_says_what_it_assumes_of_a_type_that_is_left_out() {
    let text = GOOD.replace("groups:", "signals: { s: { topic: /b, field: percentage, when: value < 0.2 }, t: { topic: /c, present_for: 1s } }\ngroups:");
    let sentence =
        "/b is read as the type that its publisher says; that it has `percentage` cannot be checked before";
    let (out, _, code) = said(&run_with(&["check", "-"], &text));
    assert!(out.contains(&format!("Assumed: {sentence}.\n")), "{out}");
    assert!(
        out.contains("signal s: true if `value < 0.2` with value = percentage of /b (type as published)\n"),
        "{out}"
    );
    assert_eq!(code, Some(0));
    assert_eq!(
        problems(&text).0["assumed"],
        json!([sentence, "/c is read as the type that its publisher says"])
    );
}

#[test]
fn types_that_are_not_known_are_said_with_all_else() {
    let (found, _) = problems(
        "signals: { s: { topic: /s, type: my_msgs/msg/Thing, field: x } }\ngroups:\n- id: a\n  colour: red\n  modules:\n  - { id: m, monitor: { value: { topic: /t, type: my_msgs/msg/Other, field: y, error_above: 1 } } }\n  - { id: n, monitor: { value: { topic: /u, type: Wrong, field: y, error_above: 1 } } }\n",
    );
    let found: Vec<String> = found["problems"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| format!("{}: {}", it["line"], it["message"].as_str().unwrap()))
        .collect();
    let expected = [
        "1: topic /s: the type my_msgs/msg/Thing",
        "4: unknown key `colour`",
        "6: topic /t: the type my_msgs/msg/Other",
        "7: `Wrong` is no message type",
    ];
    assert_eq!(found.len(), expected.len(), "{found:#?}");
    for (found, expected) in found.iter().zip(expected) {
        assert!(found.starts_with(expected), "{found} is not {expected}");
    }
}

#[test]
fn users_are_listed_for_programs() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("commands-users");
    let _ = std::fs::remove_dir_all(&folder);
    let data = folder.to_str().expect("the path is text");
    let secret = "a long enough secret\na long enough secret\n";
    let added = run_with(&["user", "add", "dora", "--role", "developer", "--data", data], secret);
    assert_eq!(added.status.code(), Some(0), "{added:?}");
    let (out, _, code) = said(&run_with(&["user", "list", "--json", "--data", data], ""));
    let users: Value = serde_json::from_str(&out).expect("it is JSON");
    assert_eq!((&users[0]["name"], &users[0]["role"], code), (&json!("dora"), &json!("developer"), Some(0)));
    let created = users[0]["created"].as_str().expect("it has a date");
    assert!(users.as_array().is_some_and(|all| all.len() == 1) && created.ends_with('Z'), "{users}");
}

#[test]
fn data_is_checked_repaired_and_restored_while_nobody_serves() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("commands-data");
    let _ = std::fs::remove_dir_all(&folder);
    let data = folder.to_str().expect("the path is text");
    let run = |words: &[&str], input: &str| said(&run_with(&[words, &["--data", data]].concat(), input));
    let (_, err, code) = run(&["data", "check"], "");
    assert!(code == Some(2) && err.contains("there is no database") && err.contains("--data"), "{err}");
    assert!(!folder.exists(), "a folder that is misspelt is not made");
    let (_, err, code) = run(&["data", "repair"], "");
    assert!(code == Some(2) && err.contains(data) && !folder.exists(), "{err}");
    run(&["user", "add", "anna", "--role", "operator"], "975310\n975310\n");
    let (out, _, code) = run(&["data", "check"], "");
    assert!(code == Some(0) && out.starts_with("ok") && out.contains("users: 1"), "{out}");
    let (_, err, code) = run(&["data", "restore"], "");
    assert!(code == Some(2) && err.contains("no backup"), "{err}");

    let database = folder.join("telltale.db");
    std::fs::create_dir(folder.join("backups")).expect("the folder is there");
    std::fs::copy(&database, folder.join("backups/telltale-2026-01-01.db")).expect("it is one file");
    std::fs::write(&database, "x".repeat(9000)).expect("the folder is there");
    let (out, _, code) = run(&["data", "check", "--json"], "");
    let state: Value = serde_json::from_str(&out).expect("it is JSON");
    assert_eq!((code, &state["ok"], &state["backups"][0]["users"]), (Some(1), &json!(false), &json!(1)));
    let (_, err, _) = run(&["user", "list"], "");
    assert!(err.contains("telltale data check") || err.contains("telltale data repair"), "{err}");

    let held = std::fs::File::open(&folder).expect("it is there");
    held.try_lock().expect("nobody else has it");
    for words in [["data", "repair"], ["data", "restore"]] {
        let (_, err, code) = run(&words, "");
        assert!(code == Some(2) && err.contains("another `telltale serve`"), "{err}");
    }
    assert_eq!(run(&["data", "check"], "").2, Some(1), "it changes nothing");
    drop(held);
    let (out, err, code) = run(&["data", "repair"], "");
    assert!(code == Some(0) && out.contains("1 user;") && out.contains("damaged-"), "{out}{err}");
    assert!(run(&["user", "list"], "").0.contains("anna"));
    let (out, _, code) = run(&["data", "repair"], "");
    assert!(code == Some(0) && out.contains("nothing was changed"), "{out}");

    std::fs::remove_file(&database).expect("it is there");
    let (_, err, code) = run(&["user", "add", "bert", "--role", "operator"], "975310\n975310\n");
    assert!(code == Some(2) && err.contains("gone or empty") && !database.exists(), "{err}");
    let (out, err, code) = run(&["data", "restore"], "");
    assert!(code == Some(0) && out.contains("telltale-2026-01-01.db"), "{out}{err}");
    assert!(run(&["user", "list"], "").0.contains("anna"));

    // An authority looks into it.
    let (out, _, code) = run(&["audit", "verify"], "");
    assert!(code == Some(1) && out.starts_with("BAD") && out.contains("acknowledge"), "{out}");
    let secret = "correct horse battery\n";
    run(&["user", "add", "carl", "--role", "authority"], &secret.repeat(2));
    let acknowledge = ["audit", "acknowledge", "--by", "carl", "--why", "restored"];
    let (_, err, code) = run(&acknowledge, "wrong\n");
    assert!(code == Some(2) && err.contains("nothing was acknowledged"), "{err}");
    let (out, err, code) = run(&acknowledge, secret);
    assert!(code == Some(0) && out.starts_with("acknowledged"), "{out}{err}");
    let (out, _, code) = run(&["audit", "verify"], "");
    assert!(code == Some(0) && out.starts_with("ok") && out.contains("carl has acknowledged"), "{out}");
}
